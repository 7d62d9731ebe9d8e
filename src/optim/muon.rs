//! Muon: momentum whose matrices are brought to orthogonal ones (Jordan et al., *Muon: an optimizer for hidden layers in
//! neural networks*, 2024).

use std::collections::BTreeMap;

use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::io::TensorFile;
use crate::optim::state::{States, restore_states, save_states};
use crate::optim::update::{Clipped, Rule, Settings, check_states, update, zeros_like};
use crate::optim::{Clip, Params, Schedule, Update};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{Device, Element, Error, ErrorKind, Result, Tensor};

/// Muon for weights that are matrices; everything else is [`Adam`](crate::optim::Adam)'s.
///
/// A weight `[rows, ..]` is a matrix of `rows` rows; of a convolution that is one row for each output. The momentum `m ← μ m +
/// (1−μ) g` is mixed with the gradient once more (Nesterov), `u = μ m + (1−μ) g`. Five Newton–Schulz steps bring the singular
/// values of `u` near 1:
///
/// ```text
/// X ← u / ‖u‖,   five times   X ← 3.4445 X + (−4.7750 A + 2.0315 A²) X   with   A = X Xᵀ
/// ```
///
/// and `x ← x − rate · (√max(1, rows / columns) · X + decay · x)`. The size of a gradient thus has no say in the size of a step:
/// rates are near 0.02 for all layers.
///
/// ```
/// use gradreel::optim::{Muon, Params};
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("weight", Tensor::from_vec(vec![2.0, 0.0, 0.0, 1.0], [2, 2]));
/// let mut optimiser = Muon::new(0.1).with_momentum(0.0);
/// for _ in 0..40 {
///     let gradients = {
///         let tape = Tape::new();
///         let bound = params.bind(&tape);
///         bound.gradients(&bound.get("weight")?.square().sum_all().backward()?)?
///     };
///     optimiser.step(&mut params, &gradients)?;
/// }
/// assert!(params.get("weight")?.to_vec()?.iter().all(|x| x.abs() < 0.3));
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Muon {
    /// The rate.
    pub rate: f64,
    /// Decay μ of the momentum.
    pub momentum: f64,
    /// The weight decay.
    pub weight_decay: f64,
    settings: Settings,
    steps: u64,
    moves: States<1>,
}

/// Newton–Schulz steps, and the coefficients of their polynomial.
const STEPS: usize = 5;
const POLYNOMIAL: [f64; 3] = [3.4445, -4.7750, 2.0315];
/// Keeps the division by the norm finite.
const LEAST: f64 = 1e-7;

impl Muon {
    /// Muon with μ = 0.95, without weight decay, clipping or schedule.
    ///
    /// ```
    /// use gradreel::optim::Muon;
    /// assert_eq!(Muon::new(0.02).steps(), 0);
    /// ```
    pub fn new(rate: f64) -> Self {
        let (settings, moves) = (Settings::new(), BTreeMap::new());
        Self { rate, momentum: 0.95, weight_decay: 0.0, settings, steps: 0, moves }
    }

    /// Sets the decay of the momentum.
    ///
    /// ```
    /// use gradreel::optim::Muon;
    /// assert_eq!(Muon::new(0.02).with_momentum(0.9).momentum, 0.9);
    /// ```
    #[must_use]
    pub fn with_momentum(mut self, momentum: f64) -> Self {
        self.momentum = momentum;
        self
    }

    /// Decays all parameters.
    ///
    /// ```
    /// use gradreel::optim::Muon;
    /// assert_eq!(Muon::new(0.02).with_weight_decay(0.01).weight_decay, 0.01);
    /// ```
    #[must_use]
    pub fn with_weight_decay(mut self, decay: f64) -> Self {
        self.weight_decay = decay;
        self
    }

    /// Multiplies the rate by a factor that depends on the number of updates made.
    ///
    /// ```
    /// use gradreel::optim::{Muon, Schedule};
    /// let optimiser = Muon::new(0.02).with_schedule(Schedule::cosine(1000, 0.1));
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_schedule(mut self, schedule: Schedule) -> Self {
        self.settings.schedule = schedule;
        self
    }

