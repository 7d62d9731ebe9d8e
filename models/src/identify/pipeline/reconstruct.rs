//! The stages in order, from a clip to shape, motion and material.

use std::collections::BTreeSet;
use std::time::Instant;

use gradreel::backend::cpu::pool;
use gradreel::optim::{Adam, Bound, Params};
use gradreel::{DType, Error, ErrorKind, Result, Tensor, Var};

use crate::field::{Faces, Field, Hull, Sphere, bounding_sphere, fill_gaps, fit, hull};
use crate::identify::model::ground::find_ground;
use crate::identify::model::with_voxels::{UNKNOWNS, WithVoxels};
use crate::identify::pipeline::bounces;
use crate::identify::pipeline::context::Context;
use crate::identify::pipeline::stage::Course;
use crate::identify::run::Run;
use crate::identify::{
    Observed, Problem, Reached, Sight, Stage, Substeps, Unknowns, first_contact, velocity_of_silhouettes,
};
use crate::particles::Particles;
use crate::physics::Law;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::video::Clip;

/// Precision of a reconstruction.
pub(crate) const DTYPE: DType = DType::F32;

/// What a reconstruction has found.
pub struct Reconstruction {
    /// The object in the first frame.
    pub particles: Particles,
    /// Velocity and material.
    pub unknowns: Unknowns,
    /// The material's law.
    pub law: Law,
    /// The clip at the resolution that was worked at.
    pub clip: Clip,
    /// Its pixels.
    pub observed: Observed,
    /// Names of parameters and components of the velocity that were given instead of estimated.
    pub given: BTreeSet<String>,
    /// What was changed since, in words.
    pub changes: Vec<String>,
}

/// Runs every stage that the run has not finished yet.
///
/// # Errors
/// [`gradreel::ErrorKind::Input`] for a clip that cannot be used; [`gradreel::ErrorKind::Physics`] when the simulation
/// breaks down whatever the step; [`gradreel::ErrorKind::Interrupted`] when the user stopped it. The run can go on from
/// there.
pub fn reconstruct(whole: &Clip, run: &mut Run, progress: &Progress) -> Result<Reconstruction> {
    let law = run.config.law()?;
    let spacing = particle_spacing(whole, run)?;
    let clip = &whole.scaled(shrink_factor(whole, run, 2.0 * spacing)?);
    find_ground(clip, run)?;
    let observed = Observed::of(clip, &run.config, DTYPE)?;
    let mut unknowns = Unknowns { parameters: run.config.starting_values(&law)?, ..Unknowns::default() };
    let around = clip.all_around();
    let around =
        around.map(|around| Ok::<_, Error>((Observed::of(&around, &run.config, DTYPE)?, around))).transpose()?;
    let around = around.as_ref().map(|(observed, around)| (around, observed));
    let context = Context { clip, observed: &observed, around, law: &law, spacing, progress };

    let frames = clip.frame_count();
    let iterations = run.config.geometry.fit.iterations;
    let coming = context.course(run).stages();
    progress.plan(coming.into_iter().map(|stage| (stage.to_string(), stage.share())));
    if !run.has_finished(Stage::Shape) {
        // a family that was chosen since says nothing of how the first shape was drawn
        context.choose_surface(run)?;
    }
    context.shape(run, Stage::Shape, iterations, Moved::Flying { frames: 1, velocity: [0.0; 3], spin: [0.0; 3] })?;
    let few = frames.min(3);
    if let Some(bounces) = bounces::of(clip, run) {
        context.by_flights(run, bounces, &unknowns)?;
        return context.concluded(run, whole, false);
    }
    unknowns.velocity = match context.flight_of_field(run)? {
        Some(velocity) => velocity,
        None => velocity_of_silhouettes(clip, run.config.world.gravity, few).unwrap_or_default(),
    };
    context.velocity(run, Stage::Velocity, few, &mut unknowns)?;
    context.contact(run, &unknowns)?;
    let flight = run.state.contact.unwrap_or(frames).clamp(1, frames);
    let flying = Moved::Flying { frames: flight, velocity: unknowns.velocity, spin: unknowns.spin };
    // the shape is nearly there
    context.shape(run, Stage::ShapeInFlight, iterations.div_ceil(2), flying)?;
    context.velocity(run, Stage::VelocityInFlight, flight.max(2).min(frames), &mut unknowns)?;
    context.shutter(run, flight, &unknowns)?;
    context.by_pool(run, &unknowns)?;
    context.concluded(run, whole, flight >= frames)
}

