//! The choice of a finer grid: a grid damps motion within its cells, and clips show on which one a body spreads as it was filmed.

use gradreel::{ErrorKind, Result};

use crate::identify::reconstruct::{MATERIAL, Stages};
use crate::identify::run::Run;
use crate::identify::stages::{Effort, Weighed};
use crate::identify::{Method, Steps, Unknowns};
use crate::physics::Parameter;

/// The stages that look for the material on the full grid and on the finer one, from the same start.
const FULL: &str = "material, full grid";
const FINER: &str = "material, finer grid";

/// The finer grid as a share of the full one. With the same particles, of which 2.7 then share a cell: shape and pictures stay as they are, so
/// that losses can be compared.
const SHARE: f64 = 0.7;

/// By how much an impact compresses what hardly is: an order less than hulls are too large.
const HARDLY: f64 = 0.01;

impl Stages<'_> {
    /// The search for the material from the best of the first searches: on the grid that the clip agrees better with, if the body flows.
    pub fn material(&self, run: &mut Run, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let holds_bulk = self.holds_bulk(run);
        if holds_bulk {
            let bulk = self.bulk(run, unknowns)?;
            let values = unknowns.parameters.iter_mut().zip(self.law.parameters());
            values.filter(|(_, p)| bulk.contains(p)).for_each(|(value, p)| *value = p.usual[0]);
        }
        let spent = self.choose_grid(run, holds_bulk, frames, unknowns)?;
        let steps = run.config.fine_of(self.law);
        let always = steps.always.saturating_sub(spent).max(1);
        let effort = Effort { holds_bulk, ..Effort::new(MATERIAL, Steps { always, ..steps }) };
        self.fine(run, &effort, frames, unknowns)
    }

    /// Whether what only compression tells waits for the shape to be fitted to the whole motion: until then a body is up to 7 % too large, as
    /// hulls are, and one that is soft enough makes up for it. A block of tar had come to be a hundredth as stiff as it was, and 14 % more viscous,
    /// and its shape was then fitted to that.
    fn holds_bulk(&self, run: &Run) -> bool {
        self.several_cameras() && run.config.estimate.rounds > 0 && run.config.estimate.method == Method::GaussNewton
    }

    /// What only compression tells, if it is to be found and the impact hardly compresses what has the usual value: it may then wait. A paste
    /// is compressed by hundredths, and what yields would make up for it if it waited.
    pub(super) fn bulk(&self, run: &Run, at: &Unknowns) -> Result<Vec<&Parameter>> {
        let (held, impact) = (run.config.held(self.law)?, self.impact(run, at));
        let hardly = |p: &Parameter| p.by_compression.is_some_and(|times| impact < HARDLY * times * p.usual[0]);
        Ok(self.law.parameters().iter().filter(|p| !held.contains(&p.name) && hardly(p)).collect())
    }

    /// Searches the material of a body that flows, and that several cameras filmed, for a few steps on the full grid and on a finer one, and leaves it
    /// where the loss is lower: all that follows is on that grid. Chosen later, the full one had made a cream 100 times too stiff.
    /// Films of a grid of 0.7 times the spacing ended at 0.34 to 0.94 times the loss, films of the full grid at 1.2 to 1.7 times.
    /// Returns how many steps the search on the grid chosen has had.
    fn choose_grid(&self, run: &mut Run, holds_bulk: bool, frames: usize, unknowns: &mut Unknowns) -> Result<usize> {
        let steps = run.config.flowing.finer;
        let tries = steps > 0
            && self.several_cameras()
            && run.config.flows(self.law)
            && run.config.estimate.method == Method::GaussNewton;
        let given = run.config.geometry.grid > 0.0 && !run.has_finished(FULL);
        if !tries || given {
            return Ok(0);
        }
        let particles = self.particles(run)?;
        let mut there = Unknowns { contact: unknowns.contact / SHARE, ..unknowns.clone() };
        let effort = |stage| Effort { holds_bulk, ..Effort::new(stage, steps) };
        self.weighed(run, &effort(FULL), &particles, Weighed::All, frames, unknowns)?;
        if run.config.geometry.grid == 0.0 {
            let effort = Effort { grid: SHARE, ..effort(FINER) };
            match self.weighed(run, &effort, &particles, Weighed::All, frames, &mut there) {
                Err(error) if matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                    run.note(format!("{FINER}: the simulation breaks down, and the grid stays as it is: {error}"));
                }
                done => done?,
            }
            let [full, finer] = [FULL, FINER].map(|stage| run.best_of(stage).map_or(f64::INFINITY, |(_, loss)| loss));
            let agrees_better = run.has_finished(FINER) && finer < full;
            run.config.geometry.grid = if agrees_better { SHARE } else { 1.0 };
            run.save_config()?;
        }
        if run.config.geometry.grid < 1.0 {
            *unknowns = run.end_of(FINER)?;
        }
        run.state.unknowns = Some(unknowns.clone());
        run.save()?;
        Ok(steps)
    }
}
