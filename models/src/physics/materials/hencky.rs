//! Hencky strain and its stress, shared by the plastic laws.

use gradreel::scalar::{Principal, Scalar, Vec3};

/// Lower bound of stretches, so that the logarithm stays finite for crushed or inverted particles.
pub(super) const LEAST_STRETCH: f64 = 0.05;

/// Added to squared norms, so that their roots are differentiable at 0.
const NORM_FLOOR: f64 = 1e-8;

/// Hencky strain in principal axes: `ε = ln max(σ, 0.05)`.
pub(super) fn strain(principal: Principal) -> Vec3 {
    principal.stretches().map(|stretch| stretch.max(LEAST_STRETCH).ln())
}

/// `Σ ε`
pub(super) fn sum(v: Vec3) -> Scalar {
    v[0] + v[1] + v[2]
}

/// `√(v · v + 1e-8)`
pub(super) fn norm(v: Vec3) -> Scalar {
    (v.norm_squared() + NORM_FLOOR).sqrt()
}

/// The mean `m`, and the deviator `ε − m`.
pub(super) fn split(strain: Vec3) -> (Scalar, Vec3) {
    let mean = sum(strain) * (1.0 / 3.0);
    (mean, strain.map(|e| e - mean))
}

/// The principal Kirchhoff stress `2μ ε + λ Σε` \[Pa\].
pub(super) fn stress(strain: Vec3, mu: Scalar, lambda: Scalar) -> Vec3 {
    let pressure = lambda * sum(strain);
    strain.map(|e| 2.0 * mu * e + pressure)
}

/// P-wave speed: `√((λ + 2μ)/ρ)`.
pub(super) fn pressure_wave((mu, lambda): (f64, f64), density: f64) -> f64 {
    ((lambda + 2.0 * mu) / density).sqrt()
}