/// How the voxels move through the frames they are fitted to.
#[derive(Clone, Copy)]
pub(in crate::identify) enum Moved<'a> {
    /// In free flight, for the first frames.
    Flying { frames: usize, velocity: [f64; 3], spin: [f64; 3] },
    /// As simulated with the fewest stable substeps, through as many first frames as there are weights, by which they count; the
    /// material is fitted with them, from these unknowns on.
    Simulated { unknowns: &'a Unknowns, weights: &'a [f64] },
}

impl Context<'_> {
    /// Keeps the voxels as they are before a stage changes them; once some of the new shape is written there is nothing to keep.
    pub(in crate::identify) fn keep_before(&self, run: &Run, stage: Stage) -> Result<()> {
        let reached = run.reached(stage)?;
        if run.has_finished(stage) || reached.ended || reached.iterations > 0 {
            return Ok(());
        }
        run.keep_field()
    }

    /// Fits the voxels to some frames, moved as the stage says; starts from the hull if there is no field yet. Where they are simulated, the
    /// material is fitted with them; what moves them in the end is returned.
    pub(in crate::identify) fn shape(
        &self,
        run: &mut Run,
        stage: Stage,
        iterations: usize,
        moved: Moved<'_>,
    ) -> Result<Unknowns> {
        let (simulated, start, weights) = match moved {
            Moved::Simulated { unknowns, weights } => (true, unknowns.clone(), weights.to_vec()),
            Moved::Flying { frames, velocity, spin } => {
                let parameters = run.config.starting_values(self.law)?;
                (false, Unknowns { velocity, spin, parameters, ..Unknowns::default() }, vec![1.0; frames])
            }
        };
        let frames = weights.len();
        let with = WithVoxels::new(self.law, start, simulated, &run.config)?;
        let reached = run.reached(stage)?;
        if run.has_finished(stage) || reached.ended {
            let found = if reached.ended { with.found(&run.load_field(&mut Adam::new(0.0))?.1)? } else { with.start };
            if !run.has_finished(stage) {
                run.finish(stage, Instant::now())?;
            }
            return Ok(found);
        }
        let since = Instant::now();
        let settings = &run.config.geometry.fit;
        let mut adam =
            if simulated { settings.adam_in_motion((!with.is_held()).then_some(UNKNOWNS)) } else { settings.adam() };
        let (mut field, mut params) = match (run.state.finished.is_empty(), reached.iterations) {
            (true, 0) => self.hull(run)?,
            _ => run.load_field(&mut adam)?,
        };
        if reached.iterations == 0 {
            if simulated {
                (field, params) = field.pruned(&params, run.config.geometry.least_opacity)?;
            }
            with.begin(&mut params, DTYPE)?;
        }
        let particles = Particles::of_field(&field, &params, 0.0)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE);
        let problem = if simulated { problem.fewest_substeps() } else { problem.flying() };
        // those of the start: a loss that is followed must not jump with the step, whether the fit was interrupted or not
        let substeps = problem.schedule(&with.start, frames).substeps;
        let loss = |bound: &Bound, opacity: &Var, colour: &Var| {
            let (here, values) = with.bound(bound, opacity.tape(), DTYPE)?;
            problem.with_step(&values, frames, &mut Substeps::least(substeps), &mut |schedule| {
                let motion = problem.motion_of(opacity, &here, schedule)?;
                let loss = problem.loss_of(&motion, [opacity, colour], &|frame| self.seen(frame), &weights)?;
                let penalty = problem.ranges.as_ref().and_then(|ranges| ranges.on_tape(self.law, &here.parameters));
                Ok(penalty.map_or(loss.clone(), |penalty| &loss + &penalty))
            })
        };
        let said = |params: &Params| match simulated {
            true => Ok(format!("  {}", describe(self.law, &with.found(params)?))),
            false => Ok(String::new()),
        };
        let fitted = self.fitted_voxels(run, &field, (params, adam), (reached, iterations), &loss, &said)?;
        run.finish(stage, since)?;
        with.found(&fitted)
    }

    /// Fits voxels in a stage from where it is to so many iterations, and keeps the run's file of them up to date; `said` goes with the
    /// progress.
    pub(in crate::identify) fn fitted_voxels(
        &self,
        run: &Run,
        field: &Field,
        (params, adam): (Params, Adam),
        (reached, iterations): (Reached, usize),
        loss: &dyn Fn(&Bound, &Var, &Var) -> Result<Var>,
        said: &dyn Fn(&Params) -> Result<String>,
    ) -> Result<Params> {
        let bar = self.progress.stage(&reached.stage.to_string(), iterations as u64);
        let mut last = String::new();
        let at = |iterations: usize, ended: bool| Reached { stage: reached.stage, iterations, ended };
        let fitted =
            fit(field, params, adam, reached.iterations..iterations, self.smoothness(run, field), &loss, |s| {
                last = format!("loss {:.5}, {} voxels{}", s.loss, field.len(), said(s.params)?);
                bar.set(s.iteration as u64, &last);
                let stop = interrupt::check();
                if stop.is_err() || s.iteration % SAVE_EVERY == 0 {
                    run.save_field(field, s.params, Some(s.adam), &at(s.iteration, false))?;
                }
                stop
            })?;
        run.save_field(field, &fitted, None, &at(iterations, true))?;
        // what follows has other numbers of particles: buffers of these sizes would only wait
        pool::trim(0);
        bar.finish(&last);
        Ok(fitted)
    }

    /// What the run has found, once all stages are finished; says so if the body never landed.
    fn concluded(&self, run: &mut Run, whole: &Clip, flies: bool) -> Result<Reconstruction> {
        if flies {
            run.note(format!(
                "the object never touched the ground at {} m: the material is not determined by this clip; if the ground is elsewhere, give \
                 its height with --ground, or --ground auto",
                run.config.world.ground
            ));
        }
        run.save()?;
        Reconstruction::of(run, whole)
    }

    /// What was filmed; in the first frame from all around, if views of it were imagined.
    pub(in crate::identify) fn seen(&self, frame: usize) -> &Observed {
        self.around.filter(|_| frame == 0).map_or(self.observed, |(_, around)| around)
    }

    /// The area of the surface that counts, and how much. It would take away what was made up behind what a single camera saw: there what is
    /// carved counts, and nothing of bodies that keep their shape.
    pub(in crate::identify) fn smoothness(&self, run: &Run, field: &Field) -> Option<(Faces, f64)> {
        let faces = match (self.clip.cameras.len(), run.config.flows(self.law)) {
            (1, false) => return None,
            (1, true) => field.faces().carved(),
            _ => field.faces(),
        };
        Some((faces, run.config.smoothness_of(self.law))).filter(|(_, counts)| *counts > 0.0)
    }

    /// How the run will go.
    fn course(&self, run: &Run) -> Course {
        let film = &run.config.clip.film;
        Course {
            by_flights: bounces::of(self.clip, run).is_some(),
            fallen: self.clip.flight.is_some(),
            spin: run.config.estimate.spin,
            temporal: run.config.temporal.enabled,
            shutter: [film.exposure, film.row_time].map(|known| known.is_none() && self.is_film()),
            flows: run.config.flows(self.law),
            rounds: run.config.estimate.rounds,
        }
    }

    pub(in crate::identify) fn hull(&self, run: &mut Run) -> Result<(Field, Params)> {
        let sphere = bounding_sphere(self.clip, 0)?;
        if sphere.assumed_depth {
            run.note(
                "the single camera does not see the object fall for three frames, so that its distance is not known: it was \
                 assumed to be where its central ray passes nearest to the world's origin"
                    .into(),
            );
        }
        let (clip, sphere, dissent) = match (self.around, &self.clip.around) {
            // what nobody saw may be deeper than what was seen is wide
            (Some((all, _)), Some(around)) => {
                (all, Sphere { radius: DEEPER * sphere.radius, ..sphere }, around.dissent)
            }
            _ => (self.clip, sphere, half_of_imagined(self.clip)),
        };
        let hull = hull(clip, 0, &sphere, self.spacing, run.config.geometry.hull_coverage, dissent)?;
        let hull = match self.around {
            Some(_) => fill_gaps(hull, self.clip, 0, sphere.centre, run.config.geometry.hull_coverage),
            None => hull,
        };
        let (field, params) = Field::filling(hull, clip);
        run.save()?;
        Ok((field, params))
    }

    pub fn particles(&self, run: &Run) -> Result<Particles> {
        let (field, params) = run.load_field(&mut Adam::new(0.0))?;
        Particles::of_field(&field, &params, run.config.geometry.least_opacity)
    }

    fn contact(&self, run: &mut Run, unknowns: &Unknowns) -> Result<()> {
        if run.state.contact.is_some() {
            return Ok(());
        }
        let particles = self.particles(run)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE);
        let (ground, frames) = (run.config.world.ground, self.observed.targets.len());
        let contact = first_contact(&particles, &problem.world, ground, unknowns, self.observed.frame_dt, frames);
        run.state.contact = Some(contact);
        run.save()
    }
}

