//! The stages in order, in the folder of a run.

use std::time::{Duration, Instant};

use gradreel::backend::cpu::pool;
use gradreel::{Error, ErrorKind, Result};

use super::descent::{Answer, Answers};
use super::field::{FieldPath, Moving};
use super::pictures::Pictures;
use super::state::Motion;
use super::surrounded::surrounded;
use super::{
    Path, Placing, PublishedConfig, Rig, Stage, State, ViewMaker, boxes, cost, interval, material, particles, report,
    velocity, views,
};
use crate::field::temporal::TemporalFit;
use crate::identify::{
    self, DTYPE, Free, Observed, Problem, Reached, Reconstruction, Run, Substeps, Unknowns, first_contact,
    particle_spacing, shrink_factor,
};
use crate::particles::Particles;
use crate::physics::Law;
use crate::runtime::interrupt;
use crate::runtime::progress::{Progress, Stage as Bar, clock};
use crate::video::{Clip, Flight};
use crate::views::{FileWeights, ImageBox, megabytes};

/// Updates of the field between two rows of its history.
const HISTORY_EVERY: usize = 50;

/// Where the pictures of the object come from.
#[derive(Clone, Copy)]
pub enum Origin<'a> {
    /// From a film of one camera and the views that a model makes of it.
    Film {
        /// The model's weights.
        weights: &'a FileWeights,
        /// Their fingerprint: a run goes on with the same.
        fingerprint: &'a str,
        /// Text and name of a file of boxes, if the masks' are not wanted.
        boxes: Option<(&'a str, &'a str)>,
    },
    /// From cameras that all filmed.
    Views,
}

/// A run of the published chain.
pub struct Chain<'a> {
    run: &'a mut Run,
    config: PublishedConfig,
    state: State,
    origin: Origin<'a>,
    law: Law,
    progress: &'a Progress,
    /// Whether costs are said before the views are made.
    quiet: bool,
}

impl<'a> Chain<'a> {
    /// The chain in the folder of a run, from where it is.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the state is damaged or belongs to other weights, or the run has no settings of the chain.
    pub fn new(run: &'a mut Run, origin: Origin<'a>, progress: &'a Progress, quiet: bool) -> Result<Self> {
        let config = run.config.published.clone().ok_or_else(|| {
            Error::new(ErrorKind::Input, "the run is not one of the published method")
                .at(run.folder.root().display())
                .fix("begin another one with --method published")
        })?;
        let mut state = State::read(&run.folder)?;
        if let Origin::Film { weights, fingerprint, .. } = origin {
            if state.weights.is_empty() {
                fingerprint.clone_into(&mut state.weights);
            }
            if state.weights != fingerprint {
                return Err(Error::new(ErrorKind::Input, "the weights changed since the run was begun")
                    .at(weights.path().display())
                    .found("another content")
                    .wanted("the file that the first views were made with")
                    .fix("go on with that file, or begin again with another --out"));
            }
        }
        let law = run.config.law()?;
        Ok(Self { run, config, state, origin, law, progress, quiet })
    }

