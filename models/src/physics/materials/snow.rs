//! Snow: elastic within narrow limits, plastic beyond, hardening under compaction.

use gradreel::scalar::{Mat3, Scalar, Vec3};

use crate::physics::material::{Given, History, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// The plastic volume ratio below which hardening no longer increases.
const DENSEST: f64 = 0.6;

/// Lower bound of the plastic volume ratio.
const LEAST_VOLUME: f64 = 0.05;

/// Lower bound of stretches.
const LEAST_STRETCH: f64 = 0.05;

/// Snow after Stomakhin et al.
///
/// Trial stretches are clamped to `[1 − θ_c, 1 + θ_s]`; the remainder goes into the plastic volume ratio, a history
/// variable: `J_P′ = J_P Π σ/Π σ′`. The moduli harden under compaction, `μ = μ₀ h`, `λ = λ₀ h`,
/// `h = exp(ξ (1 − max(J_P, 0.6)))`, and the stress is that of [`FixedCorotated`](super::FixedCorotated):
/// `τ = U diag(2μ (σ − 1) σ + λ (J − 1) J) Uᵀ` \[Pa\]. Parameters: Young's modulus `E` \[Pa\] and Poisson's ratio `ν`
/// before hardening, critical compression `θ_c` and stretch `θ_s`, hardening `ξ`. Source: Stomakhin et al., *A Material
/// Point Method for Snow Simulation*, 2013; the bound 0.6 follows later implementations and limits the stiffness, and
/// thus the number of substeps.
#[derive(Debug, Clone, Copy, Default)]
pub struct Snow;

impl Snow {
    /// The trial stretches, clamped.
    fn clamped(trial: &Point, given: &Given) -> Vec3 {
        let (least, most) = (1.0 - given["critical_compression"], 1.0 + given["critical_stretch"]);
        trial.f.principal().stretches().map(|s| s.max(least).min(most))
    }
}

fn product(v: Vec3) -> Scalar {
    v[0] * v[1] * v[2]
}

impl Material for Snow {
    fn name(&self) -> &str {
        "snow"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::log10("young", "E", "Pa", [1e4, 1e6]),
            Parameter::bounded("poisson", "ν", "-", [-0.45, 0.45], [0.0, 0.4]),
            Parameter::log10("critical_compression", "θ_c", "-", [1e-2, 1e-1]),
            Parameter::log10("critical_stretch", "θ_s", "-", [2e-3, 2e-2]),
            Parameter::bounded("hardening", "ξ", "-", [0.0, 20.0], [5.0, 15.0]),
        ]
    }

    fn history(&self) -> Vec<History> {
        vec![History { name: "plastic_volume", unit: "-", start: 1.0 }]
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        Some(trial.f.principal().two_point(Self::clamped(trial, given)))
    }

    fn evolve(&self, trial: &Point, given: &Given) -> Vec<Scalar> {
        let stretches = trial.f.principal().stretches().map(|s| s.max(LEAST_STRETCH));
        let volume = given["plastic_volume"] * product(stretches) / product(Self::clamped(trial, given));
        vec![volume.max(LEAST_VOLUME)]
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let harder = (given["hardening"] * (1.0 - given["plastic_volume"].max(DENSEST))).exp();
        let (mu, lambda) = lame(given["young"] * harder, given["poisson"]);
        let principal = point.f.principal();
        let s = principal.stretches();
        let j = product(s);
        let pressure = lambda * (j - 1.0) * j;
        principal.left(s.map(|s| 2.0 * mu * (s - 1.0) * s + pressure))
    }

    /// P-wave speed of snow at maximum hardening.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        let (mu, lambda) = lame(values[0] * (values[4] * (1.0 - DENSEST)).exp(), values[1]);
        ((lambda + 2.0 * mu) / density).sqrt()
    }
}