impl Reconstruction {
    /// What a run has found so far in its clip (at the clip's own resolution).
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when it has found nothing yet, or its files are damaged.
    pub fn of(run: &Run, clip: &Clip) -> Result<Self> {
        let law = run.config.law()?;
        let Some(unknowns) = run.state.unknowns.clone() else {
            return Err(Error::new(ErrorKind::Input, "the run has found nothing yet")
                .at(run.folder.root().display())
                .fix("let it go on with `gradreel reconstruct CLIP --out FOLDER --resume`"));
        };
        let (field, params) = run.load_field(&mut Adam::new(0.0))?;
        let particles = Particles::of_field(&field, &params, run.config.geometry.least_opacity)?;
        let mut found = (clip.scaled(shrink_factor(clip, run, 2.0 * particles.spacing)?), particles, unknowns);
        if let Some(sight) = Sight::of(&found.0)? {
            sight.stand_upright(&mut found, run.config.world.ground);
        }
        let (clip, particles, unknowns) = found;
        let observed = Observed::of(&clip, &run.config, DTYPE)?;
        Ok(Self { particles, unknowns, law, clip, observed, given: BTreeSet::new(), changes: Vec::new() })
    }

    /// Positions of the particles in every frame of the clip, `[frames, particles, 3]` \[m\].
    ///
    /// # Errors
    /// What the rollout returns.
    pub fn motion(&self, run: &Run) -> Result<Tensor> {
        if let (Some(bounces), true) = (&run.state.bounces, self.changes.is_empty()) {
            return bounces::motion(&self.particles, bounces, self.observed.targets.len());
        }
        Problem::new(&self.particles, &self.observed, self.law.clone(), &run.config, DTYPE).positions(&self.unknowns)
    }
}

