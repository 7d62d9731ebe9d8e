//! The pool of hypotheses, and a rung of its halving (Jamieson and Talwalkar 2016): each searches with a small budget, and the better
//! ones go on.

use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};

use crate::identify::hypotheses::{Hypothesis, apart};
use crate::identify::model::unknowns::Ground;
use crate::identify::pipeline::context::Context;
use crate::identify::pipeline::context::LEAST;
use crate::identify::pipeline::reconstruct::{DTYPE, describe};
use crate::identify::run::{HistoryRow, Run, Standing};
use crate::identify::solve::{Answer, GaussNewton, Request, Setting, Threads, drive};
use crate::identify::uncertainty::prior::{FRICTION, Prior};
use crate::identify::{
    Config, FAMILIES, Free, GroundContact, MaterialConfig, Observed, Problem, Stage, Substeps, Unknowns, WorldConfig,
};
use crate::particles::Particles;
use crate::physics::Law;
use crate::runtime::interrupt;

/// How faithful a forward model is to the one that a search ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fidelity {
    /// A body, a grid and pictures of half the resolution, and the fewest substeps that are stable.
    Coarse,
    /// Only the substeps are the fewest that are stable.
    FewSubsteps,
    /// The same.
    Full,
}

/// What a rung of the halving has to spend.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rung {
    /// Its stage.
    pub stage: Stage,
    /// How faithful its forward model is.
    pub fidelity: Fidelity,
    /// Whether the velocity and the height of the ground are free, too.
    pub world: bool,
    /// Gauss–Newton steps.
    pub steps: usize,
    /// How many hypotheses of a family go on at most, and how many times the loss of the best theirs may be.
    pub keep: (usize, f64),
}

/// A body with its pictures at one resolution.
pub(crate) struct Level<'a> {
    pub particles: Particles,
    pub observed: &'a Observed,
}

/// A family with its law, and the configuration that is its own.
pub(crate) struct Family {
    /// The family of the material with the kind of the ground, among hypotheses.
    pub name: String,
    /// The family of the material.
    pub material: String,
    pub law: Law,
    pub config: Config,
}

