//! The stages that estimate unknowns, each resumable evaluation by evaluation.

use std::cell::RefCell;
use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};

use crate::field::{Inflated, bounding_sphere};
use crate::identify::fall::Fallen;
use crate::identify::gauss_newton::search_most_probable;
use crate::identify::interval;
use crate::identify::lean::leans;
use crate::identify::plausible::Plausible;
use crate::identify::reconstruct::{DTYPE, Stages, describe};
use crate::identify::run::{HistoryRow, Run, Search};
use crate::identify::unknowns::{Ground, Unknown};
use crate::identify::{
    Answer, Config, Evaluation, Free, Listener, Method, Problem, Steps, Unknowns, apart, estimate, gauss_newton,
    intervals, scan,
};
use crate::particles::Particles;
use crate::runtime::interrupt;

/// A stage that moves unknowns: its name, how much it may do, and the spacing of its grid as a multiple of the full one's.
pub(super) struct Effort<'a> {
    pub stage: &'a str,
    /// Of Gauss–Newton; half the evaluations of a descent.
    pub steps: Steps,
    /// How many evaluations its progress expects.
    pub evaluations: usize,
    pub grid: f64,
    /// Whether what only compression tells is held ([`Stages::holds_bulk`]).
    pub holds_bulk: bool,
}

impl<'a> Effort<'a> {
    /// A search on the full grid.
    pub fn new(stage: &'a str, steps: impl Into<Steps>) -> Self {
        let steps = steps.into();
        Self { stage, steps, evaluations: EVALUATIONS * steps.always, grid: 1.0, holds_bulk: false }
    }

    /// So many points on the full grid.
    fn of_points(stage: &'a str, points: usize) -> Self {
        Self { evaluations: points, ..Self::new(stage, 0) }
    }
}

/// What a search weighs with what the pictures say.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Weighed {
    /// What a fall says of the velocity, and how bodies lean.
    Velocity,
    /// That, and what is plausible of the material.
    All,
}

/// What a stage runs: from the problem, where it starts and what is known from before an interruption, to the best.
type Body<'a> = dyn FnMut(&Problem<'_>, &Search, &mut Listener<'_>, &mut dyn FnMut(String)) -> Result<Evaluation> + 'a;

