//! Is this a sound material? A battery of checks for shipped materials and for one's own.

mod drop;
mod gradient;
mod response;
mod wgsl;

use std::fmt;

use gradreel::Result;

use super::law::Law;

/// Puts a material through a battery of checks, at the starting values of its parameters.
///
/// - no stress at rest;
/// - frame indifference: a body turned has the same stress, turned;
/// - the generated derivatives of projection and stress with respect to deformation, velocity gradient, parameters and
///   history against central differences: at rest, where stretches coincide, on both sides of the yield surface (found by
///   search), under large stretch. At a kink the derivative may be that of either side;
/// - inverted input: finite, or NaN if the material says so ([`Material::survives_inversion`](super::Material));
/// - a block dropped on frictionless ground for two seconds of simulated time: mass and momentum balance in every substep,
///   horizontal momentum is kept, the ground never pulls;
/// - the scalar program in WGSL against the CPU, values and derivative; skipped where there is no GPU.
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
/// What the tape returns when a GPU is there but fails.
pub fn check_material(law: &Law) -> Result<MaterialReport> {
    let mut checks = response::checks(law);
    checks.extend(drop::checks(law));
    checks.push(wgsl::check(law)?);
    Ok(MaterialReport { material: law.name().to_owned(), checks })
}

/// The outcome of [`check_material`]; its `Display` is a table.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialReport {
    /// The material's name.
    pub material: String,
    /// What was checked, in order.
    pub checks: Vec<MaterialCheck>,
}

/// One line of a [`MaterialReport`].
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialCheck {
    /// What was checked.
    pub name: &'static str,
    /// How far off it is, relative to what is natural for it.
    pub found: f64,
    /// How far off it may be.
    pub allowed: f64,
    /// Where the largest deviation was, or why the check does not apply.
    pub note: String,
}

impl MaterialCheck {
    /// A check that does not apply, and why.
    fn skipped(name: &'static str, why: impl Into<String>) -> Self {
        Self { name, found: 0.0, allowed: f64::INFINITY, note: why.into() }
    }

    /// Whether it did not apply.
    pub fn is_skipped(&self) -> bool {
        self.allowed == f64::INFINITY
    }

    /// Whether it holds; one that does not apply does. NaN is a failure.
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
