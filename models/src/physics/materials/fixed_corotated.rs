//! Fixed corotated solid.

use gradreel::scalar::Mat3;

use super::hencky::pressure_wave;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// An elastic solid with stress linear in the stretches, which survives inversion.
///
/// Kirchhoff stress `τ = U diag(2μ (σ − 1) σ + λ (J − 1) J) Uᵀ` \[Pa\], that is `2μ (F − R) Fᵀ + λ (J − 1) J I` with
/// the rotation `R = U Vᵀ`, `J = σ₀ σ₁ σ₂`, and Lamé's `μ`, `λ` from Young's modulus `E` \[Pa\] and Poisson's ratio
/// `ν`. No return map. Source: Stomakhin et al., *Energetically Consistent Invertible Elasticity*, 2012.
#[derive(Debug, Clone, Copy)]
pub struct FixedCorotated;

impl Material for FixedCorotated {
    fn name(&self) -> &str {
        "fixed_corotated"
    }

    fn parameters(&self) -> Vec<Parameter> {
        Parameter::elastic().to_vec()
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        let principal = point.f.principal();
        let s = principal.stretches();
        let j = s[0] * s[1] * s[2];
        let pressure = lambda * (j - 1.0) * j;
        principal.left(s.map(|s| 2.0 * mu * (s - 1.0) * s + pressure))
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        pressure_wave(lame(values[0], values[1]), density)
    }
}