impl Stages<'_> {
    /// The velocity and, if it may have one, the spin, from frames of free flight. The velocity of what a single camera saw is known from its fall already: a shape that was
    /// seen from one side only says less of how it comes nearer than the size of its silhouette does.
    pub fn velocity(&self, run: &mut Run, stage: &str, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let fallen = self.clip.flight.is_some();
        if fallen && !run.config.estimate.spin {
            return Ok(());
        }
        let free = if fallen { Free::NOTHING } else { Free::Velocity }.with_spin(self.law, run.config.estimate.spin);
        let effort = Effort::new(stage, run.config.estimate.velocity);
        let particles = self.particles(run)?;
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            let Search { start, answers, .. } = search;
            let flying = problem.flying();
            gauss_newton(&flying, start, free, frames, effort.steps, answers, each, notes)
        })
    }

    /// The material from nothing: a scan of what is plausible, short searches from the best of it if several stand out. The names
    /// of the stages begin with `prefix`; the best of the searches' ends is what is left in `unknowns`. The searches see those of
    /// `all` frames that tell the material best ([`Config::early_of`]) where the ground is met at `contact`; how many is returned.
    pub fn explore(
        &self,
        run: &mut Run,
        config: &Config,
        prefix: &str,
        [contact, all]: [usize; 2],
        unknowns: &mut Unknowns,
    ) -> Result<usize> {
        let early = |leans| config.early_of(self.law, contact, self.observed, leans).min(all);
        let mut frames = early(unknowns.leans());
        let named = |stage: &str| [prefix, stage].join(if prefix.is_empty() { "" } else { ": " });
        let scanned = named(SCAN);
        let free = self.free(run, config)?;
        let plausible = Plausible::new(self.law, free);
        let count = config.estimate.scan * free.list(self.law).len();
        self.scan(run, &scanned, free, frames, unknowns, &|start| plausible.points(start, count))?;
        let mut tried = self.tried(run, &scanned);
        if self.leans(run) {
            // how it lies decides how it tips over, and so which material seems to fit
            let [leaning, again] = [LEANING, SCAN_LEANING].map(named);
            let upright = unknowns.clone();
            let agrees = run.least_loss(&scanned) <= NONE_AGREES;
            let (seen, materials) = if agrees { (frames, 0) } else { (early(true), OTHERS) };
            self.scan(run, &leaning, free, seen, unknowns, &|start| {
                let others = plausible.points(start, materials);
                [start.clone()].iter().chain(&others).flat_map(leans).collect()
            })?;
            let as_it_was = run.rows(&leaning).next().and_then(|row| row.loss).unwrap_or(f64::INFINITY);
            let leaning = run.least_loss(&leaning);
            if leaning >= LEANS * as_it_was {
                *unknowns = upright;
            } else {
                frames = early(true);
                self.scan(run, &again, free, frames, unknowns, &|start| plausible.points(start, count))?;
                tried = self.tried(run, &again);
            }
        }
        let best = tried.iter().map(|point| point.loss).fold(f64::INFINITY, f64::min);
        tried.retain(|point| point.loss <= HOPELESS * best);
        let starts = apart(tried, self.law, free, config.estimate.starts.max(1));
        if starts.is_empty() {
            return Err(Error::new(ErrorKind::Physics, "the simulation breaks down with every plausible material")
                .at(scanned)
                .fix("check world.ground, world.density and the size of the object with `gradreel check`"));
        }
        if let ([only], true) = (&starts[..], prefix.is_empty() && config.estimate.starts > 1) {
            // nothing to choose between: the stage that follows goes on from here; after the searches of a family none does
            *unknowns = only.clone();
            return Ok(frames);
        }
        for (index, start) in starts.iter().enumerate() {
            self.short_search(run, config, &named(&format!("{START} {}", index + 1)), frames, &mut start.clone())?;
        }
        let ends = (1..=starts.len()).filter_map(|k| run.best_of(&named(&format!("{START} {k}"))));
        if let Some((best, _)) = ends.min_by(|a, b| a.1.total_cmp(&b.1)) {
            *unknowns = best;
        }
        Ok(frames)
    }

    /// The loss at the start and at some points that follow from it; the best is what is left in `unknowns`.
    pub fn scan(
        &self,
        run: &mut Run,
        stage: &str,
        free: Free,
        frames: usize,
        unknowns: &mut Unknowns,
        others: &dyn Fn(&Unknowns) -> Vec<Unknowns>,
    ) -> Result<()> {
        let particles = self.particles(run)?;
        let effort = Effort::of_points(stage, 1 + others(unknowns).len());
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            let mut points = vec![search.start.clone()];
            points.extend(others(&search.start));
            let all = scan(problem, &points, free, frames, &search.answers, each, notes)?;
            let best = all.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss));
            Ok(best.expect("the start is one of them"))
        })
    }

    /// A short search for the material from one start, in the first frames.
    pub fn short_search(
        &self,
        run: &mut Run,
        config: &Config,
        stage: &str,
        frames: usize,
        unknowns: &mut Unknowns,
    ) -> Result<()> {
        let (free, effort) = (self.free(run, config)?, Effort::new(stage, config.estimate.first));
        let particles = self.particles(run)?;
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            gauss_newton(problem, &search.start, free, frames, effort.steps, &search.answers, each, notes)
        })
    }

    /// The points that a stage has tried.
    pub fn tried(&self, run: &Run, stage: &str) -> Vec<Evaluation> {
        let point =
            |row: &HistoryRow| Evaluation { unknowns: row.unknowns.clone(), loss: row.loss.unwrap_or(f64::INFINITY) };
        run.rows(stage).map(point).collect()
    }

    /// What the first searches for the material move: its parameters, the velocity if too few frames of flight have shown it, and the
    /// height at which the ground is felt if it is unsure.
    pub fn free(&self, run: &Run, config: &Config) -> Result<Free> {
        self.free_but(run, config, &config.held(self.law)?)
    }

    /// The same with these parameters held.
    fn free_but(&self, run: &Run, config: &Config, held: &[&str]) -> Result<Free> {
        let all = Free::all_but(self.law, held, false);
        let unsure = run.state.contact.is_some_and(|contact| contact < SURE);
        let all = if unsure { self.thrown(config, all) } else { all };
        Ok(if self.unsure_ground(run) { all.with_ground(self.law, Ground::Unsure) } else { all })
    }

    /// Whether it is not known how the body lies along the line of sight. That the spin of a body depends on it is not differentiated, so that
    /// one that may spin is taken to lie as it was taken to.
    pub fn leans(&self, run: &Run) -> bool {
        self.observed.sight.is_some() && !run.config.estimate.spin
    }

    /// The same with how the object was thrown: its velocity, and its spin if it may have one.
    fn thrown(&self, config: &Config, free: Free) -> Free {
        free.with_velocity(self.law).with_spin(self.law, config.estimate.spin)
    }

    /// Whether more than one camera filmed it, or was imagined to.
    pub fn several_cameras(&self) -> bool {
        self.clip.cameras.len() > 1
    }

    /// Whether the height of the ground is not known to a part of a grid cell: a single camera leaves it open how far away, and so how high,
    /// the object is, and hulls are larger than objects.
    pub fn unsure_ground(&self, run: &Run) -> bool {
        !self.several_cameras() || run.config.world.find_ground
    }

    /// What the later searches move from there, and what is known of it: the same, and of what a single camera saw the velocity, too, and
    /// the lean if it has one. The pixels after the contact tell how fast it came nearer, which its fall hardly does; what the fall says of
    /// it counts as well.
    fn plausible<'a>(
        &'a self,
        run: &Run,
        holds_bulk: bool,
        from: &Unknowns,
        fall: Option<&'a Fallen>,
    ) -> Result<Plausible<'a>> {
        let mut held = run.config.held(self.law)?;
        if holds_bulk {
            held.extend(self.bulk(run, from)?.iter().map(|p| p.name));
        }
        let free = self.free_but(run, &run.config, &held)?;
        let free = if self.clip.flight.is_some() { self.thrown(&run.config, free) } else { free };
        // of what was not seen to lean, it would only be taken for a velocity along the line of sight
        let free = if self.leans(run) && from.leans() { free.with_lean(self.law) } else { free };
        let free = if self.distance_is_open(run) { free.with_distance(self.law) } else { free };
        Ok(Plausible::new(self.law, free).after(fall))
    }

    /// The material from near it, in so many Gauss–Newton steps or twice as many evaluations of a descent. What is plausible is weighed from the first
    /// if several cameras saw the body: valleys are narrow or flat, and what nothing holds in them runs to a limit first.
    pub fn fine(&self, run: &mut Run, effort: &Effort<'_>, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let particles = self.particles(run)?;
        let gauss_newton = run.config.estimate.method == Method::GaussNewton;
        if gauss_newton && self.several_cameras() {
            return self.weighed(run, effort, &particles, Weighed::All, frames, unknowns);
        }
        let free = self.free(run, &run.config)?;
        if gauss_newton {
            return self.held(run, effort, &particles, free, frames, unknowns);
        }
        self.search(run, effort, &particles, unknowns, &mut |problem, search, each, notes| {
            estimate(problem, &search.start, free, frames, 2 * effort.steps.always, &search.answers, each, notes)
        })
    }

    /// The same, and of what a single camera saw the velocity with it.
    pub fn finer(&self, run: &mut Run, effort: &Effort<'_>, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        if self.clip.flight.is_none() || run.config.estimate.method == Method::Descent {
            return self.fine(run, effort, frames, unknowns);
        }
        let particles = self.particles(run)?;
        self.weighed(run, effort, &particles, Weighed::Velocity, frames, unknowns)
    }

    /// The stage that fits the material to the shape that was seen in flight, the last before the rounds that mend both.
    pub fn fitted(&self, run: &Run) -> &'static str {
        match self.clip.flight {
            Some(_) => MOVING,
            None => self.lower_end(run),
        }
    }

    /// Gauss–Newton steps with the velocity of what a single camera saw held.
    pub fn held(
        &self,
        run: &mut Run,
        effort: &Effort<'_>,
        particles: &Particles,
        free: Free,
        frames: usize,
        unknowns: &mut Unknowns,
    ) -> Result<()> {
        self.search(run, effort, particles, unknowns, &mut |problem, search, each, notes| {
            gauss_newton(problem, &search.start, free, frames, effort.steps, &search.answers, each, notes)
        })
    }

    /// Gauss–Newton steps that weigh what the pictures say with what is known besides.
    pub fn weighed(
        &self,
        run: &mut Run,
        effort: &Effort<'_>,
        particles: &Particles,
        weighed: Weighed,
        frames: usize,
        unknowns: &mut Unknowns,
    ) -> Result<()> {
        let fall = self.fall(run)?;
        let mut plausible = self.plausible(run, effort.holds_bulk, unknowns, fall.as_ref())?;
        let free = plausible.free;
        let mut first = None;
        if !run.has_finished(effort.stage) && !free.list(self.law).is_empty() {
            let start = run.search(effort.stage, unknowns).start.clone();
            let problem = self.problem(run, effort, particles);
            let (mut notes, mut substeps) = (Vec::new(), 0);
            let here = problem.linearise(&start, free, frames, &mut substeps, &mut |note| notes.push(note))?;
            let noise = interval::noise(&plausible, &start, &here)?.into_iter().zip(free.list(self.law));
            let pulls = |unknown| weighed == Weighed::All || matches!(unknown, Unknown::Velocity(_) | Unknown::Lean(_));
            plausible = plausible.pulling(noise.map(|(n, unknown)| if pulls(unknown) { n } else { 0.0 }).collect());
            first = Some((here, substeps));
            notes.into_iter().for_each(|note| run.note(format!("{}: {note}", effort.stage)));
        }
        self.search(run, effort, particles, unknowns, &mut |problem, search, each, notes| {
            let (start, known, steps) = (&search.start, &search.answers, effort.steps);
            search_most_probable(problem, plausible.clone(), start, first.take(), frames, steps, known, each, notes)
        })
    }

    /// What the fall of what a single camera saw says of its velocity.
    pub fn fall(&self, run: &Run) -> Result<Option<Fallen>> {
        self.clip.flight.as_ref().map(|flight| Fallen::of(flight, self.distance_is_open(run))).transpose()
    }

    /// Whether only the fall says how far away the body is, in a world that is known. Where the world's metres follow from the fall as well,
    /// nothing is seen to be nearer or farther than it was taken to be.
    pub fn distance_is_open(&self, run: &Run) -> bool {
        self.leans(run) && self.clip.flight.is_some_and(|flight| !flight.scales_world)
    }

    /// What the material would be on a grid of twice the spacing, and, of what a single camera saw, if the body were thinner.
    pub fn otherwise(&self, run: &mut Run, frames: usize, unknowns: &Unknowns) -> Result<()> {
        let particles = self.particles(run)?;
        let budget = run.config.estimate.coarse;
        let coarse = Effort { grid: 2.0, ..Effort::new(COARSE, budget) };
        self.other(run, &coarse, &particles, frames, unknowns)?;
        if let Some(thin) = self.thinner(&particles)? {
            self.scan(run, AS_IT_IS, Free::NOTHING, frames, &mut unknowns.clone(), &|_| Vec::new())?;
            self.other(run, &Effort::new(THIN, budget), &thin, frames, unknowns)?;
        }
        Ok(())
    }

    /// What the material would be of another body, or on another grid.
    fn other(
        &self,
        run: &mut Run,
        effort: &Effort<'_>,
        particles: &Particles,
        frames: usize,
        unknowns: &Unknowns,
    ) -> Result<()> {
        let mut there = Unknowns { contact: unknowns.contact / effort.grid, ..unknowns.clone() };
        match self.clip.flight {
            Some(_) => self.weighed(run, effort, particles, Weighed::Velocity, frames, &mut there)?,
            None => {
                // a coarse grid stops a body a share of its wider cells earlier: that is no material
                let free = self.free(run, &run.config)?;
                let held = free.contact() == Ground::Held;
                let free = if held { free.with_ground(self.law, Ground::Known) } else { free };
                self.held(run, effort, particles, free, frames, &mut there)?;
            }
        }
        run.state.unknowns = Some(unknowns.clone());
        run.save()
    }

    /// The body with a share of its depth, if a single camera leaves that open.
    fn thinner(&self, particles: &Particles) -> Result<Option<Particles>> {
        let ([camera], [frames]) = (&self.clip.cameras[..], &self.clip.frames[..]) else { return Ok(None) };
        let sphere = bounding_sphere(self.clip, 0)?;
        let inflated = Inflated::of(camera, &frames[0], sphere.centre);
        let thin = inflated.map(|body| particles.within(|x| body.contains(x, THINNESS, particles.spacing)));
        Ok(thin.filter(|thin| !thin.positions.is_empty()))
    }

    /// The most probable material, given what the clip tells and what is plausible: parameters that the clip hardly shows are
    /// pulled to what is usual. Of many cameras that is a search which weighs the pictures' scatter (unless the last one did, as `weighed`
    /// says), and a step along the valley for the error that every parameter has whatever they say. Where a single camera made the shape, what all pictures have in common is the most of
    /// what makes an unknown unsure, and pixels that are wrong alike need not be asked again.
    pub fn weigh(&self, run: &mut Run, weighed: bool, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let effort = Effort::new(WEIGHED, run.config.estimate.weigh);
        if effort.steps.always == 0 {
            return Ok(());
        }
        let particles = self.particles(run)?;
        let many = self.several_cameras();
        if many && !weighed {
            self.weighed(run, &effort, &particles, Weighed::All, frames, unknowns)?;
        }
        let fall = self.fall(run)?;
        let plausible = self.plausible(run, false, unknowns, fall.as_ref())?;
        let free = plausible.free;
        if free.list(self.law).is_empty() {
            return Ok(());
        }
        let bias = if many { Vec::new() } else { self.bias(run, free, unknowns)? };
        let effort = if many { Effort::of_points(USUAL, 2) } else { effort };
        let impact = self.impact(run, unknowns);
        let list = if many { free.list(self.law) } else { Vec::new() };
        let own: Vec<f64> = list.into_iter().map(|unknown| self.own_error(run, unknowns, unknown, impact)).collect();
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            let start = &search.start;
            let here = problem.linearise(start, free, frames, &mut 0, notes)?;
            let there = match many {
                true => interval::more_usual(&plausible, start, &here, &own)?,
                false => interval::most_probable(&plausible, start, &here, &bias)?,
            };
            let there = start.moved(self.law, free, &there);
            let both = scan(problem, &[start.clone(), there], Free::NOTHING, frames, &search.answers, each, notes)?;
            // what breaks down is not what was filmed
            Ok(both.into_iter().rfind(|point| point.loss.is_finite()).expect("the start was simulated"))
        })
    }

    /// How sure the estimates are. The height at which the ground is felt was held; that it may be another counts here.
    pub fn intervals(&self, run: &mut Run, frames: usize, unknowns: &Unknowns) -> Result<()> {
        if run.has_finished(INTERVALS) {
            return Ok(());
        }
        let since = Instant::now();
        let all =
            Free::all_but(self.law, &run.config.held(self.law)?, true).with_spin(self.law, run.config.estimate.spin);
        let free = if self.unsure_ground(run) { all.with_ground(self.law, Ground::Unsure) } else { all };
        let free = if self.leans(run) { free.with_lean(self.law) } else { free };
        let free = if self.distance_is_open(run) { free.with_distance(self.law) } else { free };
        let particles = self.particles(run)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE);
        // where the clip alone would have them: of one camera, a step that no picture asked for has led far from there
        let fitted = run.rows(WEIGHED).next().map_or_else(|| unknowns.clone(), |row| row.unknowns.clone());
        let lowest = if self.several_cameras() { unknowns } else { &fitted };
        let mut notes = Vec::new();
        let linearised = problem.linearise(lowest, free, frames, &mut 0, &mut |note| notes.push(note))?;
        let flight = self.clip.flight.as_ref();
        let valleys = interval::valleys(lowest, self.law, free, &linearised, flight)?;
        let here = lowest.coordinates(self.law, free);
        let bar = self.progress.stage(INTERVALS, valleys.len() as u64);
        let mut wider = Vec::with_capacity(valleys.len());
        for valley in &valleys {
            let rise = &mut |far: &[f64]| {
                interrupt::check()?;
                let there: Vec<f64> = here.iter().zip(far).map(|(here, far)| here + far).collect();
                let there = lowest.moved(self.law, free, &there);
                Ok(problem.misfit(&there, frames, &mut 0, &mut |_| ())? - linearised.loss)
            };
            wider.push(valley.as_ref().map_or(Ok(1.0), |valley| valley.wider(rise))?);
            bar.set(wider.len() as u64, "");
        }
        let bias = self.bias(run, free, &fitted)?;
        run.state.intervals = intervals(unknowns, self.law, free, &linearised, &wider, &bias, flight)?;
        notes.into_iter().for_each(|note| run.note(format!("{INTERVALS}: {note}")));
        bar.finish("");
        run.finish(INTERVALS, since)
    }

    /// What a stage searches.
    fn problem<'a>(&'a self, run: &Run, effort: &Effort<'_>, particles: &'a Particles) -> Problem<'a> {
        Problem::new(particles, self.observed, self.law.clone(), &run.config, DTYPE).on_grid(effort.grid)
    }

    /// Runs a search unless it is finished, keeps every evaluation, and moves the unknowns to where it ends.
    fn search(
        &self,
        run: &mut Run,
        effort: &Effort<'_>,
        particles: &Particles,
        unknowns: &mut Unknowns,
        body: &mut Body<'_>,
    ) -> Result<()> {
        let Effort { stage, evaluations, .. } = *effort;
        if run.has_finished(stage) {
            *unknowns = run.end_of(stage)?;
            return Ok(());
        }
        let since = Instant::now();
        let problem = self.problem(run, effort, particles);
        let bar = self.progress.stage(stage, evaluations as u64);
        let search = run.search(stage, unknowns).clone();
        let notes = RefCell::new(Vec::new());
        let mut done = 0;
        let mut best = Evaluation { unknowns: search.start.clone(), loss: f64::INFINITY };
        let found = body(
            &problem,
            &search,
            &mut |evaluation: &Evaluation, answer: Option<&Answer>| {
                done += 1;
                if evaluation.loss < best.loss {
                    best = evaluation.clone();
                    run.state.unknowns = Some(best.unknowns.clone());
                }
                // with the answer, so that an interruption loses neither
                notes.take().into_iter().for_each(|note: String| run.note(format!("{stage}: {note}")));
                run.record(stage, evaluation, answer)?;
                let shown = (done as u64).min(evaluations as u64);
                bar.set(shown, &format!("loss {:.5}  {}", best.loss, describe(self.law, &best.unknowns)));
                interrupt::check()
            },
            &mut |note| notes.borrow_mut().push(note),
        );
        notes.take().into_iter().for_each(|note| run.note(format!("{stage}: {note}")));
        let Evaluation { unknowns: found, loss } = found?;
        *unknowns = found;
        bar.finish(&format!("loss {loss:.5}  {}", describe(self.law, unknowns)));
        run.finish_at(unknowns, stage, since)
    }
}

