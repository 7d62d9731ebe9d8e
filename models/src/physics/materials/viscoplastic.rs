//! Non-Newtonian fluid, such as toothpaste or cream: rate-dependent flow beyond a yield stress.

use gradreel::scalar::Mat3;

use super::hencky;
use super::von_mises::{YieldConvention, elastic, project};
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::Parameter;

/// Prior of the shear modulus: multiple of the yield stress, and standard deviation in decades. Soft matter yields at a
/// shear strain of about 0.06 within a factor of three (microgels and foams 0.2 to 0.4, mayonnaise and whipped cream
/// near 0.1, toothpaste and muds 0.02 to 0.1); `τ_Y` is √3 times the yield stress in shear.
const STIFF: [f64; 2] = [10.0, 0.5];

/// A viscoplastic (Bingham) material.
///
/// As [`VonMises`](super::VonMises), but the stress relaxes to the yield surface over time:
/// `‖s‖′ = ‖s‖ − (‖s‖ − r)/(1 + η/(2 μ̂ dt))` with `μ̂ = μ (Σσ²)/3`. Parameters: shear modulus `μ` \[Pa\], bulk modulus
/// `κ` \[Pa\] (`λ = κ − 2μ/3`), yield stress `τ_Y` \[Pa\], plastic viscosity `η` \[Pa·s\]. Source: Yue et al.,
/// *Continuum Foam*, 2015.
#[derive(Debug, Clone, Copy, Default)]
pub struct Viscoplastic {
    /// The definition of the yield stress.
    pub convention: YieldConvention,
}

impl Material for Viscoplastic {
    fn name(&self) -> &str {
        "viscoplastic"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::log10("shear", "μ", "Pa", [1e2, 1e6]).usually_times("yield_stress", STIFF[0], STIFF[1]),
            Parameter::log10("bulk", "κ", "Pa", [1e3, 1e7]).told_by_compression(1.0),
            Parameter::log10("yield_stress", "τ_Y", "Pa", [1e1, 1e5]),
            Parameter::log10("plastic_viscosity", "η", "Pa s", [1e-1, 1e3]),
        ]
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        let (mu, dt) = (given["shear"], given.dt);
        let radius = given["yield_stress"] * self.convention.factor();
        Some(project(trial, mu, radius, |stretches| {
            let mu_hat = mu * stretches.norm_squared() * (1.0 / 3.0);
            given["plastic_viscosity"] / (2.0 * mu_hat * dt)
        }))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, bulk) = (given["shear"], given["bulk"]);
        elastic(point, mu, bulk - mu * (2.0 / 3.0))
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        hencky::pressure_wave((values[0], values[1] - 2.0 / 3.0 * values[0]), density)
    }
}