    /// Limits the gradients before they enter the momentum.
    ///
    /// ```
    /// use gradreel::optim::{Clip, Muon};
    /// let optimiser = Muon::new(0.02).with_clip(Clip::Norm(1.0));
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
    /// use gradreel::optim::Muon;
    /// assert_eq!(Muon::new(0.02).steps(), 0);
    /// ```
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step against the gradients. A tensor that nothing else holds is updated in place, so drop the tape first.
    ///
    /// ```
    /// use std::collections::BTreeMap;
    ///
    /// use gradreel::optim::{Muon, Params};
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("weight", Tensor::zeros([1, 2], DType::F64));
    /// let gradients = BTreeMap::from([("weight".to_owned(), Tensor::from_vec(vec![3.0, 4.0], [1, 2]))]);
    /// Muon::new(0.1).step(&mut params, &gradients)?;
    /// // one row: along the gradient, by about the rate
    /// let moved = params.get("weight")?.to_vec()?;
    /// assert!((moved[0] / moved[1] - 0.75).abs() < 1e-9 && (0.05..0.15).contains(&moved[0].hypot(moved[1])));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::NonFinite`] for a gradient that is not finite, naming its path; [`crate::ErrorKind::Input`] for a
    /// path that `params` does not have; [`crate::ErrorKind::Shape`] for a gradient of another shape or dtype than its
    /// parameter, or of fewer than two axes. Nothing is changed then.
    pub fn step(&mut self, params: &mut Params, gradients: &BTreeMap<String, Tensor>) -> Result<Update> {
        let gradient_norm = self.settings.check(self.rate, params, gradients)?;
        for (path, gradient) in gradients {
            if gradient.dims().len() < 2 {
                return Err(Error::new(ErrorKind::Shape, "Muon updates matrices only")
                    .at(path)
                    .found(gradient.shape())
                    .wanted("two axes or more")
                    .fix("give vectors and scalars to Adam"));
            }
            check_states(path, self.moves.get(path).map_or(&[], |states| &states[..]), params.get(path)?)?;
        }
        let rate = self.rate * self.settings.schedule.factor(self.steps);
        self.steps += 1;
        for (path, gradient) in gradients {
            let param = params.get_mut(path)?;
            let moves = self.moves.entry(path.clone()).or_insert_with(|| [zeros_like(param)]);
            let gradient = gradient.to_device(&Device::Cpu)?;
            let rows = param.dims()[0];
            let columns = param.len() / rows.max(1);
            let scale = (rows as f64 / columns.max(1) as f64).max(1.0).sqrt();
            for_real!(param.dtype(), T => {
                let momentum = Momentum::<T> {
                    clipped: self.settings.clip.for_norm(gradient_norm),
                    keep: T::from_f64(self.momentum),
                    take: T::from_f64(1.0 - self.momentum),
                };
                let mut along = zeros_like(param);
                update(momentum, &mut along, &gradient, moves)?;
                orthogonalise(along.slice_mut::<T>(), rows, columns);
                let step =
                    Step::<T> { rate: T::from_f64(rate * scale), decay: T::from_f64(rate * self.weight_decay) };
                update::<T, 0>(step, param, &along, &mut [])?;
            });
        }
        Ok(Update { step: self.steps, rate, gradient_norm })
    }

    /// Adds the momenta (`optimizer.muon.momentum.<path>`) and the number of updates (metadata `optimizer.muon.step`) to a
    /// file. Rate, decays and schedule are the program's to give again.
    ///
    /// ```
    /// use gradreel::optim::Muon;
    /// let mut file = gradreel::io::TensorFile::default();
    /// Muon::new(0.02).save(&mut file);
    /// let mut again = Muon::new(0.02);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn save(&self, file: &mut TensorFile) {
        save_states(file, NAME, ["momentum"], self.steps, &self.moves);
    }

    /// Goes on from a file, bit for bit.
    ///
    /// ```
    /// use gradreel::optim::Muon;
    /// let mut file = gradreel::io::TensorFile::default();
    /// Muon::new(0.02).save(&mut file);
    /// let mut again = Muon::new(0.02);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 0);
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

const NAME: &str = "muon";

/// Brings the singular values of a row-major matrix near 1, all but those that are 0.
fn orthogonalise<T: Real>(values: &mut [T], rows: usize, columns: usize) {
    let squares: f64 = values.iter().map(|x| x.to_f64() * x.to_f64()).sum();
    let factor = T::from_f64(1.0 / (squares.sqrt() + LEAST));
    // the products of rows are the smaller ones of a wide matrix
    let wide = rows <= columns;
    let (m, k) = if wide { (rows, columns) } else { (columns, rows) };
    let mut x: Vec<T> = match wide {
        true => values.iter().map(|v| *v * factor).collect(),
        false => (0..m * k).map(|i| values[i % k * m + i / k] * factor).collect(),
    };
    let [mut a, mut b] = [0; 2].map(|_| vec![T::ZERO; m * m]);
    let mut next = vec![T::ZERO; m * k];
    let [p, q, r] = POLYNOMIAL.map(T::from_f64);
    for _ in 0..STEPS {
        Gemm::new([m, k, m]).run(&Strided::lines(&x, k), &Strided::lines(&x, k), Out::rows(&mut a, m), Par::Threads);
        // symmetric: its columns are its rows
        Gemm::new([m, m, m]).run(&Strided::lines(&a, m), &Strided::lines(&a, m), Out::rows(&mut b, m), Par::Threads);
        for (b, a) in b.iter_mut().zip(&a) {
            *b = q * *a + r * *b;
        }
        Gemm::new([m, m, k]).run(
            &Strided::lines(&b, m),
            &Strided::side_by_side(&x, k),
            Out::rows(&mut next, k),
            Par::Threads,
        );
        for (x, next) in x.iter_mut().zip(&next) {
            *x = p * *x + *next;
        }
    }
    match wide {
        true => values.copy_from_slice(&x),
        false => (0..m * k).for_each(|i| values[i % k * m + i / k] = x[i]),
    }
}

