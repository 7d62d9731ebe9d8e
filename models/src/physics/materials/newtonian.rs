//! Weakly compressible Newtonian fluid: water and honey.

use gradreel::scalar::{Mat3, Scalar, Vec3};

use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::Parameter;

/// Lower bound of the volume ratio.
const LEAST_VOLUME: f64 = 0.05;

/// A fluid with resistance to compression and viscous shear stress.
///
/// Only the volume ratio `J` is kept, in the deformation gradient as `diag(J, 1, 1)`:
/// `J′ = max((1 + dt tr C) J, 0.05)`. Kirchhoff stress `τ = κ (J − J⁻⁶) I + μ J (C + Cᵀ)/2` \[Pa\] with the velocity
/// gradient `C` at the start of the substep. Parameters: viscosity `μ` \[Pa·s\] and bulk modulus `κ` \[Pa\]. Note the
/// `μ D` where other texts write `2μ D`. Source: Li et al., *PAC-NeRF*, 2023; the equation of state is Cole's with
/// exponent 7.
#[derive(Debug, Clone, Copy, Default)]
pub struct Newtonian;

impl Material for Newtonian {
    fn name(&self) -> &str {
        "newtonian"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::log10("viscosity", "μ", "Pa s", [1e-1, 1e3]),
            Parameter::log10("bulk", "κ", "Pa", [1e3, 1e7]).told_by_compression(7.0),
        ]
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        let volume = (1.0 + given.dt * trial.c.trace()) * trial.previous.det();
        let one = Scalar::from(1.0);
        Some(Mat3::diag(Vec3([volume.max(LEAST_VOLUME), one, one])))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let j = point.f.det();
        let pressure = given["bulk"] * (j - j.powi(-6));
        Mat3::eye() * pressure + point.c.sym() * (given["viscosity"] * j)
    }

    /// Speed of sound at rest: `√(7 κ/ρ)`.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        (7.0 * values[1] / density).sqrt()
    }
}
