//! The error budget: the scales of the covariance, from a file that a command writes.

use std::sync::LazyLock;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

/// What errs together, and by how much: `error_budget.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ErrorBudget {
    /// Independent residuals a picture.
    pub residuals: f64,
    /// Clips of which discrepancies are larger.
    pub outliers: Outliers,
    /// What a simulation gets wrong.
    pub discrepancy: Discrepancy,
}

/// A share of all clips, and how many times as large their discrepancies are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Outliers {
    pub share: f64,
    pub times: f64,
}

/// Standard deviations for a grid of which one cell is as wide as the body; in proportion to the width of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Discrepancy {
    /// Of a modulus, yield stress or viscosity, whatever its value \[decades\].
    pub magnitude: f64,
    /// Of a strain.
    pub strain: f64,
    /// Of a stress, as a share of the impact's pressure.
    pub stress: f64,
    /// Of a viscosity, in units of density times velocity times grid spacing; for any grid.
    pub viscosity: f64,
    /// Of other parameters, as a share of the plausible range.
    pub share: f64,
    /// Of how far an impact compresses a body, `ρv²/κ`.
    pub compression: f64,
    /// Of a velocity \[cells in the time from the first frame to the last\].
    pub velocity: f64,
}

impl Discrepancy {
    /// All scales so many times as large.
    pub fn times(&self, times: f64) -> Self {
        let Self { magnitude, strain, stress, viscosity, share, compression, velocity } = *self;
        Self {
            magnitude: times * magnitude,
            strain: times * strain,
            stress: times * stress,
            viscosity: times * viscosity,
            share: times * share,
            compression: times * compression,
            velocity: times * velocity,
        }
    }
}

static SHIPPED: LazyLock<ErrorBudget> = LazyLock::new(|| {
    ErrorBudget::parse(include_str!("error_budget.toml")).expect("the shipped error budget is well-formed")
});

impl ErrorBudget {
    /// The budget that was measured on the development clips.
    pub fn shipped() -> Self {
        *SHIPPED
    }

    /// The file of a budget that was measured so.
    pub fn written(&self, measured: &str) -> String {
        let [residuals, share, times, magnitude, strain, stress, viscosity, part, compression, velocity] =
            self.values().map(|(_, value)| format!("{value:.3}"));
        format!(
            "# The scales of the covariance: what errs together, however many pixels say otherwise.\n\
             # Written by `gradreel bench calibrate`. {measured}\n\n\
             # Independent residuals a picture.\n\
             residuals = {residuals}\n\n\
             # A share of all clips whose discrepancies are `times` as large.\n\
             [outliers]\n\
             share = {share}\n\
             times = {times}\n\n\
             # Standard deviations of what a simulation gets wrong, for a grid of which one cell is as wide as the body (the ball of its\n\
             # volume); in proportion to the width of a cell.\n\
             [discrepancy]\n\
             # of a modulus, yield stress or viscosity, whatever its value [decades]\n\
             magnitude = {magnitude}\n\
             # of a strain\n\
             strain = {strain}\n\
             # of a stress, as a share of the impact's pressure\n\
             stress = {stress}\n\
             # of a viscosity, in units of density times velocity times grid spacing, for any grid\n\
             viscosity = {viscosity}\n\
             # of other parameters, as a share of the plausible range\n\
             share = {part}\n\
             # of how far an impact compresses a body, ρv²/κ\n\
             compression = {compression}\n\
             # of a velocity [cells in the time from the first frame to the last]\n\
             velocity = {velocity}\n"
        )
    }

    /// Reads a budget.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for text that is no budget, or numbers that are not positive.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = |found: &dyn std::fmt::Display| {
            Error::new(ErrorKind::Input, "the error budget cannot be read")
                .at("error_budget.toml")
                .found(found)
                .fix("write it again with `gradreel bench calibrate`")
        };
        let budget: Self = toml::from_str(text).map_err(|e| wrong(&e.to_string().trim()))?;
        match budget.values().iter().find(|(_, value)| !(value.is_finite() && **value > 0.0)) {
            Some((name, value)) => Err(wrong(&format!("{name} = {value}"))),
            None => Ok(budget),
        }
    }

    /// All numbers by name.
    pub fn values(&self) -> [(&'static str, &f64); 10] {
        let Discrepancy { magnitude, strain, stress, viscosity, share, compression, velocity } = &self.discrepancy;
        [
            ("residuals", &self.residuals),
            ("outliers.share", &self.outliers.share),
            ("outliers.times", &self.outliers.times),
            ("discrepancy.magnitude", magnitude),
            ("discrepancy.strain", strain),
            ("discrepancy.stress", stress),
            ("discrepancy.viscosity", viscosity),
            ("discrepancy.share", share),
            ("discrepancy.compression", compression),
            ("discrepancy.velocity", velocity),
        ]
    }

    /// The same numbers, to be changed.
    pub fn values_mut(&mut self) -> [&mut f64; 10] {
        let Discrepancy { magnitude, strain, stress, viscosity, share, compression, velocity } = &mut self.discrepancy;
        let Outliers { share: outliers, times } = &mut self.outliers;
        [&mut self.residuals, outliers, times, magnitude, strain, stress, viscosity, share, compression, velocity]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_read_as_it_was_written() {
        let budget = ErrorBudget::shipped();
        assert_eq!(ErrorBudget::parse(&budget.written("By hand.")).unwrap(), budget);
        let zero = budget.written("").replace("times = ", "times = -");
        let error = ErrorBudget::parse(&zero).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains("outliers.times"), "{error}");
    }
}
