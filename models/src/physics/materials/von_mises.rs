//! Plasticine: elastic in logarithmic strain up to von Mises' yield stress, perfectly plastic beyond.

use gradreel::scalar::{Mat3, Scalar, Vec3};

use super::hencky;
use crate::physics::material::{Given, Material, Point};
use crate::physics::parameters::{Parameter, lame};

/// What the yield stress `τ_Y` bounds: a factor of 1.22 in reported values hangs on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum YieldConvention {
    /// `‖s‖ ≤ √(2/3) τ_Y`: `τ_Y` is the stress at yield in a tensile test.
    #[default]
    Tensile,
    /// `‖s‖ ≤ τ_Y`: `τ_Y` is the norm of the deviatoric stress itself.
    Norm,
}

impl YieldConvention {
    /// The norm of the deviatoric stress at yield per `τ_Y`.
    pub fn factor(self) -> f64 {
        match self {
            Self::Tensile => (2.0_f64 / 3.0).sqrt(),
            Self::Norm => 1.0,
        }
    }
}

/// Young's modulus as a multiple of the yield stress, and its standard deviation in decades: solids yield at a strain of half a percent, to a
/// factor of five. Of twelve kinds (steel, aluminium, copper and lead, annealed or not; polyethylene, polypropylene, acrylic, nylon;
/// wax, plasticine, clay) the logarithm of typical values has the mean 2.3 and the standard deviation 0.7.
const STIFF: [f64; 2] = [200.0, 0.7];

/// A solid that keeps its shape until it yields, and then the shape it was given.
///
/// `F_trial = U diag(σ) Vᵀ`, `ε = ln max(σ, 0.05)`, `ε̂ = ε − mean ε`, `s = 2μ ε̂`, `‖s‖ = √(s·s + 1e-8)`. While `‖s‖` is at
/// most the radius `r = √(2/3) τ_Y` (or `τ_Y`, see [`YieldConvention`]) the strain stays; beyond, `ε̂` shrinks by `r/‖s‖`.
/// `F′ = U diag(eᵉ) Vᵀ`, and `τ = U diag(2μ ε + λ Σε) Uᵀ` \[Pa\]. Parameters: Young's modulus `E` \[Pa\], Poisson's ratio `ν`,
/// yield stress `τ_Y` \[Pa\]. Source: Gao et al., *An Adaptive Generalized Interpolation Material Point Method*, 2017;
/// Simo, 1992.
#[derive(Debug, Clone, Copy, Default)]
pub struct VonMises {
    /// What the yield stress bounds.
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

/// The trial deformation brought back to the yield surface of this radius \[Pa\], as far as viscosity lets it:
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

/// Hencky's stress of a projected deformation.
pub(super) fn elastic(point: &Point, mu: Scalar, lambda: Scalar) -> Mat3 {
    let principal = point.f.principal();
    let strain = principal.stretches().map(|stretch| stretch.ln());
    principal.left(hencky::stress(strain, mu, lambda))
}
