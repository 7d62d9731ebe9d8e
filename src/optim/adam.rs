//! Adam (Kingma and Ba 2015) and AdamW (Loshchilov and Hutter 2019).

use std::collections::BTreeMap;

use crate::io::TensorFile;
use crate::optim::state::{States, restore_states, save_states};
use crate::optim::update::{Clipped, Rule, Settings, check_states, update, zeros_like};
use crate::optim::{Clip, Params, Schedule, Update};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{Element, Result, Tensor};

/// Adam with per-prefix rates; with a weight decay it is AdamW.
///
/// `m ← β₁ m + (1−β₁) g`, `v ← β₂ v + (1−β₂) g²`, `x ← x − rate · (m̂ / (√v̂ + ε) + decay · x)` with `m̂ = m / (1−β₁ᵗ)` and
/// `v̂ = v / (1−β₂ᵗ)`. The decay acts on the parameter itself, not through the moments. Moments have the parameter's dtype;
/// everything that is one number for all elements is computed in `f64`.
///
/// ```
/// use gradreel::optim::{Params, Adam};
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("x", Tensor::from_vec(vec![4.0], [1]));
/// let mut optimiser = Adam::new(0.1);
/// let gradients = {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     bound.gradients(&bound.get("x")?.square().backward()?)?
/// };
/// optimiser.step(&mut params, &gradients)?;
/// assert!((params.get("x")?.item()? - 3.9).abs() < 1e-6);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Adam {
    /// The rate of paths without one of their own.
    pub rate: f64,
    /// The weight decay of paths without one of their own; 0 for plain Adam.
    pub weight_decay: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
    settings: Settings,
    steps: u64,
    moments: States<2>,
}

impl Adam {
    /// Adam with β = (0.9, 0.999), ε = 1e-8, without weight decay, clipping or schedule.
    ///
    /// ```
    /// use gradreel::optim::Adam;
    /// assert_eq!(Adam::new(1e-3).steps(), 0);
    /// ```
    pub fn new(rate: f64) -> Self {
        Self {
            rate,
            weight_decay: 0.0,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            settings: Settings::new(),
            steps: 0,
            moments: BTreeMap::new(),
        }
    }

