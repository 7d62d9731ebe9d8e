//! The stages that estimate unknowns, each resumable evaluation by evaluation.

use std::cell::RefCell;
use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};

use crate::identify::plausible::Plausible;
use crate::identify::reconstruct::{DTYPE, Stages, describe};
use crate::identify::run::{HistoryRow, Run, Search};
use crate::identify::unknowns::Unknown;
use crate::identify::{
    Answer, Config, Evaluation, Free, Listener, Method, Problem, Unknowns, apart, estimate, gauss_newton, intervals,
    scan,
};
use crate::particles::Particles;
use crate::physics::Map;
use crate::report::interrupt;

/// A stage that moves unknowns: its name, and how much it may do.
pub(super) struct Effort<'a> {
    pub stage: &'a str,
    pub budget: usize,
}

/// What a stage runs: from the problem, where it starts and what is known from before an interruption, to the best.
type Body<'a> = dyn FnMut(&Problem<'_>, &Search, &mut Listener<'_>, &mut dyn FnMut(String)) -> Result<Evaluation> + 'a;

impl Stages<'_> {
    /// The velocity.
    pub fn velocity(&self, run: &mut Run, stage: &str, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let budget = run.config.estimate.velocity;
        let particles = self.particles(run)?;
        self.search(run, &Effort { stage, budget }, &particles, unknowns, &mut |problem, search, each, notes| {
            let Search { start, answers, .. } = search;
            gauss_newton(problem, start, Free::Velocity, frames, budget, answers, each, notes)
        })
    }

    /// The material on a grid of twice the spacing, and which of the searches there to follow.
    pub fn coarse(&self, run: &mut Run, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let config = run.config.clone();
        self.coarse_of(run, &config, "", frames, unknowns)?;
        let free = Free::all_but(self.law, &config.held(self.law)?, false);
        // the full grid tells which
        let ends = (1..=config.estimate.starts.max(1)).filter_map(|k| run.best_of(&format!("{COARSE} {k}")));
        let tried = apart(self.tried(run, SCAN), self.law, free, TRIED_AGAIN);
        let ends: Vec<Unknowns> = ends.map(|(end, _)| end).chain(tried).collect();
        let particles = self.particles(run)?;
        let effort = Effort { stage: CHOICE, budget: ends.len() };
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            let all = scan(problem, &ends, free, frames, &search.answers, each, notes)?;
            let best = all.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss));
            Ok(best.expect("there is at least one start"))
        })
    }

    /// The material on a grid of twice the spacing: Gauss–Newton from the best of a scan of what is plausible. The names of
    /// the stages begin with `prefix`; the best of their ends is what is left in `unknowns`.
    pub fn coarse_of(
        &self,
        run: &mut Run,
        config: &Config,
        prefix: &str,
        frames: usize,
        unknowns: &mut Unknowns,
    ) -> Result<()> {
        let named = |stage: &str| [prefix, stage].join(if prefix.is_empty() { "" } else { ": " });
        let scanned = named(SCAN);
        let particles = self.particles(run)?.coarsened();
        let held = config.held(self.law)?;
        let free = Free::all_but(self.law, &held, false);
        let plausible = Plausible { law: self.law, free };
        let effort = Effort { stage: &scanned, budget: 1 + config.estimate.scan };
        self.search(run, &effort, &particles, unknowns, &mut |problem, search, each, notes| {
            let mut points = vec![search.start.clone()];
            points.extend(plausible.points(&search.start, config.estimate.scan));
            let all = scan(problem, &points, free, frames, &search.answers, each, notes)?;
            let best = all.into_iter().min_by(|a, b| a.loss.total_cmp(&b.loss));
            Ok(best.expect("the start is one of them"))
        })?;
        let starts = apart(self.tried(run, &scanned), self.law, free, config.estimate.starts.max(1));
        if starts.is_empty() {
            return Err(Error::new(ErrorKind::Physics, "the simulation breaks down with every plausible material")
                .at(scanned)
                .fix("check world.ground, world.density and the size of the object with `gradreel check`"));
        }
        let budget = config.estimate.coarse;
        for (index, start) in starts.iter().enumerate() {
            let stage = named(&format!("{COARSE} {}", index + 1));
            let mut own = start.clone();
            let effort = Effort { stage: &stage, budget };
            self.search(run, &effort, &particles, &mut own, &mut |problem, search, each, notes| {
                gauss_newton(problem, &search.start, free, frames, budget, &search.answers, each, notes)
            })?;
        }
        let ends = (1..=starts.len()).filter_map(|k| run.best_of(&named(&format!("{COARSE} {k}"))));
        if let Some((best, _)) = ends.min_by(|a, b| a.1.total_cmp(&b.1)) {
            *unknowns = best;
        }
        Ok(())
    }

    /// The points that a stage has tried.
    fn tried(&self, run: &Run, stage: &str) -> Vec<Evaluation> {
        let point =
            |row: &HistoryRow| Evaluation { unknowns: row.unknowns.clone(), loss: row.loss.unwrap_or(f64::INFINITY) };
        run.rows(stage).map(point).collect()
    }

    /// The magnitudes of the material by descent on a grid of twice the spacing: first from the frames around contact, where a
    /// wrong material has not led far away yet, then from all.
    pub fn magnitudes(&self, run: &mut Run, contact: usize, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let particles = self.particles(run)?.coarsened();
        let budget = 2 * run.config.estimate.coarse;
        for (stage, frames) in [(AROUND, (contact + WARM_UP).min(frames)), (MAGNITUDES, frames)] {
            self.search(run, &Effort { stage, budget }, &particles, unknowns, &mut |problem, search, each, notes| {
                let Search { start, answers, .. } = search;
                estimate(problem, start, Free::Magnitudes, frames, budget, answers, each, notes)
            })?;
        }
        Ok(())
    }

    /// The material on the full grid; the velocity stays what the flight has shown.
    pub fn fine(&self, run: &mut Run, stage: &str, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let method = run.config.method(self.law);
        let budget = match method {
            Method::Descent => 2 * run.config.estimate.fine,
            Method::GaussNewton => run.config.estimate.fine,
        };
        let free = Free::all_but(self.law, &run.config.held(self.law)?, false);
        let particles = self.particles(run)?;
        self.search(run, &Effort { stage, budget }, &particles, unknowns, &mut |problem, search, each, notes| {
            let Search { start, answers, .. } = search;
            match method {
                Method::Descent => estimate(problem, start, free, frames, budget, answers, each, notes),
                Method::GaussNewton => gauss_newton(problem, start, free, frames, budget, answers, each, notes),
            }
        })
    }

    /// How sure the estimates are. The height at which the ground is felt was held; that it may be another counts here.
    pub fn intervals(&self, run: &mut Run, frames: usize, unknowns: &Unknowns) -> Result<()> {
        if run.has_finished(INTERVALS) {
            return Ok(());
        }
        let since = Instant::now();
        let bar = self.progress.stage(INTERVALS, 1);
        let free = Free::all_but(self.law, &run.config.held(self.law)?, true);
        let particles = self.particles(run)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE);
        let mut notes = Vec::new();
        let linearised = problem.linearise(unknowns, free, frames, &mut 0, &mut |note| notes.push(note))?;
        // what a descent leaves alone on the coarse grid says nothing of the grid's error
        let magnitudes = run.best_of(MAGNITUDES).map(|(mut coarse, loss)| {
            let parameters = self.law.parameters().iter().zip(&mut coarse.parameters).zip(&unknowns.parameters);
            parameters.filter(|((p, _), _)| p.map != Map::Log10).for_each(|((_, coarse), fine)| *coarse = *fine);
            (coarse, loss)
        });
        let coarse = run.best_of(CHOICE).or(magnitudes).map(|(coarse, _)| coarse.coordinates(self.law, free));
        let fine = unknowns.coordinates(self.law, free);
        let coarse = coarse.unwrap_or_else(|| fine.clone());
        // the grid's error, estimated from that of one of twice the spacing; the coarse grid holds the velocity
        let bias: Vec<f64> = free
            .list(self.law)
            .iter()
            .zip(fine.iter().zip(&coarse))
            .map(|(unknown, (fine, coarse))| match unknown {
                Unknown::Velocity(_) | Unknown::Contact => 0.0,
                Unknown::Parameter(_) => GRID_ERROR * (fine - coarse).abs(),
            })
            .collect();
        run.state.intervals = intervals(unknowns, self.law, free, &linearised, &bias)?;
        notes.into_iter().for_each(|note| run.note(format!("{INTERVALS}: {note}")));
        bar.finish("");
        run.finish(INTERVALS, since)
    }

    /// Runs a search unless it is finished, keeps every evaluation, and moves the unknowns to the best.
    fn search(
        &self,
        run: &mut Run,
        effort: &Effort<'_>,
        particles: &Particles,
        unknowns: &mut Unknowns,
        body: &mut Body<'_>,
    ) -> Result<()> {
        let Effort { stage, budget, .. } = *effort;
        if run.has_finished(stage) {
            if let Some((best, _)) = run.best_of(stage) {
                *unknowns = best;
            }
            return Ok(());
        }
        let since = Instant::now();
        let problem = Problem::new(particles, self.observed, self.law.clone(), &run.config, DTYPE);
        let bar = self.progress.stage(stage, budget as u64);
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
                let shown = (done as u64).min(budget as u64);
                bar.set(shown, &format!("loss {:.5}  {}", best.loss, describe(self.law, &best.unknowns)));
                interrupt::check()
            },
            &mut |note| notes.borrow_mut().push(note),
        );
        notes.take().into_iter().for_each(|note| run.note(format!("{stage}: {note}")));
        let Evaluation { unknowns: found, loss } = found?;
        *unknowns = found;
        run.state.unknowns = Some(unknowns.clone());
        bar.finish(&format!("loss {loss:.5}  {}", describe(self.law, unknowns)));
        run.finish(stage, since)
    }
}

/// How the stages of the choice among families begin.
pub(super) const AUTO: &str = "auto";

const AROUND: &str = "magnitudes around contact, coarse";
const MAGNITUDES: &str = "magnitudes, coarse";
/// Frames after first contact that the first estimate of magnitudes sees.
const WARM_UP: usize = 3;
const SCAN: &str = "what is plausible, coarse";
const CHOICE: &str = "which of them";
const COARSE: &str = "material, coarse, start";
const INTERVALS: &str = "intervals";

/// How many of the materials that were scanned on the coarse grid are tried again on the full one, beside the ends of the
/// searches: what looks best on a coarse grid may lie beyond a hill on the full one.
const TRIED_AGAIN: usize = 6;

/// The error of the full grid as a share of its difference to that of twice the spacing: a third if it falls with the square
/// of the spacing, all of it if it falls with the spacing.
const GRID_ERROR: f64 = 0.5;
