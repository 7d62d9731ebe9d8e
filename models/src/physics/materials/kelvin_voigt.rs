//! Damped rubber: a compressible neo-Hookean solid with a viscous stress beside the elastic one.

use gradreel::scalar::Mat3;

use super::NeoHookean;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// A rubber-like solid that loses energy as it deforms (Kelvin–Voigt).
///
/// Kirchhoff stress `τ = τ₀(F) + t J (2μ D + λ tr D I)` \[Pa\] with the elastic stress `τ₀` of [`NeoHookean`], the rate of
/// deformation `D = (C + Cᵀ)/2` \[1/s\] and one relaxation time `t` \[s\]: for small strains `σ = ℂ : (ε + t ε̇)`. A mode
/// of angular frequency `ω` is damped by the share `ω t/2` of the critical damping, so that restitution falls with
/// stiffness. Parameters: Young's modulus `E` \[Pa\], Poisson's ratio `ν`, relaxation time `t`. Source: Landau and
/// Lifshitz, *Theory of Elasticity*, 1986, §34.
///
/// The prior of the time holds restitutions of 0.2 to 0.9 for contacts of 1 ms to 50 ms: `t = 2ζ T/π` for a contact of
/// half a period `T` with the damping `ζ` of `e = exp(−πζ/√(1 − ζ²))`.
#[derive(Debug, Clone, Copy, Default)]
pub struct KelvinVoigt;

impl Material for KelvinVoigt {
    fn name(&self) -> &str {
        "kelvin_voigt"
    }

    fn parameters(&self) -> Vec<Parameter> {
        let time = Parameter::log10("relaxation_time", "t", "s", [2e-5, 1.5e-2]);
        Parameter::elastic().into_iter().chain([time]).collect()
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        let weight = given["relaxation_time"] * point.f.det();
        let rate = point.c.sym();
        let viscous = rate * (weight * mu * 2.0) + Mat3::eye() * (weight * lambda * rate.trace());
        NeoHookean.stress(point, given) + viscous
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        NeoHookean.wave_speed(&values[..2], density)
    }

    fn relaxation_time(&self, values: &[f64]) -> f64 {
        values[2]
    }

    fn survives_inversion(&self) -> bool {
        false
    }
}
