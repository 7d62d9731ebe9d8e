//! Stochastic gradient descent with momentum (Sutskever et al. 2013).

use std::collections::BTreeMap;

use crate::io::TensorFile;
use crate::optim::state::{States, restore_states, save_states};
use crate::optim::update::{Clipped, Rule, Settings, check_states, update, zeros_like};
use crate::optim::{Clip, Params, Schedule, Update};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{Element, Result, Tensor};

/// Gradient descent, with momentum if wanted.
///
/// `g ← g + decay · x`, `b ← momentum · b + g`, `x ← x − rate · b`; Nesterov's form moves by `g + momentum · b` instead of
/// `b`. Without momentum there is no state.
///
/// ```
/// use gradreel::optim::{Params, Sgd};
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("x", Tensor::from_vec(vec![4.0], [1]));
/// let mut optimiser = Sgd::new(0.1);
/// let gradients = {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     bound.gradients(&bound.get("x")?.square().backward()?)?
/// };
/// optimiser.step(&mut params, &gradients)?;
/// assert!((params.get("x")?.item()? - 3.2).abs() < 1e-6);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Sgd {
    /// The rate of paths without one of their own.
    pub rate: f64,
    /// Share of the last move that is kept, from 0 up to but not including 1.
    pub momentum: f64,
    /// Looks ahead along the momentum.
    pub nesterov: bool,
    /// The weight decay of paths without one of their own; it is added to the (clipped) gradient.
    pub weight_decay: f64,
    settings: Settings,
    steps: u64,
    moves: States<1>,
}

impl Sgd {
    /// Plain gradient descent.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// assert_eq!(Sgd::new(1e-3).steps(), 0);
    /// ```
    pub fn new(rate: f64) -> Self {
        let (settings, moves) = (Settings::new(), BTreeMap::new());
        Self { rate, momentum: 0.0, nesterov: false, weight_decay: 0.0, settings, steps: 0, moves }
    }