/// The momentum, and its mixture with the gradient in the place of the value.
#[derive(Clone, Copy)]
struct Momentum<T> {
    clipped: Clipped<T>,
    keep: T,
    take: T,
}

impl<T: Real> Rule<T, 1> for Momentum<T> {
    #[inline(always)]
    fn update(self, _: T, gradient: T, [m]: [T; 1]) -> (T, [T; 1]) {
        let g = self.clipped.of(gradient);
        let m = self.keep * m + self.take * g;
        (self.keep * m + self.take * g, [m])
    }
}

#[derive(Clone, Copy)]
struct Step<T> {
    rate: T,
    decay: T,
}

impl<T: Real> Rule<T, 0> for Step<T> {
    #[inline(always)]
    fn update(self, x: T, along: T, _: [T; 0]) -> (T, [T; 0]) {
        (x - (self.rate * along + self.decay * x), [])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Key;

    /// A wide, a tall and a square matrix: products of their short sides are near the identity.
    #[test]
    fn singular_values_come_near_one() {
        for (rows, columns) in [(5, 12), (12, 5), (7, 7)] {
            let mut x: Vec<f64> = Key::new(3).normal(rows * columns).collect();
            let before = x.clone();
            orthogonalise(&mut x, rows, columns);
            let (m, k) = (rows.min(columns), rows.max(columns));
            let at = |i: usize, j: usize| if rows <= columns { x[i * columns + j] } else { x[j * columns + i] };
            let gram = |i: usize, l: usize| (0..k).map(|j| at(i, j) * at(l, j)).sum::<f64>();
            // squares of singular values lie between 0.6 and 1.3 after five steps, so traces and entries do likewise
            for i in 0..m {
                assert!((0.4..1.5).contains(&gram(i, i)), "{rows}×{columns}: {}", gram(i, i));
            }
            // the direction stays: the product with what it was is positive
            let along: f64 = x.iter().zip(&before).map(|(a, b)| a * b).sum();
            assert!(along > 0.0);
        }
    }

    /// Of a matrix with one singular value nothing is left but its direction: the polynomial of a number.
    #[test]
    fn a_row_follows_the_polynomial() {
        let mut x = [3.0f64, 4.0];
        orthogonalise(&mut x, 1, 2);
        let [p, q, r] = POLYNOMIAL;
        let wanted = (0..STEPS).fold(5.0 / (5.0 + LEAST), |s: f64, _| p * s + q * s.powi(3) + r * s.powi(5));
        assert!((x[0] - 0.6 * wanted).abs() < 1e-12 && (x[1] - 0.8 * wanted).abs() < 1e-12, "{x:?} {wanted}");
    }

    #[test]
    fn vectors_are_refused() {
        let mut params = Params::new();
        params.set("bias", Tensor::from_vec(vec![1.0f32; 3], [3]));
        let gradients = BTreeMap::from([("bias".to_owned(), Tensor::from_vec(vec![1.0f32; 3], [3]))]);
        let error = Muon::new(0.1).step(&mut params, &gradients).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Shape);
        assert!(error.to_string().contains("bias") && error.to_string().contains("Adam"), "{error}");
    }

    /// Momentum is kept: a pause changes nothing.
    #[test]
    fn it_goes_on_from_a_file_bit_for_bit() {
        let gradient = |n: u64| {
            let values: Vec<f32> = Key::new(n).normal(15).map(|x| x as f32).collect();
            BTreeMap::from([("w".to_owned(), Tensor::from_vec(values, [3, 5]))])
        };
        let start = || Params::from_iter([("w".to_owned(), Tensor::from_vec(vec![0.5f32; 15], [3, 5]))]);
        let muon = || Muon::new(0.02).with_weight_decay(0.01).with_clip(Clip::Norm(1.0));
        let (mut straight, mut whole) = (start(), muon());
        for n in 0..6 {
            whole.step(&mut straight, &gradient(n)).unwrap();
        }
        let (mut params, mut first) = (start(), muon());
        for n in 0..3 {
            first.step(&mut params, &gradient(n)).unwrap();
        }
        let mut file = TensorFile::default();
        first.save(&mut file);
        let mut second = muon();
        second.restore(&file).unwrap();
        for n in 3..6 {
            second.step(&mut params, &gradient(n)).unwrap();
        }
        assert_eq!(params.get("w").unwrap().slice::<f32>(), straight.get("w").unwrap().slice::<f32>());
        assert_eq!(second.steps(), 6);
    }
}
