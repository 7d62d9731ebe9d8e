//! What all pictures err by alike, however many there are: grid, shape, distance, and what no picture shows.

use gradreel::Result;

use crate::field::bounding_sphere;
use crate::identify::config::WorldConfig;
use crate::identify::reconstruct::{MATERIAL, Stages};
use crate::identify::run::Run;
use crate::identify::stages::{AS_IT_IS, COARSE, THIN};
use crate::identify::unknowns::Unknown;
use crate::identify::{Free, Unknowns};
use crate::physics::Map;

impl Stages<'_> {
    /// What all pictures have in common, each cause a column of deviations of the free unknowns' coordinates that go together: the grid's
    /// error, estimated from that of one of twice the spacing; the shape's, from a thinner body, and from what it was before the whole motion
    /// was known; the material's share of the motion's, from the one with the velocity of the fall; that of lengths, with which velocities and
    /// moduli grow; that of the search, which may have gone to the wrong end. What remains is each unknown's own: what a grid may change of
    /// a modulus or viscosity that stayed by chance (at least half the root mean square of those of all), that of a simulation which is not
    /// nature's, and that of outlines.
    pub(super) fn bias(&self, run: &Run, free: Free, fitted: &Unknowns) -> Result<Vec<Vec<f64>>> {
        let (here, list) = (fitted.coordinates(self.law, free), free.list(self.law));
        let from = |stage: &str| {
            let other = run.best_of(stage).map(|(other, _)| other.coordinates(self.law, free));
            let apart = |other: Vec<f64>| other.iter().zip(&here).map(|(a, b)| a - b).collect::<Vec<_>>();
            let mut apart = other.map_or_else(|| vec![0.0; here.len()], apart);
            apart
                .iter_mut()
                .zip(&list)
                .filter(|(_, unknown)| **unknown == Unknown::Contact)
                .for_each(|(x, _)| *x = 0.0);
            apart
        };
        let flight = self.clip.flight.as_ref();
        let (grid, thin, shape) = (from(COARSE), from(THIN), from(self.fitted(run)));
        let end = self.other_end_error(run, free, &here);
        // the pictures tell of the depth, too: a loss that rises by all that it was makes its error less by a factor of √2
        let [thick_loss, thin_loss] = [AS_IT_IS, THIN].map(|stage| run.best_of(stage).map_or(0.0, |(_, loss)| loss));
        let doubt = if thin_loss > thick_loss { (thick_loss / thin_loss).sqrt() } else { 1.0 };
        let depth = thin.iter().map(|x| doubt * x).collect();
        let first = if flight.is_some() { from(MATERIAL) } else { vec![0.0; here.len()] };
        let share = |k: usize| if matches!(list[k], Unknown::Velocity(_)) { SPEED_GRID_ERROR } else { GRID_ERROR };
        // of several moduli, one may stay by chance where the others move
        let magnitudes =
            || list.iter().zip(&grid).filter(|(unknown, _)| self.is_magnitude(**unknown)).map(|(_, x)| x * x);
        let typical = (magnitudes().sum::<f64>() / magnitudes().count().max(1) as f64).sqrt();
        let length = match flight {
            Some(_) if free.distance() => DISTANCE_ERROR,
            flight => flight.map_or(0.0, |flight| flight.deviation),
        };
        let impact = self.impact(run, fitted);
        let lasts = run.state.contact.unwrap_or(1).max(1) as f64 * self.observed.frame_dt;
        let filmed = self.observed.targets.len().saturating_sub(1).max(1) as f64 * self.observed.frame_dt;
        let of_outlines = OUTLINE_ERROR * 2.0 * self.spacing / lasts;
        let radius = bounding_sphere(self.clip, 0)?.radius;
        let of_depth = DEPTH_ERROR * 2.0 * self.spacing / filmed;
        let slope = |k: usize| fitted.slope(self.law, list[k]);
        let of_length = |k: usize| match list[k] {
            Unknown::DISTANCE => length,
            Unknown::Velocity(axis) => length * fitted.velocity[axis] / slope(k),
            // stress and viscosity, for a given density and time, are as the square of a length
            Unknown::Parameter(p) if self.is_magnitude(list[k]) && self.law.parameters()[p].unit.starts_with("Pa") => {
                2.0 * length / std::f64::consts::LN_10
            }
            Unknown::Parameter(_) | Unknown::Contact | Unknown::Lean(_) | Unknown::Spin(_) => 0.0,
        };
        let alone = |k: usize| match list[k] {
            Unknown::Contact | Unknown::Lean(_) => 0.0,
            Unknown::Spin(_) => of_outlines / radius / slope(k).abs(),
            Unknown::Velocity(_) => (if flight.is_some() { of_depth } else { of_outlines }) / slope(k).abs(),
            Unknown::Parameter(_) => {
                let least = if self.is_magnitude(list[k]) { CHANCE * typical } else { 0.0 };
                let by_chance = (least * least - grid[k] * grid[k]).max(0.0).sqrt() * GRID_ERROR;
                self.own_error(run, fitted, list[k], impact).hypot(by_chance)
            }
        };
        let all = |of: &dyn Fn(usize) -> f64| (0..list.len()).map(of).collect::<Vec<_>>();
        let of_material = |k: usize| if matches!(list[k], Unknown::Parameter(_)) { first[k] } else { 0.0 };
        let of_grid = all(&|k| share(k) * grid[k]);
        let together = [of_grid, depth, all(&|k| SHAPE_ERROR * shape[k]), all(&of_material), all(&of_length), end];
        let own = (0..list.len()).map(|unknown| all(&|k| if k == unknown { alone(k) } else { 0.0 }));
        Ok(together.into_iter().chain(own).collect())
    }

    /// How far a parameter's coordinate may be off by itself, however many pictures say otherwise: no simulation is right, and losses of
    /// other magnitudes may be much the same.
    pub(super) fn own_error(&self, run: &Run, at: &Unknowns, unknown: Unknown, impact: f64) -> f64 {
        let open = match unknown {
            Unknown::Parameter(p) if self.is_magnitude(unknown) => self.left_open(run, p),
            _ => 0.0,
        };
        self.model_error(at, unknown, impact).hypot(open)
    }

    /// How far a parameter's coordinate is off, whatever the pictures say: no simulation is nature's, and no shape quite right. `impact` is the
    /// pressure of its impact ([`Stages::impact`]).
    fn model_error(&self, at: &Unknowns, unknown: Unknown, impact: f64) -> f64 {
        let Unknown::Parameter(p) = unknown else { return 0.0 };
        let [decades, part] = if self.observed.sight.is_some() { ONE_SIDED } else { [MODEL_ERROR, SHARE_ERROR] };
        let parameter = &self.law.parameters()[p];
        let [low, high] = parameter.prior;
        match (parameter.by_compression.is_some(), self.is_magnitude(unknown)) {
            (true, true) => decades.hypot(of_compression(at.parameters[p], impact).min((high / low).log10())),
            (_, true) => decades,
            (_, false) => part * (high - low) / at.slope(self.law, unknown).abs(),
        }
    }

    /// The pressure `ρ v²` with which the body meets the ground \[Pa\].
    pub(super) fn impact(&self, run: &Run, at: &Unknowns) -> f64 {
        let WorldConfig { density, gravity, .. } = run.config.world;
        let falls = run.state.contact.unwrap_or(0) as f64 * self.observed.frame_dt;
        density * at.velocity.iter().zip(gravity).map(|(v, g)| (v + g * falls).powi(2)).sum::<f64>()
    }

    /// Whether an unknown is told in decades: a modulus, a yield stress, a viscosity.
    fn is_magnitude(&self, unknown: Unknown) -> bool {
        matches!(unknown, Unknown::Parameter(p) if self.law.parameters()[p].map == Map::Log10)
    }
}

