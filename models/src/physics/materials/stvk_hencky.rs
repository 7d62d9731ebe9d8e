//! Saint Venant–Kirchhoff solid in logarithmic strain.

use gradreel::scalar::Mat3;

use super::hencky;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// An elastic solid with stress linear in the Hencky strain, stiff in compression and soft in extension.
///
/// Kirchhoff stress `τ = U diag(2μ ε + λ Σε) Uᵀ` \[Pa\] with `F = U diag(σ) Vᵀ`, `ε = ln max(σ, 0.05)` and Lamé's `μ`,
/// `λ` from Young's modulus `E` \[Pa\] and Poisson's ratio `ν`. No return map. Source: Hencky 1928; Klár et al.,
/// *Drucker–Prager Elastoplasticity for Sand Animation*, 2016.
#[derive(Debug, Clone, Copy)]
pub struct StvkHencky;

impl Material for StvkHencky {
    fn name(&self) -> &str {
        "stvk_hencky"
    }

    fn parameters(&self) -> Vec<Parameter> {
        Parameter::elastic().to_vec()
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        let principal = point.f.principal();
        principal.left(hencky::stress(hencky::strain(principal), mu, lambda))
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        hencky::pressure_wave(lame(values[0], values[1]), density)
    }
}