    /// The stages of this chain.
    pub fn stages(&self) -> &'static [Stage] {
        match self.origin {
            Origin::Film { .. } => &Stage::ALL,
            Origin::Views => &Stage::OF_FILMED_VIEWS,
        }
    }

    /// Runs what is missing; returns what was found, and what the chain says of itself.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a clip that cannot be used; [`ErrorKind::Physics`] when the simulation breaks down whatever the step;
    /// [`ErrorKind::Interrupted`] when the user stopped it, after which the run can go on.
    pub fn finish(mut self, whole: &Clip) -> Result<(Reconstruction, State)> {
        let coming = self.stages().iter().map(|stage| (stage.name().to_owned(), stage.share()));
        self.progress.plan(coming);
        let spacing = particle_spacing(whole, self.run)?;
        let film = whole.scaled(shrink_factor(whole, self.run, 2.0 * spacing)?);
        let fall = film.flight;
        let (clip, path) = match self.origin {
            Origin::Film { weights, boxes, .. } => {
                // a file's pixels are those of the film as it is
                let boxes = self.boxes(whole, boxes)?;
                let path = Path::of_boxes(&film, &boxes)?;
                (self.views(&film, &boxes, &path, weights)?, path)
            }
            Origin::Views => {
                let path = Path::of_views(&film)?;
                (film, path)
            }
        };
        // sampling has left buffers of other sizes
        pool::trim(0);
        let moving_views = self.run.config.loss.views.clone();
        let moving = Moving::of(&clip, &path, &moving_views);
        let fit = self.field(&moving)?;
        let observed = Observed::of(&clip, &self.run.config, DTYPE)?;
        self.particles(&fit, spacing, &clip, &observed)?;
        let (field, params) = self.run.load_field(&mut gradreel::optim::Adam::new(0.0))?;
        let particles = Particles::of_field(&field, &params, self.run.config.geometry.least_opacity)?;
        self.motion(&moving, &fit, &path, fall.as_ref())?;
        let problem = Problem::new(&particles, &observed, self.law.clone(), &self.run.config.clone(), DTYPE);
        let fall = fall.map(|flight| (flight.velocity, velocity::precision(flight.velocity_covariance)));
        let start = self.velocity(&problem, fall)?;
        let unknowns = self.material(&problem, &start, &clip)?;
        drop(problem);
        let law = self.law.clone();
        let found = Reconstruction {
            particles,
            unknowns,
            law,
            clip: clip.clone(),
            observed,
            given: std::collections::BTreeSet::new(),
            changes: Vec::new(),
        };
        Ok((found, self.state))
    }

    fn clock(&self, stage: Stage, total: usize, from: usize) -> Clock {
        Clock { bar: self.progress.stage_from(stage.name(), total as u64, from as u64), since: Instant::now() }
    }

    /// Marks a stage as finished.
    fn over(&mut self, stage: Stage, clock: Clock, message: &str) -> Result<()> {
        let seconds = clock.since.elapsed().as_secs_f64();
        clock.bar.finish(message);
        self.state.finish(&self.run.folder, stage, seconds)
    }

    fn boxes(&mut self, film: &Clip, file: Option<(&str, &str)>) -> Result<Vec<ImageBox>> {
        if !self.state.has_finished(Stage::Boxes) {
            let clock = self.clock(Stage::Boxes, film.frame_count(), 0);
            self.state.boxes = match file {
                Some((text, name)) => boxes::of_text(text, name, film)?,
                None => boxes::of_masks(film)?,
            };
            self.run.folder.write(report::BOXES, &report::boxes(film, &self.state.boxes)?)?;
            self.over(Stage::Boxes, clock, &format!("{} frames", film.frame_count()))?;
        }
        Ok(self.state.boxes.clone())
    }

    /// The film with its views.
    fn views(&mut self, film: &Clip, boxes: &[ImageBox], path: &Path, weights: &FileWeights) -> Result<Clip> {
        let (sizes, _) = ViewMaker::settings(weights, &self.config)?;
        let rig = Rig::around(&sizes.denoiser.ring, &film.cameras[0], path);
        let pictures = Pictures { film, boxes, path, rig: &rig };
        let placing = pictures.placing(&sizes, self.config.spatial_aware);
        if !self.state.has_finished(Stage::Views) {
            self.make_views(&pictures, weights, placing)?;
        }
        let frames = (0..film.frame_count()).map(|frame| {
            let made = views::made(&self.run.folder, frame)?.ok_or_else(|| {
                Error::new(ErrorKind::Input, "the views of a frame are gone")
                    .at(self.run.folder.path(&format!("views/frame_{frame:03}.safetensors")).display())
                    .fix("begin again with another --out")
            })?;
            pictures.views(frame, &made, &sizes, placing)
        });
        Ok(surrounded(film, pictures.cameras(&sizes, placing)?, frames.collect::<Result<_>>()?))
    }

    fn make_views(&mut self, pictures: &Pictures<'_>, weights: &FileWeights, placing: Placing) -> Result<()> {
        let maker = ViewMaker::new(weights, &self.config, placing == Placing::Module)?;
        let frames = pictures.film.frame_count();
        let (count, steps) = (maker.views(), maker.steps()?);
        self.state.placing = Some(placing);
        self.state.save(&self.run.folder)?;
        self.run.note(format!("assumed: {}", placing.said()));
        self.run.save()?;
        let guided = maker.settings.guidance != 1.0;
        if !self.quiet {
            let left: usize =
                (0..frames).filter(|frame| !matches!(views::made(&self.run.folder, *frame), Ok(Some(_)))).count();
            let seconds: f64 = cost::seconds(&maker.sizes, guided, count * left, steps)?;
            crate::runtime::terminal::tell(format_args!(
                "  views: {left} frames of {count} views in {steps} steps, {} at once: about {} beside the weights, {} by their size",
                maker.at_once(),
                megabytes(maker.memory.total(maker.at_once())),
                format_args!("about {}", clock(Duration::from_secs_f64(seconds)))
            ));
        }
        let clock = self.clock(Stage::Views, frames * steps * count, self.known_views(frames, steps * count)?);
        let sizes = maker.sizes.clone();
        let mut rows = Vec::new();
        for frame in 0..frames {
            let made =
                maker.frame(&self.run.folder, frame, &|| pictures.shown(frame, &sizes, placing), &mut |known| {
                    clock.set((frame * steps * count + known) as u64, &format!("frame {} of {frames}", frame + 1));
                    interrupt::check()
                })?;
            rows.push(pictures.views(frame, &made, &sizes, placing)?);
            self.run.folder.write(report::VIEWS, &report::views(pictures.film, &rows)?)?;
        }
        self.over(Stage::Views, clock, &format!("{frames} × {count}"))
    }

    /// Views of steps that earlier processes have made.
    fn known_views(&self, frames: usize, each: usize) -> Result<usize> {
        let mut known = 0;
        for frame in 0..frames {
            known += if views::made(&self.run.folder, frame)?.is_some() { each } else { 0 };
        }
        Ok(known)
    }

    fn field(&mut self, moving: &Moving<'_>) -> Result<TemporalFit> {
        let mut fit = moving.fit(&self.config, &self.run.folder)?;
        if self.state.has_finished(Stage::Field) {
            return Ok(fit);
        }
        let total = self.config.field;
        // rows of updates that were not saved are made again
        self.state.field.retain(|(iteration, ..)| *iteration <= fit.iteration);
        let clock = self.clock(Stage::Field, total, fit.iteration);
        let history = &mut self.state.field;
        let mut last = String::new();
        let outcome = moving.go_on(&mut fit, &self.run.folder, &mut |update| {
            last = format!("{:.1} dB, {} nodes", update.psnr, update.nodes);
            if update.iteration.is_multiple_of(HISTORY_EVERY) || update.iteration == total {
                history.push((update.iteration, update.loss, update.psnr));
            }
            clock.set(update.iteration as u64, &last);
            interrupt::check()
        });
        self.state.save(&self.run.folder)?;
        outcome?;
        self.run.folder.write(report::FIELD, &report::field(moving, &fit)?)?;
        self.over(Stage::Field, clock, &last)?;
        pool::trim(0);
        Ok(fit)
    }

    fn particles(&mut self, fit: &TemporalFit, spacing: f64, clip: &Clip, observed: &Observed) -> Result<()> {
        if self.state.has_finished(Stage::Particles) {
            return Ok(());
        }
        let total = self.run.config.geometry.fit.iterations;
        let clock = self.clock(Stage::Particles, total, 0);
        let baked = particles::baked(fit, spacing, clip)?;
        let config = self.run.config.clone();
        let (field, params) = particles::refined(baked, observed, &self.law, &config, &mut |iteration, loss| {
            clock.set(iteration as u64, &format!("loss {loss:.5}"));
            interrupt::check()
        })?;
        let reached = Reached { stage: identify::Stage::Shape, iterations: total, ended: true };
        self.run.save_field(&field, &params, None, &reached)?;
        pool::trim(0);
        self.over(Stage::Particles, clock, &format!("{} voxels", field.len()))
    }

    /// The field's motion; and where it comes to rest, if nobody knows how high the ground is.
    fn motion(&mut self, moving: &Moving<'_>, fit: &TemporalFit, path: &Path, fall: Option<&Flight>) -> Result<()> {
        if self.state.motion.is_none() {
            let world = self.run.config.world.clone();
            let boxes = || FieldPath {
                middles: path.places.clone(),
                lowest: path.places.iter().zip(&path.radii).map(|(place, radius)| place[1] - radius).collect(),
                contact: None,
                velocity: None,
            };
            let found = moving.motion(fit, world.gravity, world.ground)?;
            if found.is_none() {
                self.run.note("the temporal field is too faint to show a motion: that of the boxes was taken".into());
                self.run.save()?;
            }
            let FieldPath { middles, lowest, contact, velocity } = found.unwrap_or_else(boxes);
            let rest = if fall.is_some_and(|flight| flight.scales_world) && world.ground == 0.0 {
                resting(&lowest, contact)
            } else {
                None
            };
            // further away it is no error of a height, but of the masks
            let rest = rest.filter(|rest| (rest - world.ground).abs() < moving.radius);
            let ground = rest.unwrap_or(world.ground);
            let fallen = fall.map_or([0.0; 3], |flight| flight.velocity);
            let velocity = velocity.unwrap_or(fallen);
            self.state.motion = Some(Motion { middles, lowest, contact, velocity, ground });
            self.state.save(&self.run.folder)?;
        }
        let ground = self.state.motion.as_ref().map_or(0.0, |motion| motion.ground);
        if self.run.config.world.ground != ground {
            self.run.config.world.ground = ground;
            self.run.note(format!(
                "assumed: ground: at {ground:.3} m, where the temporal field has the object come to rest"
            ));
            self.run.save_config()?;
            self.run.save()?;
        }
        Ok(())
    }

    /// Velocity and material from which the search for the material starts.
    fn velocity(&mut self, problem: &Problem<'_>, fall: Option<([f64; 3], [[f64; 3]; 3])>) -> Result<Unknowns> {
        let still = Unknowns { parameters: self.run.config.starting_values(&self.law)?, ..Unknowns::default() };
        if let (true, Some(velocity)) = (self.state.has_finished(Stage::Velocity), self.state.velocity) {
            return Ok(Unknowns { velocity, ..still });
        }
        let evaluations = self.config.velocity;
        let clock = self.clock(Stage::Velocity, evaluations, 0);
        let frames = problem.observed.targets.len();
        let velocity = self.state.motion.as_ref().map_or([0.0; 3], |motion| motion.velocity);
        let start = Unknowns { velocity, ..still };
        let contact = |at: &Unknowns| {
            first_contact(problem.particles, &problem.world, problem.ground, at, problem.observed.frame_dt, frames)
        };
        let flight = contact(&start).clamp(1, frames).max(2).min(frames);
        let known = self.state.answers.get(&Stage::Velocity).cloned().unwrap_or_default();
        let found = {
            let mut each = listener(&mut self.state, &self.run.folder, Stage::Velocity, &clock);
            velocity::refined(problem, &start, flight, evaluations, fall, &mut Answers::of(known, &mut each))?
        };
        self.state.velocity = Some(found.velocity);
        self.run.state.contact = Some(contact(&found));
        self.run.save()?;
        let [x, y, z] = found.velocity;
        self.over(Stage::Velocity, clock, &format!("v ({x:.3}, {y:.3}, {z:.3}) m/s"))?;
        Ok(found)
    }

    fn material(&mut self, problem: &Problem<'_>, start: &Unknowns, clip: &Clip) -> Result<Unknowns> {
        if let (true, Some(found)) = (self.state.has_finished(Stage::Material), &self.run.state.unknowns) {
            return Ok(found.clone());
        }
        let config = self.run.config.clone();
        let held = config.held(&self.law)?;
        let free = Free::all_but(&self.law, &held, false);
        let frames = problem.observed.targets.len();
        let lands = self.run.state.contact.is_some_and(|contact| contact + 1 < frames);
        let told = !config.material.start.is_empty();
        let count = if told { 0 } else { self.config.starts };
        let starts = match count {
            0 => vec![start.clone()],
            _ => material::starts(&self.law, start, &held, &config.loss.ranges, count),
        };
        let total = if starts.len() > 1 { starts.len() } else { 0 } + self.config.material;
        let known = self.state.answers.get(&Stage::Material).cloned().unwrap_or_default();
        let clock = self.clock(Stage::Material, total, known.len());
        let mut notes = Vec::new();
        let found = if lands {
            let mut each = listener(&mut self.state, &self.run.folder, Stage::Material, &clock);
            let mut answers = Answers::of(known, &mut each);
            let found = material::searched(problem, &starts, free, self.config.material, &mut answers)?;
            notes.extend_from_slice(answers.notes());
            found
        } else {
            self.run.note(format!(
                "the object never touches the ground at {} m: the material is not determined by this clip; if the ground is elsewhere, give \
                 its height with --ground",
                config.world.ground
            ));
            start.clone()
        };
        let weights = config.loss.view_weights(clip, crate::field::bounding_sphere(clip, 0)?.centre);
        let both = free.with_velocity(&self.law);
        let mut substeps = Substeps::default();
        let intervals = interval::around(problem, &found, both, &weights, &mut substeps)?;
        notes.append(&mut substeps.notes);
        if intervals.is_none() {
            self.run.note("the curvature of the loss tells no intervals".into());
        }
        self.run.state.intervals = intervals.unwrap_or_default();
        self.run.state.unknowns = Some(found.clone());
        notes.into_iter().for_each(|note| self.run.note(note));
        self.run.save()?;
        self.over(Stage::Material, clock, &crate::identify::describe(&self.law, &found))?;
        Ok(found)
    }
}