/// How many decades lower a bulk modulus may be than was found, for a deviation of what an impact compresses ([`COMPRESSION_ERROR`]): one so large
/// that nothing is compressed is hardly told from a larger one.
fn of_compression(bulk: f64, impact: f64) -> f64 {
    (1.0 + COMPRESSION_ERROR * bulk / impact).log10()
}

/// The error of the full grid as a share of its difference to that of twice the spacing: a third if it falls with the square of the
/// spacing, all of it if it falls with the spacing. Films made on grids of 0.7 times the spacing were off by a quarter of it (a drop's
/// viscosity), a third (a yield stress) and 1.2 of it (a friction angle).
const GRID_ERROR: f64 = 0.75;

/// The same of a velocity, half of which is seen before the ground is.
const SPEED_GRID_ERROR: f64 = 0.5;

/// What the grid changes of a modulus or viscosity counts at least as this share of the root mean square of what it changes of all: a lump's
/// modulus stayed where it was by chance, and was off by 0.12 decades, as its yield stress changed by 0.39.
const CHANCE: f64 = 0.5;

/// Deviation of a modulus or viscosity in decades, from one simulator to another: what was found in clips of an independent one was
/// off by 0.01 to 0.06, whatever the pictures said.
const MODEL_ERROR: f64 = 0.03;

/// The same of what is no magnitude, as a share of the plausible range: Poisson's ratios were off by 0.03 to 0.05, angles by 3 degrees.
const SHARE_ERROR: f64 = 0.08;

/// Both of a body that a single camera saw, whose far side is made up: moduli were off by 0.04 to 0.2 decades, a yield stress by 0.3,
/// and Poisson's ratios by 0.2 to 0.3 before they were weighed, whatever a thinner body or the motion said.
const ONE_SIDED: [f64; 2] = [0.15, 0.5];

/// Deviation of where the outlines say that the object is, from the first frame of its flight to the last, in grid cells: a part of
/// what the silhouettes are too wide or narrow is alike in all cameras.
const OUTLINE_ERROR: f64 = 0.1;

/// Deviation of how much nearer a single camera sees an object come than it does, from the first frame to the last, in grid cells: what
/// fitted best of bird and dumbbell was off by 1.7 and 1.5, and bodies on coarser grids by more.
const DEPTH_ERROR: f64 = 2.0;

/// Deviation of the distance that a single camera's pictures tell together with the ground, as a share: in seven films it was off by 2 to 12 %
/// (a ring 12, sand 8, a block 7, a dumbbell 5, liquids 3, a bird 2), 6.5 in the root mean square.
const DISTANCE_ERROR: f64 = 0.06;

/// The error of the shape as a share of what its last improvement did.
const SHAPE_ERROR: f64 = 0.5;

/// Deviation of how far a body is compressed, `ρ v²/κ`. Bulk moduli found in ten films of fluids and pastes were off by 0.7 decades at most, to
/// both sides, but `ρ v²/κ` by 0.000 to 0.019 in all of them, 0.011 in the root mean square: about what the volume of a shape is off by.
const COMPRESSION_ERROR: f64 = 0.015;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_hardly_compressed_has_a_bulk_modulus_that_is_hardly_known() {
        // found at 200 kPa by an impact of 5 kPa: compressed by 0.025 ± 0.015, and so 125 kPa at 0.040
        approx::assert_relative_eq!(2e5 / 10f64.powf(of_compression(2e5, 5e3)), 125e3, max_relative = 1e-12);
        // the stiffest says as much as any stiff one: 333 kPa at 0.015
        approx::assert_relative_eq!(1e12 / 10f64.powf(of_compression(1e12, 5e3)), 333e3, max_relative = 2e-3);
    }
}
