//! What the first-order optimisers share: gradients checked and measured, then an update of every element in place.
//!
//! Chunks are of fixed size and every element is updated by itself, so that results do not depend on the number of threads
//! or on the width of the processor's vectors.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::backend::cpu::{self, Work, widest};
use crate::optim::{ByPrefix, Clip, Params, Schedule};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{DType, Device, Error, ErrorKind, Result, Tensor};

/// What an optimiser did in one update.
///
/// ```
/// use gradreel::optim::{Params, Sgd};
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("x", Tensor::from_vec(vec![4.0], [1]));
/// let gradients = {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     bound.gradients(&bound.get("x")?.square().backward()?)?
/// };
/// let update = Sgd::new(0.1).step(&mut params, &gradients)?;
/// assert_eq!((update.step, update.rate, update.gradient_norm), (1, 0.1, 8.0));
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// Updates made so far, this one included.
    pub step: u64,
    /// The rate of paths without one of their own, with the schedule's factor.
    pub rate: f64,
    /// The norm of all gradients together, before clipping.
    pub gradient_norm: f64,
}

/// The settings that all first-order optimisers have.
#[derive(Debug, Clone)]
pub(super) struct Settings {
    pub rates: ByPrefix<f64>,
    pub decays: ByPrefix<f64>,
    pub schedule: Schedule,
    pub clip: Clip,
}

impl Settings {
    pub fn new() -> Self {
        Self {
            rates: ByPrefix::default(),
            decays: ByPrefix::default(),
            schedule: Schedule::constant(),
            clip: Clip::None,
        }
    }

    /// Checks everything that can be wrong with an update, so that nothing is changed when something is; returns the norm of
    /// all gradients.
    pub fn check(&self, rate: f64, params: &Params, gradients: &BTreeMap<String, Tensor>) -> Result<f64> {
        self.rates.check("a rate is given", params.tensors())?;
        self.decays.check("a weight decay is given", params.tensors())?;
        self.clip.check()?;
        for number in self.rates.values().chain(self.decays.values()).chain([&rate]) {
            if !(number.is_finite() && *number >= 0.0) {
                return Err(
                    Error::new(ErrorKind::Input, "a rate or a weight decay is not a number from 0").found(number)
                );
            }
        }
        let mut squares = 0.0;
        for (path, gradient) in gradients {
            let param = params.get(path)?;
            if !param.dtype().is_real() {
                return Err(Error::new(ErrorKind::Unsupported, "only f32 and f64 parameters are updated")
                    .at(path)
                    .found(param.dtype())
                    .fix("cast it with Params::cast to train it, or freeze it"));
            }
            if gradient.spec() != param.spec() {
                return Err(Error::new(ErrorKind::Shape, "a gradient does not fit its parameter")
                    .at(path)
                    .found(format!("{:?}", gradient.spec()))
                    .wanted(format!("{:?}", param.spec())));
            }
            squares += sum_of_squares(gradient).map_err(|e| e.at(path))?;
        }
        let norm = squares.sqrt();
        if norm.is_finite() {
            return Ok(norm);
        }
        Err(Error::new(ErrorKind::NonFinite, "the norm of the gradients overflows").found("gradients above 1e154"))
    }
}

/// The sum of squares in `f64`, whatever the number of threads; refuses what is not finite.
pub(super) fn sum_of_squares(gradient: &Tensor) -> Result<f64> {
    if gradient.device() != Device::Cpu {
        return sum_of_squares(&gradient.to_device(&Device::Cpu)?);
    }
    let sum = for_real!(gradient.dtype(), T => {
        let parts: Vec<f64> = gradient.slice::<T>().par_chunks(CHUNK).map(squares).collect();
        parts.iter().sum::<f64>()
    });
    if sum.is_finite() || gradient.all_finite()? {
        return Ok(sum);
    }
    Err(Error::new(ErrorKind::NonFinite, "the gradient of a parameter is not finite")
        .fix("evaluate once on Tape::with_anomaly_mode() to see which op made it so"))
}

/// Elements per work item.
const CHUNK: usize = 1 << 15;

/// A sum of squares in sixteen running sums, which any vector width adds up alike. The square of a NaN or an infinity makes
/// it not finite; that of an `f32` cannot overflow.
fn squares<T: Real>(values: &[T]) -> f64 {
    widest(Squares(values))
}

struct Squares<'a, T>(&'a [T]);