/// The progress of a stage, and when this process began with it.
struct Clock {
    bar: Bar,
    since: Instant,
}

impl Clock {
    fn set(&self, done: u64, message: &str) {
        self.bar.set(done, message);
    }
}

/// The height at which something comes to rest that touches the ground from a frame on: the median of the lower half of its lowest
/// points, some of which are those of a bounce, or of a shadow.
fn resting(lowest: &[f64], contact: Option<usize>) -> Option<f64> {
    let mut after = lowest.get(contact? + 1..)?.to_vec();
    after.sort_by(f64::total_cmp);
    let lower = after.len().div_ceil(2);
    after.get(lower.checked_sub(1)? / 2).copied()
}

/// Keeps the answers of a search in the state, and its progress up to date; an interruption comes after they are saved.
fn listener<'s>(
    state: &'s mut State,
    folder: &'s crate::runtime::run_folder::RunFolder,
    stage: Stage,
    clock: &'s Clock,
) -> impl FnMut(&[Answer]) -> Result<()> + use<'s> {
    move |answers| {
        state.answers.insert(stage, answers.to_vec());
        state.save(folder)?;
        let least = answers.iter().filter_map(|answer| answer.loss).fold(f64::INFINITY, f64::min);
        clock.set(answers.len() as u64, &format!("loss {least:.5}"));
        interrupt::check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_bounces_rests_at_its_lower_points() {
        let lowest = [0.3, 0.1, 0.0, -0.08, 0.1, 0.05, -0.04, -0.03, -0.05];
        assert_eq!(resting(&lowest, Some(2)), Some(-0.05), "of −0.08, −0.05 and −0.04");
        assert_eq!(resting(&lowest, None), None);
        assert_eq!(resting(&lowest, Some(8)), None, "nothing after the contact");
        assert_eq!(resting(&lowest, Some(7)), Some(-0.05));
    }
}