    /// Keeps a share of the last move.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// let optimiser = Sgd::new(1e-3).with_momentum(0.9);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_momentum(mut self, momentum: f64) -> Self {
        self.momentum = momentum;
        self
    }

    /// Keeps a share of the last move and looks ahead along it.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// let optimiser = Sgd::new(1e-3).with_nesterov_momentum(0.9);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_nesterov_momentum(mut self, momentum: f64) -> Self {
        (self.momentum, self.nesterov) = (momentum, true);
        self
    }

    /// Gives the paths under this prefix a rate of their own; the longest prefix counts.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// let optimiser = Sgd::new(1e-3).with_rate("net.head", 1e-2);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_rate(mut self, prefix: impl Into<String>, rate: f64) -> Self {
        self.settings.rates.insert(prefix, rate);
        self
    }

    /// Decays all parameters.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// let optimiser = Sgd::new(1e-3).with_weight_decay(1e-4);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_weight_decay(mut self, decay: f64) -> Self {
        self.weight_decay = decay;
        self
    }

    /// Gives the paths under this prefix a weight decay of their own; the longest prefix counts.
    ///
    /// ```
    /// use gradreel::optim::Sgd;
    /// let optimiser = Sgd::new(1e-3).with_weight_decay_of("net.bias", 0.0);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_weight_decay_of(mut self, prefix: impl Into<String>, decay: f64) -> Self {
        self.settings.decays.insert(prefix, decay);
        self
    }

    /// Multiplies all rates by a factor that depends on the number of updates made.
    ///
    /// ```
    /// use gradreel::optim::{Sgd, Schedule};
    /// let optimiser = Sgd::new(1e-3).with_schedule(Schedule::cosine(1000, 0.1));
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_schedule(mut self, schedule: Schedule) -> Self {
        self.settings.schedule = schedule;
        self
    }

    /// Limits the gradients.
    ///
    /// ```
    /// use gradreel::optim::{Sgd, Clip};
    /// let optimiser = Sgd::new(1e-3).with_clip(Clip::Norm(1.0));
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_clip(mut self, clip: Clip) -> Self {
        self.settings.clip = clip;
        self
    }

    /// Updates made so far.
    ///
    /// ```
    /// use gradreel::optim::{Params, Sgd};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Sgd::new(0.1);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// assert_eq!(optimiser.steps(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step against the gradients. A tensor that nothing else holds is updated in place, so drop the tape first.
    ///
    /// ```
    /// use gradreel::optim::{Params, Sgd};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Sgd::new(0.1);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// assert!((params.get("x")?.item()? - 3.2).abs() < 1e-6);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`crate::optim::Adam::step`]; nothing is changed then.
    pub fn step(&mut self, params: &mut Params, gradients: &BTreeMap<String, Tensor>) -> Result<Update> {
        let gradient_norm = self.settings.check(self.rate, params, gradients)?;
        for path in gradients.keys() {
            check_states(path, self.moves.get(path).map_or(&[], |states| &states[..]), params.get(path)?)?;
        }
        let factor = self.settings.schedule.factor(self.steps);
        self.steps += 1;
        for (path, gradient) in gradients {
            let rate = factor * self.settings.rates.get(path).unwrap_or(&self.rate);
            let decay = *self.settings.decays.get(path).unwrap_or(&self.weight_decay);
            let param = params.get_mut(path)?;
            for_real!(param.dtype(), T => {
                let rule = SgdRule::<T> {
                    clipped: self.settings.clip.for_norm(gradient_norm),
                    momentum: T::from_f64(self.momentum),
                    ahead: self.nesterov,
                    rate: T::from_f64(rate),
                    decay: T::from_f64(decay),
                };
                if self.momentum == 0.0 {
                    update(Plain(rule), param, gradient, &mut [])?;
                } else {
                    let moves = self.moves.entry(path.clone()).or_insert_with(|| [zeros_like(param)]);
                    update(rule, param, gradient, moves)?;
                }
            });
        }
        Ok(Update { step: self.steps, rate: factor * self.rate, gradient_norm })
    }

    /// Adds the moves (`optimizer.sgd.momentum.<path>`) and the number of updates (metadata `optimizer.sgd.step`) to a file.
    ///
    /// ```
    /// use gradreel::optim::{Params, Sgd};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Sgd::new(0.1).with_momentum(0.9);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// optimiser.save(&mut file);
    /// let mut again = Sgd::new(0.1).with_momentum(0.9);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn save(&self, file: &mut TensorFile) {
        save_states(file, NAME, ["momentum"], self.steps, &self.moves);
    }

    /// Goes on from a file, bit for bit.
    ///
    /// ```
    /// use gradreel::optim::{Params, Sgd};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Sgd::new(0.1).with_momentum(0.9);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// optimiser.save(&mut file);
    /// let mut again = Sgd::new(0.1).with_momentum(0.9);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Input`] when the state is missing or incomplete; nothing is changed then.
    pub fn restore(&mut self, file: &TensorFile) -> Result<()> {
        (self.steps, self.moves) = restore_states(file, NAME, ["momentum"])?;
        Ok(())
    }
}

const NAME: &str = "sgd";

#[derive(Clone, Copy)]
struct SgdRule<T> {
    clipped: Clipped<T>,
    momentum: T,
    ahead: bool,
    rate: T,
    decay: T,
}

impl<T: Real> Rule<T, 1> for SgdRule<T> {
    #[inline(always)]
    fn update(self, x: T, gradient: T, [b]: [T; 1]) -> (T, [T; 1]) {
        let g = self.clipped.of(gradient) + self.decay * x;
        let b = self.momentum * b + g;
        let along = if self.ahead { g + self.momentum * b } else { b };
        (x - self.rate * along, [b])
    }
}

#[derive(Clone, Copy)]
struct Plain<T>(SgdRule<T>);

impl<T: Real> Rule<T, 0> for Plain<T> {
    #[inline(always)]
    fn update(self, x: T, gradient: T, _: [T; 0]) -> (T, [T; 0]) {
        (x - self.0.rate * (self.0.clipped.of(gradient) + self.0.decay * x), [])
    }
}