/// Velocity and parameters in one line.
pub(crate) fn describe(law: &Law, unknowns: &Unknowns) -> String {
    let [x, y, z] = unknowns.velocity;
    let spin = match unknowns.spin {
        [a, b, c] if unknowns.spins() => format!("  ω ({a:.2}, {b:.2}, {c:.2}) rad/s"),
        _ => String::new(),
    };
    let parameters = law.parameters().iter().zip(&unknowns.parameters).map(|(p, value)| {
        let unit = if p.unit == "-" { "" } else { p.unit };
        if value.abs() >= 1e3 {
            format!("{} {value:.3e} {unit}", p.symbol)
        } else {
            format!("{} {value:.3}{unit}", p.symbol)
        }
    });
    let depth = match unknowns.depth {
        depth @ [right, up, scale, pitch] if depth != [0.0; 4] => {
            format!("  depth shear ({right:.2}, {up:.2})  scale {scale:+.3}  pitch {:+.1}°", pitch.to_degrees())
        }
        _ => String::new(),
    };
    format!("v ({x:.3}, {y:.3}, {z:.3}) m/s{spin}  {}{depth}", parameters.collect::<Vec<_>>().join("  "))
}

/// How much deeper than wide an object may be of which views were imagined.
const DEEPER: f64 = 1.5;

/// Iterations of a fit between two savings.
const SAVE_EVERY: usize = 5;

/// Where there are several cameras, half of the imagined ones may be wrong.
pub(crate) fn half_of_imagined(clip: &Clip) -> usize {
    clip.imagined.iter().filter(|imagined| **imagined).count() / 2
}

/// The ball around the object of a frame, and its visual hull on voxels of a fortieth of the radius.
pub(in crate::identify) fn rough_hull(clip: &Clip, frame: usize) -> Result<(Sphere, Hull)> {
    let sphere = bounding_sphere(clip, frame)?;
    let hull = hull(clip, frame, &sphere, sphere.radius / 40.0, 0.5, half_of_imagined(clip))?;
    Ok((sphere, hull))
}

/// Half the configured grid spacing, or the one that the object's size asks for; the latter is stored.
pub(crate) fn particle_spacing(clip: &Clip, run: &mut Run) -> Result<f64> {
    if run.config.geometry.dx > 0.0 {
        return Ok(0.5 * run.config.geometry.dx);
    }
    let (_, hull) = rough_hull(clip, 0)?;
    let volume = hull.voxels.len() as f64 * hull.node_grid.spacing.powi(3);
    let count = volume / 0.01f64.powi(3);
    let dx = if (3e3..=4e4).contains(&count) {
        0.02
    } else {
        let exact = 2.0 * (volume / 1e4).cbrt();
        let digits = 10f64.powf(exact.log10().floor() - 1.0);
        (exact / digits).round() * digits
    };
    run.config.geometry.dx = dx;
    run.save_config()?;
    Ok(0.5 * dx)
}

/// The configured factor, or the largest whose pixels are at most a third of a grid cell at the object.
pub(crate) fn shrink_factor(clip: &Clip, run: &Run, dx: f64) -> Result<usize> {
    if run.config.clip.shrink > 0 {
        return Ok(run.config.clip.shrink);
    }
    let sphere = bounding_sphere(clip, 0)?;
    let pixel = clip
        .cameras
        .iter()
        .filter_map(|camera| camera.project(sphere.centre).map(|[_, _, depth]| depth / camera.fx))
        .fold(0.0f64, f64::max);
    Ok(((dx / 3.0 / pixel) as usize).max(1))
}