    /// Gives the paths under this prefix a rate of their own; the longest prefix counts.
    ///
    /// ```
    /// use gradreel::optim::Adam;
    /// let optimiser = Adam::new(1e-3).with_rate("net.head", 1e-2);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_rate(mut self, prefix: impl Into<String>, rate: f64) -> Self {
        self.settings.rates.insert(prefix, rate);
        self
    }

    /// Decays all parameters: AdamW.
    ///
    /// ```
    /// use gradreel::optim::Adam;
    /// let optimiser = Adam::new(1e-3).with_weight_decay(1e-4);
    /// # let _ = optimiser;
    /// ```
    #[must_use]
    pub fn with_weight_decay(mut self, decay: f64) -> Self {
        self.weight_decay = decay;
        self
    }

    /// Gives the paths under this prefix a weight decay of their own (0 for biases, say); the longest prefix counts.
    ///
    /// ```
    /// use gradreel::optim::Adam;
    /// let optimiser = Adam::new(1e-3).with_weight_decay_of("net.bias", 0.0);
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
    /// use gradreel::optim::{Adam, Schedule};
    /// let optimiser = Adam::new(1e-3).with_schedule(Schedule::cosine(1000, 0.1));
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
    /// use gradreel::optim::{Adam, Clip};
    /// let optimiser = Adam::new(1e-3).with_clip(Clip::Norm(1.0));
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
    /// use gradreel::optim::{Params, Adam};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Adam::new(0.1);
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
    /// use gradreel::optim::{Params, Adam};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Adam::new(0.1);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// assert!((params.get("x")?.item()? - 3.9).abs() < 1e-6);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::NonFinite`] for a gradient that is not finite, naming its path; [`crate::ErrorKind::Input`] for a
    /// path or a prefix that `params` does not have; [`crate::ErrorKind::Shape`] for a gradient of another shape or dtype than
    /// its parameter. Nothing is changed then.
    pub fn step(&mut self, params: &mut Params, gradients: &BTreeMap<String, Tensor>) -> Result<Update> {
        let gradient_norm = self.settings.check(self.rate, params, gradients)?;
        for path in gradients.keys() {
            check_states(path, self.moments.get(path).map_or(&[], |states| &states[..]), params.get(path)?)?;
        }
        let factor = self.settings.schedule.factor(self.steps);
        self.steps += 1;
        let correction = |beta: f64| 1.0 - beta.powf(self.steps as f64);
        let (c1, c2) = (correction(self.beta1), correction(self.beta2));
        for (path, gradient) in gradients {
            let rate = factor * self.settings.rates.get(path).unwrap_or(&self.rate);
            let decay = self.settings.decays.get(path).unwrap_or(&self.weight_decay);
            let param = params.get_mut(path)?;
            let moments =
                self.moments.entry(path.clone()).or_insert_with(|| std::array::from_fn(|_| zeros_like(param)));
            for_real!(param.dtype(), T => {
                let rule = AdamRule::<T> {
                    clipped: self.settings.clip.for_norm(gradient_norm),
                    betas: [self.beta1, self.beta2].map(T::from_f64),
                    rests: [1.0 - self.beta1, 1.0 - self.beta2].map(T::from_f64),
                    step: T::from_f64(rate / c1),
                    decay: T::from_f64(rate * decay),
                    root: T::from_f64(1.0 / c2.sqrt()),
                    epsilon: T::from_f64(self.epsilon),
                };
                update(rule, param, gradient, moments)?;
            });
        }
        Ok(Update { step: self.steps, rate: factor * self.rate, gradient_norm })
    }

    /// Adds the moments (`optimizer.adam.m.<path>`, `optimizer.adam.v.<path>`) and the number of updates (metadata
    /// `optimizer.adam.step`) to a file. Rates, decays and schedule are the program's to give again.
    ///
    /// ```
    /// use gradreel::optim::{Params, Adam};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Adam::new(0.1);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// optimiser.save(&mut file);
    /// let mut again = Adam::new(0.1);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn save(&self, file: &mut TensorFile) {
        save_states(file, NAME, ["m", "v"], self.steps, &self.moments);
    }

    /// Goes on from a file, bit for bit.
    ///
    /// ```
    /// use gradreel::optim::{Params, Adam};
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("x", Tensor::from_vec(vec![4.0], [1]));
    /// let mut optimiser = Adam::new(0.1);
    /// let gradients = {
    ///     let tape = Tape::new();
    ///     let bound = params.bind(&tape);
    ///     bound.gradients(&bound.get("x")?.square().backward()?)?
    /// };
    /// optimiser.step(&mut params, &gradients)?;
    /// let mut file = gradreel::io::TensorFile::default();
    /// optimiser.save(&mut file);
    /// let mut again = Adam::new(0.1);
    /// again.restore(&file)?;
    /// assert_eq!(again.steps(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Input`] when the state is missing or incomplete; nothing is changed then.
    pub fn restore(&mut self, file: &TensorFile) -> Result<()> {
        (self.steps, self.moments) = restore_states(file, NAME, ["m", "v"])?;
        Ok(())
    }

    /// Whether a file holds a state.
    ///
    /// ```
    /// use gradreel::{io::TensorFile, optim::Adam};
    /// assert!(!Adam::is_saved_in(&TensorFile::default()));
    /// ```
    pub fn is_saved_in(file: &TensorFile) -> bool {
        file.metadata.contains_key(&format!("optimizer.{NAME}.step"))
    }
}

const NAME: &str = "adam";

#[derive(Clone, Copy)]
struct AdamRule<T> {
    clipped: Clipped<T>,
    betas: [T; 2],
    rests: [T; 2],
    step: T,
    decay: T,
    root: T,
    epsilon: T,
}

impl<T: Real> Rule<T, 2> for AdamRule<T> {
    #[inline(always)]
    fn update(self, x: T, gradient: T, [m, v]: [T; 2]) -> (T, [T; 2]) {
        let g = self.clipped.of(gradient);
        let m = self.betas[0] * m + self.rests[0] * g;
        let v = self.betas[1] * v + self.rests[1] * (g * g);
        let move_by = self.step * m / (v.sqrt() * self.root + self.epsilon) + self.decay * x;
        (x - move_by, [m, v])
    }
}
