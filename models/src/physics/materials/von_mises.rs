//! Plasticine: elastic in Hencky strain up to the von Mises yield stress, perfectly plastic beyond.

use gradreel::scalar::{Mat3, Scalar, Vec3};

use super::hencky;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// The definition of the yield stress `τ_Y`; the two differ by a factor of √(3/2) ≈ 1.22.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum YieldConvention {
    /// `‖s‖ ≤ √(2/3) τ_Y`: `τ_Y` is the yield stress of a tensile test.
    #[default]
    Tensile,
    /// `‖s‖ ≤ τ_Y`: `τ_Y` bounds the norm of the deviatoric stress.
    Norm,
}

impl YieldConvention {
    /// The norm of the deviatoric stress at yield, divided by `τ_Y`.
    pub fn factor(self) -> f64 {
        match self {
            Self::Tensile => (2.0_f64 / 3.0).sqrt(),
            Self::Norm => 1.0,
        }
    }
}

/// Prior of Young's modulus: multiple of the yield stress, and standard deviation in decades. Solids yield at a strain
/// of half a percent, within a factor of five: mean and deviation of the logarithm over typical values of steel,
/// aluminium, copper and lead (annealed or not), polyethylene, polypropylene, acrylic, nylon, wax, plasticine and clay.
const STIFF: [f64; 2] = [200.0, 0.7];

/// An elastic solid that yields and keeps its plastic deformation.
///
/// `F_trial = U diag(σ) Vᵀ`, `ε = ln max(σ, 0.05)`, `ε̂ = ε − mean ε`, `s = 2μ ε̂`, `‖s‖ = √(s·s + 1e-8)`. Up to the
/// radius `r = √(2/3) τ_Y` (or `τ_Y`, see [`YieldConvention`]) the strain is unchanged; beyond, `ε̂` is scaled by
/// `r/‖s‖`. `F′ = U diag(eᵉ) Vᵀ`, and `τ = U diag(2μ ε + λ Σε) Uᵀ` \[Pa\]. Parameters: Young's modulus `E` \[Pa\],
/// Poisson's ratio `ν`, yield stress `τ_Y` \[Pa\]. Source: Gao et al., *An Adaptive Generalized Interpolation Material
/// Point Method*, 2017; Simo, 1992.
#[derive(Debug, Clone, Copy, Default)]
pub struct VonMises {
    /// The definition of the yield stress.
    pub convention: YieldConvention,
}

impl Material for VonMises {
    fn name(&self) -> &str {
        "von_mises"
    }

    fn parameters(&self) -> Vec<Parameter> {
        let yield_stress = Parameter::log10("yield_stress", "τ_Y", "Pa", [1e2, 1e6]);
        let [young, poisson] = Parameter::elastic();
        vec![young.usually_times("yield_stress", STIFF[0], STIFF[1]), poisson, yield_stress]
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        let (mu, _) = lame(given["young"], given["poisson"]);
        let radius = given["yield_stress"] * self.convention.factor();
        Some(project(trial, mu, radius, |_| 0.0.into()))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (mu, lambda) = lame(given["young"], given["poisson"]);
        elastic(point, mu, lambda)
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        hencky::pressure_wave(lame(values[0], values[1]), density)
    }
}

/// Projects the trial deformation towards the yield surface of this radius \[Pa\], delayed by viscosity:
/// `‖s‖′ = ‖s‖ − (‖s‖ − r)/(1 + slowness)`. The slowness is a function of the stretches.
pub(super) fn project(trial: &Point, mu: Scalar, radius: Scalar, slowness: impl FnOnce(Vec3) -> Scalar) -> Mat3 {
    let principal = trial.f.principal();
    let (mean, deviator) = hencky::split(hencky::strain(principal));
    let length = hencky::norm(deviator.map(|e| 2.0 * mu * e));
    let beyond = length - radius;
    let stretches = principal.stretches().map(|s| s.max(hencky::LEAST_STRETCH));
    let kept = 1.0 - beyond / ((1.0 + slowness(stretches)) * length);
    let kept = beyond.gt(0.0).select(kept, 1.0);
    principal.two_point(deviator.map(|e| (e * kept + mean).exp()))
}

/// The Kirchhoff stress of a projected deformation, linear in the Hencky strain.
pub(super) fn elastic(point: &Point, mu: Scalar, lambda: Scalar) -> Mat3 {
    let principal = point.f.principal();
    let strain = principal.stretches().map(|stretch| stretch.ln());
    principal.left(hencky::stress(strain, mu, lambda))
}
