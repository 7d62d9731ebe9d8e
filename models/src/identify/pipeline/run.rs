//! The stages of the pool in their order.

use std::time::Instant;

use gradreel::{ErrorKind, Result};

use super::rung::{Family, Fidelity, Level, Rung, place};
use crate::identify::hypotheses::Hypothesis;
use crate::identify::pipeline::context::Context;
use crate::identify::pipeline::reconstruct::DTYPE;
use crate::identify::pipeline::stage::number;
use crate::identify::run::Run;
use crate::identify::{MaterialConfig, Observed, Stage, Unknowns};

/// The rungs before the full forward model; of each, so many times as many hypotheses go on as are searched at last. A coarse body tells good
/// from bad, but not the best from the second best, so that it is searched little and hands on many.
const RUNGS: [Rung; 4] = [
    Rung { stage: Stage::Plausible, fidelity: Fidelity::Coarse, world: false, steps: 0, keep: (8, 4.0) },
    Rung { stage: Stage::Coarse, fidelity: Fidelity::Coarse, world: false, steps: 1, keep: (4, 3.0) },
    Rung { stage: Stage::FewSubsteps, fidelity: Fidelity::FewSubsteps, world: false, steps: 0, keep: (2, 2.0) },
    Rung { stage: Stage::FewSubstepsOn, fidelity: Fidelity::FewSubsteps, world: false, steps: 1, keep: (1, 1.5) },
];

/// A hypothesis goes on whose loss is at most so many times that of the best: on the full grid, and once the shape is fitted to the motion.
const GO_ON: [f64; 2] = [1.5, 1.3];

impl Context<'_> {
    /// From a body in flight to the posterior: the pool on a coarse body, the better ones on the full one, and in rounds the shape from the
    /// whole motion and the material with the velocity and the height of the ground.
    pub fn by_pool(&self, run: &mut Run, start: &Unknowns) -> Result<()> {
        let families = self.families(run)?;
        let survivors = self.halve(run, &families, start)?;
        let families = decide(run, families, &survivors)?;
        let law = run.config.law()?;
        let context = Context { law: &law, ..*self };
        let mut survivors: Vec<Hypothesis> =
            survivors.into_iter().filter(|one| families.iter().any(|family| family.name == one.family)).collect();
        for round in (1..=run.config.estimate.rounds).map(number) {
            survivors = context.body(run, round, &families, survivors)?;
            let full = Level { particles: context.particles(run)?, observed: self.observed };
            let (steps, most) = (run.config.estimate.steps.div_ceil(2), run.config.estimate.survivors);
            let rung = Rung {
                stage: Stage::MaterialAgain(round),
                fidelity: Fidelity::Full,
                world: true,
                steps,
                keep: (most, GO_ON[1]),
            };
            survivors = context.rung(run, rung, &families, &full, survivors)?;
        }
        let full = Level { particles: context.particles(run)?, observed: self.observed };
        context.survey(run, Stage::Posterior, &families, &full, &survivors)?;
        context.conclude(run, &families)
    }

    /// Fits the body to the whole motion, held as it was, and of solids then as they move with the new shape; keeps the shape with which the
    /// best survivor is the more probable. The survivors with it.
    fn body(
        &self,
        run: &mut Run,
        round: u16,
        families: &[Family],
        mut survivors: Vec<Hypothesis>,
    ) -> Result<Vec<Hypothesis>> {
        let cost = |run: &mut Run, stage: Stage, best: &Hypothesis| {
            let full = Level { particles: self.particles(run)?, observed: self.observed };
            let rung = Rung { stage, fidelity: Fidelity::Full, world: true, steps: 0, keep: (1, f64::INFINITY) };
            let since = Instant::now();
            let found = match self.rung(run, rung, families, &full, vec![best.clone()]) {
                Ok(found) => found,
                // what cannot be simulated is as improbable as can be; the run knows it when it goes on with the shape from before
                Err(error) if error.kind() == ErrorKind::Physics => {
                    let broken = vec![Hypothesis::new(&best.family, best.unknowns.clone())];
                    run.state.survivors.insert(stage, broken.clone());
                    run.finish(stage, since)?;
                    broken
                }
                Err(error) => return Err(error),
            };
            Ok::<_, gradreel::Error>(found[0].cost.unwrap_or(f64::INFINITY))
        };
        self.reshape(run, Stage::ShapeInMotion(round), &survivors[0].unknowns)?;
        if run.config.flows(self.law) {
            // what flows forgets its shape
            return Ok(survivors);
        }
        let (stage, undone) = (Stage::Together(round), Stage::Undone(round));
        if run.has_finished(undone) {
            return Ok(survivors);
        }
        let held = cost(run, Stage::HeldAgreement(round), &survivors[0])?;
        match self.reshape_and_follow(run, stage, &survivors[0].unknowns) {
            Ok(unknowns) => {
                let followed = Hypothesis { unknowns, ..survivors[0].clone() };
                if cost(run, Stage::TogetherAgreement(round), &followed)? < held {
                    survivors[0] = followed;
                    return Ok(survivors);
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                run.note(format!("{stage}: given up: {error}"));
            }
            Err(error) => return Err(error),
        }
        let since = Instant::now();
        run.restore_field()?;
        run.finish(undone, since)?;
        Ok(survivors)
    }

    /// The pool on the coarse body, and the better ones on the full one.
    fn halve(&self, run: &mut Run, families: &[Family], start: &Unknowns) -> Result<Vec<Hypothesis>> {
        let particles = self.particles(run)?;
        let small = Observed::of(&self.clip.scaled(2), &run.config, DTYPE)?;
        let coarse = Level { particles: particles.merged(), observed: &small };
        let full = Level { particles, observed: self.observed };
        let (steps, most) = (run.config.estimate.steps, run.config.estimate.survivors);
        let mut survivors = self.pool(run, families, start)?;
        for rung in RUNGS {
            let level = if rung.fidelity == Fidelity::Coarse { &coarse } else { &full };
            let (times, worse) = rung.keep;
            survivors = self.rung(run, Rung { keep: (times * most, worse), ..rung }, families, level, survivors)?;
        }
        let last =
            Rung { stage: Stage::Material, fidelity: Fidelity::Full, world: false, steps, keep: (most, GO_ON[0]) };
        self.rung(run, last, families, &full, survivors)
    }
}

/// The families that go on: of several, that of the best survivor, on its kind of ground.
fn decide(run: &mut Run, families: Vec<Family>, survivors: &[Hypothesis]) -> Result<Vec<Family>> {
    if families.len() == 1 {
        return Ok(families);
    }
    let best = survivors[0].family.clone();
    let family = &families[place(&families, &best)];
    if run.config.chooses_family() {
        run.config.material = MaterialConfig { name: family.material.clone(), ..MaterialConfig::default() };
    }
    run.config.world.ground_contact = family.config.world.ground_contact;
    run.save()?;
    run.save_config()?;
    Ok(families.into_iter().filter(|family| family.name == best).collect())
}
