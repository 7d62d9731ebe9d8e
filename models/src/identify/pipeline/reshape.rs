//! The shape from the whole motion: voxels fitted to all frames, moved as they were simulated before.

use std::time::Instant;

use gradreel::backend::cpu::pool;
use gradreel::optim::{Adam, Bound};
use gradreel::{Result, Var};

use super::rung::Level;
use crate::field::fit;
use crate::identify::linearise::Derivatives;
use crate::identify::reconstruct::{DTYPE, Stages};
use crate::identify::run::Run;
use crate::identify::{Free, Problem, Reached, Unknowns};
use crate::particles::Particles;
use crate::report::interrupt;

/// Iterations between two savings.
const SAVE_EVERY: usize = 5;

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
        let (free, how) = (Free::NOTHING, Derivatives::Exact);
        let seen = problem.linearise_frames(unknowns, free, 0..frames, how, &mut 0, &mut |_| ())?;
        let weights: Vec<f64> = seen.iter().map(|frame| 2.0 * floor / (frame.loss + floor)).collect();
        let loss = |_: &Bound, opacity: &Var, colour: &Var| {
            let motion = opacity.tape().constant(motion.clone());
            problem.loss_of(&motion, [opacity, colour], &|frame| self.seen(frame), &weights)
        };
        let iterations = run.config.in_motion_of(self.law);
        let smoothness = self.smoothness(run, &field);
        let bar = self.progress.stage(stage, iterations as u64);
        let mut last = String::new();
        let left = reached.iterations..iterations;
        let reached = |iterations: usize, ended: bool| Reached { stage: stage.to_owned(), iterations, ended };
        let fitted = fit(&field, params, adam, left, smoothness, &loss, |s| {
            last = format!("loss {:.5}, {} voxels", s.loss, field.len());
            bar.set(s.iteration as u64, &last);
            let stop = interrupt::check();
            if stop.is_err() || s.iteration % SAVE_EVERY == 0 {
                run.save_field(&field, s.params, Some::<&Adam>(s.adam), &reached(s.iteration, false))?;
            }
            stop
        })?;
        run.save_field(&field, &fitted, None, &reached(iterations, true))?;
        // what follows has other numbers of particles: buffers of these sizes would only wait
        pool::trim(0);
        bar.finish(&last);
        run.finish(stage, since)
    }
}
