//! Whether a body's edges are sharper than the grid draws them.

use gradreel::optim::{Bound, Params};
use gradreel::{Result, Var};

use crate::field::{Field, fit};
use crate::identify::pipeline::context::Context;
use crate::identify::pipeline::reconstruct::DTYPE;
use crate::identify::run::Run;
use crate::identify::{Problem, Unknowns};
use crate::particles::Particles;
use crate::render::Surface;
use crate::runtime::interrupt;

/// Iterations of each trial fit to the first frame.
const TRIAL: usize = 40;

/// A surface that is sharpened must fit the first frame better by this factor. With boxes, whose edges are sharp, its loss
/// halves; of bodies that are round it falls by a quarter at most, or grows.
const SHARPER: f64 = 2.0 / 3.0;

impl Context<'_> {
    /// Draws a body that keeps its shape with a sharpened surface, if its first frame asks for that. A blunt surface loses
    /// what is sharp, and what is lost on one side only moves the body.
    pub(in crate::identify) fn choose_surface(&self, run: &mut Run) -> Result<()> {
        let several = self.clip.cameras.len() > 1 && !self.clip.imagined.contains(&true);
        let asked = run.config.geometry.sharpen && several && !run.config.flows(self.law);
        if run.state.sharpened.is_some() || !asked {
            return sharpened(run);
        }
        let bar = self.progress.stage("sharpness", 2);
        let (field, params) = self.hull(run)?;
        let blunt = self.first_frame(run, &field, params.clone(), &run.config.surface)?;
        bar.set(1, "");
        let sharp = self.first_frame(run, &field, params, &without_blur(&run.config.surface))?;
        let needed = sharp < SHARPER * blunt;
        let loss = format!("loss of the first frame {sharp:.5}, {blunt:.5} as the grid draws it");
        if needed {
            run.note(format!("the body has edges sharper than the grid's: its surface is drawn sharpened ({loss})"));
        }
        bar.finish(&loss);
        run.state.sharpened = Some(needed);
        run.save()?;
        sharpened(run)
    }

    /// The loss of the first frame after a short fit of the hull.
    fn first_frame(&self, run: &Run, hull: &Field, params: Params, surface: &Surface) -> Result<f64> {
        let particles = Particles::of_field(hull, &params, 0.0)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE).flying();
        let problem = Problem { surface: surface.clone(), ..problem };
        let unknowns = Unknowns { parameters: run.config.starting_values(self.law)?, ..Unknowns::default() };
        let schedule = problem.schedule(&unknowns, 1);
        let loss = |_: &Bound, opacity: &Var, colour: &Var| {
            let motion = problem.motion_of(opacity, &unknowns.constants(opacity.tape(), DTYPE)?, schedule)?;
            problem.loss_of(&motion, [opacity, colour], &|_| self.observed, &[1.0])
        };
        let adam = run.config.geometry.fit.adam();
        let mut last = f64::INFINITY;
        fit(hull, params, adam, 0..TRIAL, self.smoothness(run, hull), &loss, |state| {
            last = state.loss;
            interrupt::check()
        })?;
        Ok(last)
    }
}

/// A surface of the same grid with all of its blur taken away. Flat faces are then met at an occupancy of ½, round ones a little below.
fn without_blur(surface: &Surface) -> Surface {
    Surface { low: 0.42, sharpening: 1.0, ..surface.clone() }
}

/// Makes the configuration say what was decided; a run may have been killed after that.
fn sharpened(run: &mut Run) -> Result<()> {
    let sharp = without_blur(&run.config.surface);
    if run.state.sharpened != Some(true) || run.config.surface == sharp {
        return Ok(());
    }
    run.config.surface = sharp;
    run.save_config()
}