/// How the stages of the choice among families begin.
pub(super) const AUTO: &str = "auto";

const SCAN: &str = "what is plausible";
const LEANING: &str = "how it leans";
const SCAN_LEANING: &str = "what is plausible, leaning";
const START: &str = "material, start";
pub(super) const MOVING: &str = "material and velocity";
pub(super) const COARSE: &str = "material, coarse";
pub(super) const AS_IT_IS: &str = "material, as it is";
pub(super) const THIN: &str = "material, thinner";
const WEIGHED: &str = "material, most probable";
const USUAL: &str = "material, more usual";
const INTERVALS: &str = "intervals";

/// Evaluations that a step of Gauss–Newton takes, most often: derivatives, a step, and another one that is shorter or farther.
const EVALUATIONS: usize = 3;

/// Frames before contact that show the velocity better than those after it, which show the shape's error as well.
const SURE: usize = 2;

/// A body leans if its loss is then at most this share of what it is upright: it was 0.36 and 0.47 of a ring and a dumbbell that did.
const LEANS: f64 = 0.7;

/// No material agrees with an upright body if none has a loss below this; the best of them then only makes up for how it lies (a soft ring, for one
/// of 200 kPa that leaned), and so many others are tried leaning as well, over early frames.
const NONE_AGREES: f64 = 0.3;
const OTHERS: usize = 3;

/// A material whose loss is so many times that of the best is no start for a search: in nine films the second start ended below the first
/// where it began at 1.1 times its loss at most, and above it from 1.4 times on.
pub(super) const HOPELESS: f64 = 2.0;

/// The share of its depth that a body seen from one side is tried with: what a deviation of it may be.
const THINNESS: f64 = 0.6;
