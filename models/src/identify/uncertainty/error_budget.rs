//! The error budget: the scales of the covariance, from a file that a command writes.

use std::sync::LazyLock;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::discrepancy::Resolution;

/// What errs together, and by how much: `error_budget.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ErrorBudget {
    /// Independent residuals a picture.
    pub residuals: f64,
    /// Clips of which discrepancies are larger.
    pub outliers: Outliers,
    /// What a simulation gets wrong.
    pub discrepancy: Discrepancy,
    /// What is wrong besides where a single camera saw the body.
    pub one_camera: OneCamera,
}

/// What a single camera leaves open: the side of a body that it does not see.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct OneCamera {
    /// Independent residuals a picture: an error of the shape is in all of them.
    pub residuals: f64,
    /// How coarse a grid would do as much to strains and stresses as the unknown shape \[diameters\].
    pub shape: f64,
    /// Standard deviation of a velocity \[diameters in the time from the first frame to the last\].
    pub velocity: f64,
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

    /// Residuals a picture and discrepancies of a clip, with the width of a cell for which they hold.
    pub fn of(&self, resolution: &Resolution) -> (f64, Discrepancy, Resolution) {
        let Self { residuals, discrepancy, one_camera, .. } = *self;
        if !resolution.one_camera {
            return (residuals, discrepancy, *resolution);
        }
        let dx = resolution.dx.hypot(one_camera.shape * resolution.diameter);
        let of_grid = resolution.dx / dx;
        let velocity = (discrepancy.velocity * of_grid).hypot(one_camera.velocity * resolution.diameter / dx);
        let discrepancy = Discrepancy { velocity, viscosity: discrepancy.viscosity * of_grid, ..discrepancy };
        (one_camera.residuals, discrepancy, Resolution { dx, ..*resolution })
    }

    /// The file of a budget that was measured so.
    pub fn written(&self, measured: &str) -> String {
        let [
            residuals,
            share,
            times,
            magnitude,
            strain,
            stress,
            viscosity,
            part,
            compression,
            velocity,
            own,
            shape,
            speed,
        ] = self.values().map(|(_, value)| format!("{value:.3}"));
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
             velocity = {velocity}\n\n\
             # Of a body that a single camera saw.\n\
             [one_camera]\n\
             # independent residuals a picture\n\
             residuals = {own}\n\
             # how coarse a grid would do as much to strains and stresses as the unknown shape [diameters]\n\
             shape = {shape}\n\
             # of a velocity [diameters in the time from the first frame to the last]\n\
             velocity = {speed}\n"
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
    pub fn values(&self) -> [(&'static str, &f64); 13] {
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
            ("one_camera.residuals", &self.one_camera.residuals),
            ("one_camera.shape", &self.one_camera.shape),
            ("one_camera.velocity", &self.one_camera.velocity),
        ]
    }

    /// The same numbers, to be changed.
    pub fn values_mut(&mut self) -> [&mut f64; 13] {
        let Discrepancy { magnitude, strain, stress, viscosity, share, compression, velocity } = &mut self.discrepancy;
        let Outliers { share: outliers, times } = &mut self.outliers;
        let OneCamera { residuals: own, shape, velocity: speed } = &mut self.one_camera;
        [
            &mut self.residuals,
            outliers,
            times,
            magnitude,
            strain,
            stress,
            viscosity,
            share,
            compression,
            velocity,
            own,
            shape,
            speed,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a single camera leaves open adds to what a grid gets wrong; with several cameras nothing is added.
    #[test]
    fn the_side_that_nobody_saw_counts_for_a_single_camera() {
        let several = Resolution {
            dx: 0.03,
            diameter: 0.2,
            filmed: 0.5,
            impact: 1e3,
            density: 1e3,
            length: 0.0,
            one_camera: false,
        };
        let mut budget = ErrorBudget::shipped();
        budget.one_camera = OneCamera { residuals: 0.02, shape: 0.2, velocity: 0.5 };
        let (residuals, discrepancy, resolution) = budget.of(&several);
        assert_eq!((residuals, discrepancy, resolution), (budget.residuals, budget.discrepancy, several));
        let (residuals, discrepancy, resolution) = budget.of(&Resolution { one_camera: true, ..several });
        assert_eq!(residuals, 0.02);
        approx::assert_relative_eq!(resolution.dx, 0.05, max_relative = 1e-12);
        let wanted = (budget.discrepancy.velocity * 0.03).hypot(0.5 * 0.2);
        approx::assert_relative_eq!(discrepancy.velocity * 0.05, wanted, max_relative = 1e-12);
        approx::assert_relative_eq!(
            discrepancy.viscosity * 0.05,
            budget.discrepancy.viscosity * 0.03,
            max_relative = 1e-12
        );
        assert_eq!(discrepancy.stress, budget.discrepancy.stress);
    }

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