impl Context<'_> {
    /// The families that the material may be of.
    pub fn families(&self, run: &Run) -> Result<Vec<Family>> {
        let materials: Vec<MaterialConfig> = match run.config.chooses_family() {
            false => vec![run.config.material.clone()],
            true => {
                let own = |name: &&str| MaterialConfig { name: (*name).to_owned(), ..MaterialConfig::default() };
                FAMILIES.iter().map(|(name, _)| own(name)).collect()
            }
        };
        let on = |material: &MaterialConfig, ground_contact: GroundContact| -> Result<Family> {
            let world = WorldConfig { ground_contact, ..run.config.world.clone() };
            let config = Config { material: material.clone(), world, ..run.config.clone() };
            let (name, material) = (ground_contact.named(&material.name), material.name.clone());
            Ok(Family { name, material, law: config.law()?, config })
        };
        let kinds = run.config.world.ground_contact.hypotheses();
        materials.iter().flat_map(|material| kinds.iter().map(|kind| on(material, *kind))).collect()
    }

    /// What is free: the parameters that are not held, the height of the ground and the modes of a single camera's body; with
    /// `world` also the velocity.
    pub fn freedom(&self, run: &Run, family: &Family, world: bool) -> Result<Free> {
        let law = &family.law;
        let free = Free::all_but(law, &family.config.held(law)?, false);
        let free = free.with_ground(law, if self.unsure_ground(run) { Ground::Unsure } else { Ground::Known });
        let rough = family.config.world.ground_contact == GroundContact::Friction;
        let free = if rough { free.with_friction(law) } else { free };
        let free = if self.freedom_of_flight(world) { free.with_velocity(law) } else { free };
        let free = free.with_spin(law, run.config.estimate.spin);
        let free = if self.depth_is_open(run) { free.with_depth_shear(law) } else { free };
        let free = if self.distance_is_open(run) { free.with_distance(law) } else { free };
        Ok(if self.pitch_is_open(run) { free.with_pitch(law) } else { free })
    }

    /// The loss of a frame that no motion explains: that of the frames of flight, with the velocity that they have shown.
    pub fn floor(&self, run: &Run, level: &Level<'_>) -> Result<f64> {
        let law = self.law;
        let flight = run.state.contact.unwrap_or(1).clamp(1, level.observed.targets.len());
        let velocity = match &self.clip.flight {
            Some(flight) => flight.velocity,
            None => run.end_of(Stage::VelocityInFlight)?.velocity,
        };
        let parameters = run.config.starting_values(law)?;
        let unknowns = Unknowns { velocity, parameters, ..Unknowns::default() };
        let problem = Problem::new(&level.particles, level.observed, law.clone(), &run.config, DTYPE).flying();
        Ok(problem.misfit(&unknowns, flight, &mut Substeps::default())?.max(LEAST))
    }

    /// Whether the velocity is free where this is said of the world.
    fn freedom_of_flight(&self, world: bool) -> bool {
        world || self.observed.sight.is_some()
    }

    /// The pool: points of every family's prior about what the flight has told.
    pub fn pool(&self, run: &Run, families: &[Family], start: &Unknowns) -> Result<Vec<Hypothesis>> {
        let fallen = self.fall(run)?;
        let mut pool = Vec::new();
        for family in families {
            let parameters = family.config.starting_values(&family.law)?;
            let start = Unknowns { parameters, friction: FRICTION[0], ..start.clone() };
            let free = self.freedom(run, family, false)?;
            let prior = Prior::of(&family.law, free, &start, fallen.as_ref());
            let count = family.config.estimate.points * prior.varied();
            pool.push(Hypothesis::new(&family.name, start.clone()));
            let points = prior.points(&start, count).into_iter().map(|point| self.seen_to_move(run, point));
            pool.extend(points.map(|point| Hypothesis::new(&family.name, point)));
        }
        Ok(pool)
    }

    /// The same with the velocity that is seen where the camera looks down by its pitch, as it was seen where it was taken to.
    fn seen_to_move(&self, run: &Run, unknowns: Unknowns) -> Unknowns {
        match self.observed.sight {
            Some(sight) if unknowns.depth[3] != 0.0 => {
                let velocity = sight.pitch(unknowns.depth, run.config.world.ground).along(unknowns.velocity);
                Unknowns { velocity, ..unknowns }
            }
            _ => unknowns,
        }
    }

    /// One rung: each hypothesis searches with its budget; those that go on.
    pub fn rung(
        &self,
        run: &mut Run,
        rung: Rung,
        families: &[Family],
        level: &Level<'_>,
        hypotheses: Vec<Hypothesis>,
    ) -> Result<Vec<Hypothesis>> {
        let frees = families.iter().map(|f| self.freedom(run, f, rung.world)).collect::<Result<Vec<_>>>()?;
        let all = level.observed.targets.len();
        // what flies shows the velocity alone
        let contact = run.state.contact.unwrap_or(0).clamp(1, all - 1) - 1;
        let frames = if self.freedom_of_flight(rung.world) { 0..all } else { contact..all };
        if !run.has_finished(rung.stage) {
            let since = Instant::now();
            let fallen = self.fall(run)?;
            let floor = self.floor(run, level)?;
            let setting = |(family, free): (&Family, &Free)| {
                let problem = family.problem(level, run);
                let problem = if rung.fidelity == Fidelity::Full { problem } else { problem.fewest_substeps() };
                Setting { problem, free: *free, frames: frames.clone(), floor }
            };
            let settings: Vec<Setting<'_>> = families.iter().zip(&frees).map(setting).collect();
            let residuals = (frames.len() * level.observed.views.len()) as f64;
            let search = |hypothesis: &Hypothesis| {
                let k = place(families, &hypothesis.family);
                let mut start = hypothesis.unknowns.clone();
                if rung.fidelity == Fidelity::Coarse {
                    // the same height in wider cells
                    start.contact *= 0.5;
                }
                let prior = Prior::of(&families[k].law, frees[k], &start, fallen.as_ref());
                GaussNewton::new(prior, k, residuals, rung.steps, &start).reaching(run.config.estimate.reach)
            };
            let mut searches: Vec<GaussNewton<'_>> = hypotheses.iter().map(search).collect();
            self.searched(run, rung.stage, rung.steps, &settings, &mut searches)?;
            let ended = hypotheses.iter().zip(&searches).map(|(hypothesis, search)| {
                let best = search.best();
                let mut unknowns = best.unknowns.clone();
                if rung.fidelity == Fidelity::Coarse {
                    unknowns.contact *= 2.0;
                }
                let finite = |x: f64| Some(x).filter(|x| x.is_finite());
                let family = hypothesis.family.clone();
                Hypothesis { family, unknowns, loss: finite(best.loss), cost: finite(best.cost) }
            });
            let ended: Vec<Hypothesis> = ended.collect();
            if families.len() > 1 {
                run.state.standings = standings(std::mem::take(&mut run.state.standings), rung.stage, &ended);
            }
            let of = |name: &str| {
                let k = place(families, name);
                (&families[k].law, frees[k])
            };
            let survivors = apart(ended, rung.keep.0, rung.keep.1, &of);
            let Some(best) = survivors.first() else {
                return Err(Error::new(ErrorKind::Physics, "the simulation breaks down with every plausible material")
                    .at(rung.stage.to_string())
                    .fix("check world.ground, world.density and the size of the object with `gradreel check`"));
            };
            run.state.unknowns = (families.len() == 1).then(|| best.unknowns.clone());
            run.state.survivors.insert(rung.stage, survivors);
            run.finish(rung.stage, since)?;
        }
        run.survivors_of(rung.stage)
    }

    /// Runs searches, from where an interruption left them.
    pub fn searched(
        &self,
        run: &mut Run,
        stage: Stage,
        steps: usize,
        settings: &[Setting<'_>],
        searches: &mut [GaussNewton<'_>],
    ) -> Result<()> {
        let expected = searches.len() as u64 * if steps == 0 { 1 } else { 1 + 2 * steps as u64 };
        let bar = self.progress.stage(&stage.to_string(), expected);
        let known = run.answers_of(stage);
        let (mut done, mut said) = (0, String::new());
        let mut least = f64::INFINITY;
        let mut each = |requests: &[Request], answers: Option<&[Answer]>| {
            done += requests.len() as u64;
            for (request, answer) in requests.iter().zip(answers.unwrap_or_default()) {
                let loss = answer.loss;
                if let Some(loss) = loss.filter(|loss| *loss < least) {
                    least = loss;
                    said = format!("loss {loss:.5}  {}", describe(&settings[request.setting].problem.law, &request.at));
                }
                answer.notes.iter().for_each(|note| run.note(format!("{stage}: {note}")));
                // parameters of several families have no common plot
                if settings.len() == 1 {
                    run.state.history.push(HistoryRow { stage, loss, unknowns: request.at.clone() });
                }
            }
            if let Some(answers) = answers {
                run.keep_answers(stage, answers)?;
            }
            bar.set(done.min(expected), &said);
            interrupt::check()
        };
        drive(&Threads(settings), searches, &known, &mut each)?;
        bar.finish(&said);
        Ok(())
    }
}

impl Family {
    /// The forward model of a body at one resolution, in the world of a run with the ground of this family.
    pub fn problem<'a>(&self, level: &'a Level<'_>, run: &Run) -> Problem<'a> {
        let ground_contact = self.config.world.ground_contact;
        let config = Config { world: WorldConfig { ground_contact, ..run.config.world.clone() }, ..run.config.clone() };
        Problem::new(&level.particles, level.observed, self.law.clone(), &config, DTYPE)
    }
}

/// The place of a family.
pub(crate) fn place(families: &[Family], name: &str) -> usize {
    families.iter().position(|family| family.name == name).expect("hypotheses are of the families")
}

/// How families stand after a rung: those that took part by their best hypothesis, the others as they stood when they went.
fn standings(mut before: Vec<Standing>, stage: Stage, ended: &[Hypothesis]) -> Vec<Standing> {
    let mut now: Vec<Standing> = Vec::new();
    for hypothesis in ended {
        let (Some(loss), Some(cost)) = (hypothesis.loss, hypothesis.cost) else { continue };
        match now.iter_mut().find(|standing| standing.family == hypothesis.family) {
            Some(standing) if standing.behind <= cost => {}
            Some(standing) => (standing.loss, standing.behind) = (loss, cost),
            None => {
                let family = hypothesis.family.clone();
                now.push(Standing { family, stage, loss, behind: cost });
            }
        }
    }
    let least = now.iter().map(|standing| standing.behind).fold(f64::INFINITY, f64::min);
    now.iter_mut().for_each(|standing| standing.behind -= least);
    now.sort_by(|a, b| a.behind.total_cmp(&b.behind));
    before.retain(|old| now.iter().all(|new| new.family != old.family));
    now.extend(before);
    now
}
