//! A neural constitutive law, learned from motion.

use std::sync::{Arc, LazyLock};

use gradreel::scalar::{Mat3, Scalar};
use gradreel::{Tensor, ops::uniform};

use crate::physics::material::{Given, History, Material, Point};
use crate::physics::parameters::Parameter;

/// Number of invariants that the network takes.
const INVARIANTS: usize = 3;
/// Number of response coefficients that it returns.
const RESPONSES: usize = 2;
/// Largest number of hidden units.
pub const WIDEST: usize = 16;
/// Lower bound of the volume ratio.
const LEAST_VOLUME: f64 = 0.05;

/// Names of the weights, for any number of hidden units.
static NAMES: LazyLock<Vec<&'static str>> =
    LazyLock::new(|| (0..count(WIDEST)).map(|n| &*Box::leak(format!("w{n}").into_boxed_str())).collect());

const fn count(hidden: usize) -> usize {
    (INVARIANTS + 1) * hidden + (hidden + 1) * RESPONSES
}

/// A neural constitutive law: invariants → one hidden layer of `tanh` → response coefficients → stress.
///
/// With `J = det F` (at least 0.05) and `b̄ = J^(−2/3) F Fᵀ`, the network takes `ln J`, `½ (tr b̄ − 3)` and
/// `¼ (tr b̄² − 3)` and returns `a₀`, `a₁`. Alone, the law is `τ = S (softplus(a₁) dev b̄ + softplus(a₀) ln J I)`: for
/// any weights it is isotropic, frame-indifferent and stress-free at rest, and resists shear and compression. As a
/// residual it adds `S (a₁ dev b̄ + a₀ ln J I)`, initially zero, to the stress of another law. `S` is a fixed scale
/// \[Pa\]. The weights are ordinary parameters: `w0 …`, first layer (hidden × 3) with its biases, then second (2 ×
/// hidden) with its biases.
///
/// Source: Ma et al., *Learning Neural Constitutive Laws From Motion Observations*, 2023; Cao et al., *NeuMA*, 2024.
#[derive(Debug, Clone)]
pub struct Learned {
    name: String,
    base: Option<Arc<dyn Material>>,
    hidden: usize,
    scale: f64,
    start: Vec<f64>,
}

impl Learned {
    /// A purely neural law with `hidden` units and stresses of the order of `scale` \[Pa\]; `seed` determines the
    /// initial weights.
    ///
    /// # Panics
    ///
    /// If there are no units or more than 16, or the scale is not positive.
    #[track_caller]
    pub fn alone(hidden: usize, scale: f64, seed: u64) -> Self {
        Self::new("learned".to_owned(), None, hidden, scale, seed)
    }

    /// A correction of the stress of another law, whose projection and history are kept. The parameters are those of
    /// `base`, then the weights.
    ///
    /// # Panics
    ///
    /// As [`Learned::alone`].
    #[track_caller]
    pub fn residual(base: impl Material, hidden: usize, scale: f64, seed: u64) -> Self {
        Self::new(format!("learned_{}", base.name()), Some(Arc::new(base)), hidden, scale, seed)
    }

    #[track_caller]
    fn new(name: String, base: Option<Arc<dyn Material>>, hidden: usize, scale: f64, seed: u64) -> Self {
        assert!((1..=WIDEST).contains(&hidden), "learned: {hidden} hidden units, 1 to {WIDEST} wanted");
        assert!(scale > 0.0 && scale.is_finite(), "learned: a scale of {scale} Pa");
        let noise: Tensor = uniform(seed, [count(hidden)], -1.0..1.0);
        let second = (INVARIANTS + 1) * hidden;
        let reach = |n: usize| match n {
            _ if n < INVARIANTS * hidden => 1.0,
            // a residual starts at zero, but with a nonzero gradient
            _ if n < second => 0.1,
            _ if base.is_some() => 0.0,
            _ => 0.3,
        };
        let start = noise.slice::<f64>().iter().enumerate().map(|(n, x)| x * reach(n)).collect();
        Self { name, base, hidden, scale, start }
    }

    /// Number of weights, which are the last parameters.
    pub fn weights(&self) -> usize {
        count(self.hidden)
    }

    fn respond<S>(
        &self,
        invariants: [S; INVARIANTS],
        weight: impl Fn(usize) -> S,
        tanh: impl Fn(S) -> S,
    ) -> [S; RESPONSES]
    where
        S: Copy + std::ops::Add<Output = S> + std::ops::Mul<Output = S>,
    {
        let (h, second) = (self.hidden, (INVARIANTS + 1) * self.hidden);
        let mut found = [0, 1].map(|r| weight(second + RESPONSES * h + r));
        for unit in 0..h {
            let mut sum = weight(INVARIANTS * h + unit);
            for (i, x) in invariants.into_iter().enumerate() {
                sum = sum + weight(INVARIANTS * unit + i) * x;
            }
            let active = tanh(sum);
            for (r, found) in found.iter_mut().enumerate() {
                *found = *found + weight(second + r * h + unit) * active;
            }
        }
        found
    }
}

impl Material for Learned {
    fn name(&self) -> &str {
        &self.name
    }

    fn parameters(&self) -> Vec<Parameter> {
        let base = self.base.iter().flat_map(|base| base.parameters());
        let weights = self.start.iter().zip(NAMES.iter());
        base.chain(weights.map(|(&start, &name)| Parameter::linear(name, name, "-", start, [-3.0, 3.0]))).collect()
    }

    fn history(&self) -> Vec<History> {
        self.base.as_ref().map_or_else(Vec::new, |base| base.history())
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        self.base.as_ref()?.return_map(trial, given)
    }

    fn evolve(&self, trial: &Point, given: &Given) -> Vec<Scalar> {
        self.base.as_ref().map_or_else(Vec::new, |base| base.evolve(trial, given))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let log_j = point.f.det().max(LEAST_VOLUME).ln();
        let b = (point.f * point.f.t()) * (log_j * (-2.0 / 3.0)).exp();
        let invariants = [log_j, (b.trace() - 3.0) * 0.5, (b.ddot(b) - 3.0) * 0.25];
        let [volume, shear] = self.respond(invariants, |n| given[NAMES[n]], Scalar::tanh);
        let response = |volume: Scalar, shear: Scalar| (b.dev() * shear + Mat3::eye() * (volume * log_j)) * self.scale;
        match &self.base {
            None => response(volume.softplus(), shear.softplus()),
            Some(base) => base.stress(point, given) + response(volume, shear),
        }
    }

    /// P-wave speed at rest, where the moduli are `S a₁` (shear) and `S a₀` (bulk), plus those of the base.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        let (base_values, weights) = values.split_at(values.len() - self.weights());
        let [volume, shear] = self.respond([0.0; INVARIANTS], |n| weights[n], f64::tanh);
        let modulus = |volume: f64, shear: f64| self.scale * (volume + 4.0 / 3.0 * shear);
        let softplus = |x: f64| x.max(0.0) + (-x.abs()).exp().ln_1p();
        match &self.base {
            None => (modulus(softplus(volume), softplus(shear)) / density).sqrt(),
            Some(base) => {
                let square = base.wave_speed(base_values, density).powi(2);
                (square + modulus(volume.max(0.0), shear.max(0.0)) / density).sqrt()
            }
        }
    }

    /// The responses are any functions of the invariants.
    fn stores_energy(&self) -> bool {
        false
    }

    fn survives_inversion(&self) -> bool {
        self.base.as_ref().is_none_or(|base| base.survives_inversion())
    }
}
