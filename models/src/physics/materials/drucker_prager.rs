//! Sand: granular material with friction, with or without cohesion.

use gradreel::scalar::{Mat3, Scalar};

use super::hencky;
use super::von_mises::elastic;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// Granular material after Drucker and Prager.
///
/// With Hencky strain `ε` of the trial deformation (as in [`VonMises`](super::VonMises)) and `T = Σε − 3c`: in
/// expansion (`T ≥ 0`) the grains separate, `ε′ = c (1, 1, 1)`; otherwise, with `‖ε̂‖ = √(ε̂·ε̂ + 1e-8)` and
/// `δγ = ‖ε̂‖ + (3λ + 2μ)/(2μ) T α`, the shear strain is limited by friction: `ε′ = ε − max(δγ, 0)/‖ε̂‖ ε̂`.
/// `α = √(2/3) · 2 sin φ/(3 − sin φ)`. Parameters: Young's modulus `E` \[Pa\], Poisson's ratio `ν`, friction angle `φ`
/// \[degrees\], cohesion `c`, the strain at which the material separates under tension. Source: Klár et al.,
/// *Drucker–Prager Elastoplasticity for Sand Animation*, 2016.
#[derive(Debug, Clone, Copy, Default)]
pub struct DruckerPrager;

impl DruckerPrager {
    /// The friction coefficient `α` of a friction angle \[degrees\].
    pub fn friction(angle: Scalar) -> Scalar {
        let sine = (angle * (std::f64::consts::PI / 180.0)).sin();
        (8.0_f64 / 3.0).sqrt() * sine / (3.0 - sine)
    }
}

impl Material for DruckerPrager {
    fn name(&self) -> &str {
        "drucker_prager"
    }

    fn parameters(&self) -> Vec<Parameter> {
        let friction = Parameter::bounded("friction_angle", "φ", "deg", [0.0, 90.0], [10.0, 50.0]);
        let cohesion = Parameter::linear("cohesion", "c", "-", 0.0, [0.0, 0.01]);
        Parameter::elastic().into_iter().chain([friction, cohesion]).collect()
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        let (friction, cohesion) = (Self::friction(given["friction_angle"]), given["cohesion"]);
        let principal = trial.f.principal();
        let strain = hencky::strain(principal);
        let (mean, deviator) = hencky::split(strain);
        let expansion = hencky::sum(strain) - 3.0 * cohesion;
        let length = hencky::norm(deviator);
        let slip = length + (3.0 * lambda + 2.0 * mu) / (2.0 * mu) * expansion * friction;
        let kept = 1.0 - slip.max(0.0) / length;
        let apart = expansion.ge(0.0);
        Some(principal.two_point(deviator.map(|e| apart.select(cohesion, e * kept + mean).exp())))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        elastic(point, mu, lambda)
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        hencky::pressure_wave(lame(values[0], values[1]), density)
    }
}
