//! The choice of a finer grid: what flows ends in sheets thinner than a cell, and clips show on which grid it spreads as it was filmed.

use gradreel::{Error, ErrorKind, Result};

use crate::identify::reconstruct::{MATERIAL, Stages};
use crate::identify::run::Run;
use crate::identify::stages::Effort;
use crate::identify::{Method, Unknowns};

/// The stage that looks for the material on the finer grid.
const FINER: &str = "material, finer grid";

/// The stage that goes on from there if the clip agreed better: what was found on the full grid made up for its damping.
pub(super) const FURTHER: &str = "material, finer grid, further";

/// The finer grid as a share of the full one. With the same particles, of which 2.7 then share a cell: shape and pictures stay as they are, so
/// that losses can be compared.
const SHARE: f64 = 0.7;

/// Whether the clip agreed better with the finer grid.
pub(super) fn agrees_better(run: &Run) -> bool {
    let [full, finer] = [MATERIAL, FINER].map(|stage| run.best_of(stage).map_or(f64::INFINITY, |(_, loss)| loss));
    run.has_finished(FINER) && finer < full
}

impl Stages<'_> {
    /// Searches the material of a body that flows, and that several cameras filmed, from where it is on a finer grid. If the loss ends lower,
    /// what follows stays there, from a search as long as that on the full grid on: a cream that the full grid had made 100 times too stiff came back.
    /// Films of a grid of 0.7 times the spacing ended at 0.34 to 0.94 times the loss, films of the full grid at 1.2 to 1.7 times.
    pub fn try_finer_grid(&self, run: &mut Run, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let steps = run.config.flowing.finer;
        let tries = steps > 0
            && self.several_cameras()
            && run.config.flows(self.law)
            && run.config.estimate.method == Method::GaussNewton;
        let given = run.config.geometry.grid > 0.0 && !run.has_finished(FINER);
        if !tries || given {
            return Ok(());
        }
        let (particles, free) = (self.particles(run)?, self.free(run, &run.config)?);
        let effort = Effort { grid: SHARE, ..Effort::new(FINER, steps) };
        let mut there = Unknowns { contact: unknowns.contact / SHARE, ..unknowns.clone() };
        let broke_down = |error: &Error| matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite);
        match self.held(run, &effort, &particles, free, frames, &mut there) {
            Err(error) if broke_down(&error) => {
                run.note(format!("{FINER}: the simulation breaks down, and the grid stays as it is: {error}"));
            }
            done => done?,
        }
        let finer = agrees_better(run);
        if finer {
            *unknowns = there;
        }
        if run.config.geometry.grid == 0.0 {
            run.config.geometry.grid = if finer { SHARE } else { 1.0 };
            run.save_config()?;
        }
        run.state.unknowns = Some(unknowns.clone());
        run.save()?;
        if finer {
            let effort = Effort::new(FURTHER, run.config.fine_of(self.law));
            self.held(run, &effort, &particles, free, frames, unknowns)?;
        }
        Ok(())
    }
}
