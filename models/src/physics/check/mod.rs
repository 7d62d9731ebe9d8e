//! Checks of materials, shipped or custom.

mod curves;
mod drop;
mod energy;
mod gradient;
mod response;
mod speed;
mod wgsl;

use std::fmt;

use gradreel::Result;

pub use curves::{Response, responses};
pub use speed::{rollout_times, speed};

use super::law::Law;

/// Checks a material at the initial values of its parameters:
///
/// - no stress at rest;
/// - frame indifference: the stress of a rotated body is the rotated stress;
/// - the generated derivatives of projection and stress with respect to deformation, velocity gradient, parameters and
///   history, against central differences: at rest, for coinciding stretches, on both sides of the yield surface (found
///   by search), and under large stretch. At a kink either one-sided derivative is accepted;
/// - symmetry of the stress, and for elastic laws no work in a closed cycle of deformation (unless the law says that it has
///   no energy: [`Material::stores_energy`](super::Material::stores_energy));
/// - the declared speed of sound against that of the stress at rest, which it must reach;
/// - inverted input: finite, or NaN if the material declares so ([`Material::survives_inversion`](super::Material));
/// - a block dropped on frictionless ground for two seconds of simulated time: mass and momentum balance in every
///   substep, horizontal momentum is conserved, the ground never pulls;
/// - the scalar program in WGSL against the CPU, values and derivative; skipped without a GPU.
///
/// ```
/// use gradreel_models::physics::{check_material, materials};
///
/// let report = check_material(&materials::find("neo_hookean").unwrap())?;
/// println!("{report}");
/// assert!(report.passed());
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// Propagates errors of the tape when a GPU is present but fails.
pub fn check_material(law: &Law) -> Result<MaterialReport> {
    let mut checks = response::checks(law);
    checks.push(energy::check(law));
    checks.push(speed::wave_speed(law));
    checks.extend(drop::checks(law));
    checks.push(wgsl::check(law)?);
    Ok(MaterialReport { material: law.name().to_owned(), checks })
}

/// The outcome of [`check_material`]; its `Display` is a table.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialReport {
    /// The material's name.
    pub material: String,
    /// The checks, in order.
    pub checks: Vec<MaterialCheck>,
}

/// One line of a [`MaterialReport`].
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialCheck {
    /// The name of the check.
    pub name: &'static str,
    /// The deviation, relative to the natural scale of the quantity.
    pub found: f64,
    /// The allowed deviation.
    pub allowed: f64,
    /// Where the largest deviation occurred, or why the check was skipped.
    pub note: String,
}

impl MaterialCheck {
    /// A skipped check, with the reason.
    fn skipped(name: &'static str, why: impl Into<String>) -> Self {
        Self { name, found: 0.0, allowed: f64::INFINITY, note: why.into() }
    }

    /// Whether the check was skipped.
    pub fn is_skipped(&self) -> bool {
        self.allowed == f64::INFINITY
    }

    /// Whether the check passed or was skipped. NaN is a failure.
    pub fn passed(&self) -> bool {
        self.found <= self.allowed
    }
}

impl MaterialReport {
    /// Whether no check failed.
    pub fn passed(&self) -> bool {
        self.checks.iter().all(MaterialCheck::passed)
    }
}

impl fmt::Display for MaterialReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.material)?;
        for check in &self.checks {
            let MaterialCheck { name, found, allowed, note } = check;
            if check.is_skipped() {
                writeln!(f, "  {name:<42} {:>9} {:>9}  skipped  {note}", "-", "-")?;
            } else {
                let verdict = if check.passed() { "ok" } else { "FAIL" };
                writeln!(f, "  {name:<42} {found:>9.1e} {allowed:>9.1e}  {verdict:<7}  {note}")?;
            }
        }
        Ok(())
    }
}