impl<T: Real> Work for Squares<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let mut sums = [0.0f64; 16];
        let (rows, rest) = self.0.as_chunks::<16>();
        for row in rows {
            for i in 0..16 {
                let x = row[i].to_f64();
                sums[i] += x * x;
            }
        }
        for i in 0..rest.len() {
            let x = rest[i].to_f64();
            sums[i] += x * x;
        }
        sums.iter().sum()
    }
}

/// The new value and the new states of one element.
pub(super) trait Rule<T, const STATES: usize>: Copy + Sync {
    fn update(self, x: T, gradient: T, states: [T; STATES]) -> (T, [T; STATES]);
}

/// Clipping of one element: a factor from the norm, and limits.
#[derive(Clone, Copy)]
pub(super) struct Clipped<T> {
    pub factor: T,
    pub limit: T,
}

impl<T: Real> Clipped<T> {
    #[inline(always)]
    pub fn of(self, gradient: T) -> T {
        let scaled = gradient * self.factor;
        let below = if scaled > self.limit { self.limit } else { scaled };
        if below < -self.limit { -self.limit } else { below }
    }
}

/// Updates a tensor and its states, in place where nobody else holds them.
pub(super) fn update<T: Real, const STATES: usize>(
    rule: impl Rule<T, STATES>,
    x: &mut Tensor,
    gradient: &Tensor,
    states: &mut [Tensor; STATES],
) -> Result<()> {
    let device = x.device();
    if device != Device::Cpu {
        let (mut here, gradient) = (x.to_device(&Device::Cpu)?, gradient.to_device(&Device::Cpu)?);
        update(rule, &mut here, &gradient, states)?;
        *x = here.to_device(&device)?;
        return Ok(());
    }
    let g = gradient.slice::<T>();
    let mut states = states.each_mut().map(Tensor::slice_mut::<T>);
    let x = x.slice_mut::<T>();
    if x.len() <= CHUNK {
        run(rule, x, g, states);
        return Ok(());
    }
    let mut parts = states.each_mut().map(|state| state.chunks_mut(CHUNK));
    let jobs: Vec<_> = x
        .chunks_mut(CHUNK)
        .zip(g.chunks(CHUNK))
        .map(|(x, g)| {
            (x, g, parts.each_mut().map(|part| part.next().expect("a state has the length of its parameter")))
        })
        .collect();
    jobs.into_par_iter().for_each(|(x, g, states)| run(rule, x, g, states));
    Ok(())
}

fn run<T: Real, const STATES: usize>(rule: impl Rule<T, STATES>, x: &mut [T], g: &[T], states: [&mut [T]; STATES]) {
    widest(Elements { rule, x, g, states });
}

struct Elements<'a, R, T, const STATES: usize> {
    rule: R,
    x: &'a mut [T],
    g: &'a [T],
    states: [&'a mut [T]; STATES],
}

impl<R: Rule<T, STATES>, T: Real, const STATES: usize> Work for Elements<'_, R, T, STATES> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { rule, x, g, states } = self;
        let len = x.len();
        let g = &g[..len];
        let states = states.map(|state| &mut state[..len]);
        for i in 0..len {
            let mut old = [T::ZERO; STATES];
            for s in 0..STATES {
                old[s] = states[s][i];
            }
            let (value, new) = rule.update(x[i], g[i], old);
            x[i] = value;
            for s in 0..STATES {
                states[s][i] = new[s];
            }
        }
    }
}

/// The states of a parameter, zeros at first.
///
/// # Errors
/// [`ErrorKind::Shape`] when states that were restored are those of another parameter.
pub(super) fn check_states(path: &str, states: &[Tensor], param: &Tensor) -> Result<()> {
    match states.iter().find(|state| state.spec() != param.spec()) {
        None => Ok(()),
        Some(state) => Err(Error::new(ErrorKind::Shape, "the optimiser's state does not fit its parameter")
            .at(path)
            .found(format!("{:?}", state.spec()))
            .wanted(format!("{:?}", param.spec()))
            .fix("restore the state that was saved with these parameters")),
    }
}

/// Zeros on the CPU for a state of this parameter.
pub(super) fn zeros_like(param: &Tensor) -> Tensor {
    fn zeros<T: Real>(param: &Tensor) -> Tensor {
        let values = cpu::filled(param.len(), cpu::CHUNK, |_, part: &mut [T]| part.fill(T::ZERO));
        Tensor::from_vec(values, param.shape())
    }
    match param.dtype() {
        DType::F64 => zeros::<f64>(param),
        _ => zeros::<f32>(param),
    }
}
