//! Compressible neo-Hookean solid.

use gradreel::scalar::Mat3;

use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// A rubber-like elastic solid.
///
/// Kirchhoff stress `τ = μ F Fᵀ + (λ ln J − μ) I` \[Pa\] with `J = det F` and Lamé's `μ`, `λ` from Young's modulus `E`
/// \[Pa\] and Poisson's ratio `ν`. No projection. For inverted material (`J ≤ 0`) the stress is NaN, which a rollout
/// reports. Source: Jiang et al., *The Material Point Method for Simulating Continuum Materials*, 2016, with the
/// volumetric term in `ln J`.
#[derive(Debug, Clone, Copy)]
pub struct NeoHookean;

impl Material for NeoHookean {
    fn name(&self) -> &str {
        "neo_hookean"
    }

    fn parameters(&self) -> Vec<Parameter> {
        Parameter::elastic().to_vec()
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        let f = point.f;
        (f * f.t()) * mu + Mat3::eye() * (lambda * f.det().ln() - mu)
    }

    /// P-wave speed: `√((λ + 2μ)/ρ)`.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        let (mu, lambda) = lame(values[0], values[1]);
        ((lambda + 2.0 * mu) / density).sqrt()
    }

    fn survives_inversion(&self) -> bool {
        false
    }
}
