//! The choice of a finer grid: a grid damps motion within its cells, and clips show on which one a body spreads as it was filmed.

use gradreel::{ErrorKind, Result};

use crate::identify::reconstruct::{MATERIAL, Stages};
use crate::identify::run::Run;
use crate::identify::stages::{Effort, Weighed};
use crate::identify::{Method, Steps, Unknowns};
use crate::physics::Parameter;

/// The stages that look for the material on the full grid and on the finer one, from the same start; the later ones if the first do not tell.
const TRIES: [[&str; 2]; 2] =
    [["material, full grid", "material, finer grid"], ["material, full grid, on", "material, finer grid, on"]];

/// Ratios of the loss on the finer grid to that on the full one that may yet turn: a cream of the full grid stood at 0.76 to 0.89, far from the
/// material, which was then fitted on the wrong grid; where both searches ended it was 1.22. The full grid has no second round: a film of it
/// stood at 1.13, and at 0.88 after ten more steps, as a body that is ten times too soft makes up for a hull that is too large.
const CLOSE: std::ops::Range<f64> = 0.65..1.0;

/// The finer grid is given up where half of its steps leave it at so many times the loss that the full one ended at: three films of a finer grid
/// stood at 1.2 then at most, most films of the full one at 1.3 to 2.
const GIVEN_UP: f64 = 1.3;

/// The finer grid as a share of the full one. With the same particles, of which 2.7 then share a cell: shape and pictures stay as they are, so
/// that losses can be compared.
const SHARE: f64 = 0.7;

/// The grids that are tried, in the order of [`TRIES`].
const GRIDS: [f64; 2] = [1.0, SHARE];

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
        let given = run.config.geometry.grid > 0.0 && !run.has_finished(TRIES[0][0]);
        if !tries || given {
            return Ok(0);
        }
        let particles = self.particles(run)?;
        let mut ends = GRIDS.map(|grid| Unknowns { contact: unknowns.contact / grid, ..unknowns.clone() });
        let (mut finer, mut spent) = (false, 0);
        for (round, stages) in TRIES.iter().enumerate() {
            let steps = steps << round;
            let effort = |which: usize, hopeless| {
                let steps = Steps { hopeless, ..Steps::from(steps) };
                Effort { holds_bulk, grid: GRIDS[which], ..Effort::new(stages[which], steps) }
            };
            self.weighed(run, &effort(0, f64::INFINITY), &particles, Weighed::All, frames, &mut ends[0])?;
            let hopeless = GIVEN_UP * run.least_loss(stages[0]);
            spent += steps;
            let open = run.config.geometry.grid == 0.0 || run.has_finished(stages[1]);
            let tried = open
                && match self.weighed(run, &effort(1, hopeless), &particles, Weighed::All, frames, &mut ends[1]) {
                    Err(error) if matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                        let stage = stages[1];
                        run.note(format!("{stage}: the simulation breaks down, and the grid stays as it is: {error}"));
                        false
                    }
                    done => done.map(|()| true)?,
                };
            let losses = stages.map(|stage| run.least_loss(stage));
            let ratio = if tried { losses[1] / losses[0] } else { f64::INFINITY };
            finer = ratio < 1.0;
            if !CLOSE.contains(&ratio) {
                break;
            }
        }
        run.config.geometry.grid = if finer { SHARE } else { 1.0 };
        run.save_config()?;
        let [full, on_finer] = ends;
        *unknowns = if finer { on_finer } else { full };
        run.state.unknowns = Some(unknowns.clone());
        run.save()?;
        Ok(spent)
    }
}
