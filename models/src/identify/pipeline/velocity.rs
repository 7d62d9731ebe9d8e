//! The velocity in flight.

use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};

use crate::identify::pipeline::context::{Context, LEAST};
use crate::identify::pipeline::reconstruct::DTYPE;
use crate::identify::run::Run;
use crate::identify::solve::{GaussNewton, Setting};
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Free, Problem, Stage, Unknowns};

impl Context<'_> {
    /// The velocity and, if it may have one, the spin, from frames of free flight. The velocity of what a single camera saw is known
    /// from its fall already: a shape that was seen from one side only says less of how it comes nearer than the size of its
    /// silhouette does.
    pub fn velocity(&self, run: &mut Run, stage: Stage, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let fallen = self.clip.flight.is_some();
        if fallen && !run.config.estimate.spin {
            return Ok(());
        }
        if run.has_finished(stage) {
            *unknowns = run.end_of(stage)?;
            return Ok(());
        }
        let since = Instant::now();
        let free = if fallen { Free::NOTHING } else { Free::Velocity }.with_spin(self.law, run.config.estimate.spin);
        let particles = self.particles(run)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE).flying();
        let settings = [Setting { problem, free, frames: 0..frames, floor: LEAST }];
        let prior = Prior::of(self.law, free, unknowns, None);
        let pictures = (frames * self.observed.views.len()) as f64;
        let steps = run.config.estimate.velocity;
        let mut search = [GaussNewton::new(prior, 0, pictures, steps, unknowns)];
        self.searched(run, stage, steps, &settings, &mut search)?;
        let best = search[0].best();
        if !best.cost.is_finite() {
            return Err(Error::new(ErrorKind::NonFinite, "the loss is not finite where the search starts").at(stage));
        }
        *unknowns = best.unknowns.clone();
        run.finish_at(unknowns, stage, since)
    }
}
