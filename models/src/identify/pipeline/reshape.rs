//! The shape from the whole motion: voxels fitted to all frames, moved as they were simulated before, and then as they are simulated.

use std::time::Instant;

use gradreel::optim::{Bound, Params};
use gradreel::{Result, Tensor, Var};

use super::rung::Level;
use crate::identify::pipeline::context::Context;
use crate::identify::pipeline::reconstruct::{DTYPE, Moved};
use crate::identify::run::Run;
use crate::identify::{Problem, Stage, Unknowns};
use crate::particles::Particles;

impl Context<'_> {
    /// Fits the voxels to all frames, moved as the body was simulated with them before the fit; how the motion depends on the shape is for
    /// the next search to say. Only pictures are differentiated, no rollout. A frame counts by how well its motion is explained.
    ///
    /// # Errors
    /// What the simulation, the renderer and writing return.
    pub fn reshape(&self, run: &mut Run, stage: Stage, unknowns: &Unknowns) -> Result<()> {
        self.keep_before(run, stage)?;
        let reached = run.reached(stage)?;
        if run.has_finished(stage) || reached.ended {
            return if run.has_finished(stage) { Ok(()) } else { run.finish(stage, Instant::now()) };
        }
        let since = Instant::now();
        let least = run.config.geometry.least_opacity;
        let mut adam = run.config.geometry.fit.adam_in_motion(None);
        let (mut field, mut params) = run.load_field(&mut adam)?;
        if reached.iterations == 0 {
            (field, params) = field.pruned(&params, least)?;
        }
        let (body, motion, weights) = self.explained(run, unknowns)?;
        let problem = Problem::new(&body, self.observed, self.law.clone(), &run.config, DTYPE);
        let loss = |_: &Bound, opacity: &Var, colour: &Var| {
            let motion = opacity.tape().constant(motion.clone());
            problem.loss_of(&motion, [opacity, colour], &|frame| self.seen(frame), &weights)
        };
        let iterations = run.config.in_motion_of(self.law);
        let silent = |_: &Params| Ok(String::new());
        self.fitted_voxels(run, &field, (params, adam), (reached, iterations), &loss, &silent)?;
        run.finish(stage, since)
    }

    /// Fits voxels and material together to all frames, moved as they are simulated: a shape that falls otherwise is another one. From
    /// where the motion was held few iterations are needed, and a rollout of the fewest substeps is enough.
    ///
    /// # Errors
    /// As [`Context::reshape`].
    pub fn reshape_and_follow(&self, run: &mut Run, stage: Stage, unknowns: &Unknowns) -> Result<Unknowns> {
        self.keep_before(run, stage)?;
        let weights = if run.has_finished(stage) { vec![] } else { self.explained(run, unknowns)?.2 };
        let moved = Moved::Simulated { unknowns, weights: &weights };
        self.shape(run, stage, FOLLOWED, moved)
    }

    /// The body as it was kept, how it moves, and how much each frame counts.
    fn explained(&self, run: &Run, unknowns: &Unknowns) -> Result<(Particles, Tensor, Vec<f64>)> {
        let (kept, values) = run.load_kept_field()?;
        let (kept, values) = kept.pruned(&values, run.config.geometry.least_opacity)?;
        let body = Particles::of_field(&kept, &values, 0.0)?;
        let problem = Problem::new(&body, self.observed, self.law.clone(), &run.config, DTYPE);
        let motion = problem.positions_of_first(unknowns, self.observed.targets.len())?;
        let floor = self.floor(run, &Level { particles: body.clone(), observed: self.observed })?;
        let weight = |loss: f64| 2.0 * floor / (loss + floor);
        let weights = problem.losses_of(&motion)?.into_iter().map(weight).collect();
        Ok((body, motion, weights))
    }
}

/// Iterations of fitting shape and material together.
const FOLLOWED: usize = 12;
