//! The shape from the whole motion: voxels fitted to all frames, moved as they were simulated before.

use std::time::Instant;

use gradreel::optim::{Bound, Params};
use gradreel::{Result, Var};

use super::rung::Level;
use crate::identify::reconstruct::{DTYPE, Stages};
use crate::identify::run::Run;
use crate::identify::{Problem, Unknowns};
use crate::particles::Particles;

impl Stages<'_> {
    /// Fits the voxels to all frames, moved as the body was simulated with them before the fit; how the motion depends on the shape is for
    /// the next search to say. Only pictures are differentiated, no rollout. A frame counts by how well its motion is explained.
    ///
    /// # Errors
    /// What the simulation, the renderer and writing return.
    pub fn reshape(&self, run: &mut Run, stage: &str, unknowns: &Unknowns) -> Result<()> {
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
        // the body as it was before, also where the fit goes on
        let (before, values) = run.load_kept_field()?;
        let (before, values) = before.pruned(&values, least)?;
        let body = Particles::of_field(&before, &values, 0.0)?;
        let problem = Problem::new(&body, self.observed, self.law.clone(), &run.config, DTYPE);
        let frames = self.observed.targets.len();
        let motion = problem.positions_of_first(unknowns, frames)?;
        let floor = self.floor(run, &Level { particles: body.clone(), observed: self.observed })?;
        let weights: Vec<f64> =
            problem.losses_of(&motion)?.into_iter().map(|loss| 2.0 * floor / (loss + floor)).collect();
        let loss = |_: &Bound, opacity: &Var, colour: &Var| {
            let motion = opacity.tape().constant(motion.clone());
            problem.loss_of(&motion, [opacity, colour], &|frame| self.seen(frame), &weights)
        };
        let iterations = run.config.in_motion_of(self.law);
        let silent = |_: &Params| Ok(String::new());
        self.fitted_voxels(run, &field, (params, adam), (reached, iterations), &loss, &silent)?;
        run.finish(stage, since)
    }
}
