//! The stages of the pool in their order.

use std::time::Instant;

use gradreel::{ErrorKind, Result};

use super::rung::{Family, Fidelity, Level, Rung};
use crate::identify::hypotheses::Hypothesis;
use crate::identify::reconstruct::{DTYPE, Stages};
use crate::identify::run::Run;
use crate::identify::{MaterialConfig, Observed, Unknowns};

/// The rungs before the full forward model: name, how faithful it is, Gauss–Newton steps of each hypothesis, how many times as many go on as
/// are searched at last, and how many times the loss of the best theirs may be. A coarse body tells good from bad, but not the best from the
/// second best, so that it is searched little and hands on many.
const RUNGS: [(&str, Fidelity, usize, usize, f64); 4] = [
    ("what is plausible", Fidelity::Coarse, 0, 12, 4.0),
    ("material, coarse", Fidelity::Coarse, 1, 6, 3.0),
    ("material, few substeps", Fidelity::FewSubsteps, 0, 3, 2.0),
    ("material, few substeps, on", Fidelity::FewSubsteps, 2, 1, 1.5),
];

/// A hypothesis goes on whose loss is at most so many times that of the best: on the full grid, and once the shape is fitted to the motion.
const GO_ON: [f64; 2] = [1.5, 1.3];

impl Stages<'_> {
    /// From a body in flight to the posterior: the pool on a coarse body, the better ones on the full one, and in rounds the shape from the
    /// whole motion and the material with the velocity and the height of the ground.
    pub fn by_pool(&self, run: &mut Run, start: &Unknowns) -> Result<()> {
        let families = self.families(run)?;
        let survivors = self.halve(run, &families, start)?;
        let families = decide(run, families, &survivors)?;
        let law = run.config.law()?;
        let stages = Stages { law: &law, ..*self };
        let mut survivors: Vec<Hypothesis> =
            survivors.into_iter().filter(|one| families.iter().any(|family| family.name == one.family)).collect();
        for round in 1..=run.config.pool.rounds {
            survivors = stages.body(run, round, &families, survivors)?;
            let full = Level { particles: stages.particles(run)?, observed: self.observed };
            let stage = format!("material {round}");
            let (steps, most) = (run.config.pool.steps.div_ceil(2), run.config.pool.survivors);
            let rung = Rung { stage: &stage, fidelity: Fidelity::Full, world: true, steps, keep: (most, GO_ON[1]) };
            survivors = stages.rung(run, rung, &families, &full, survivors)?;
        }
        let full = Level { particles: stages.particles(run)?, observed: self.observed };
        stages.survey(run, "posterior", &families, &full, &survivors)?;
        stages.conclude(run, &families)
    }

    /// Fits the body to the whole motion, held as it was, and of solids then as they move with the new shape; keeps the shape with which the
    /// best survivor is the more probable. The survivors with it.
    fn body(
        &self,
        run: &mut Run,
        round: usize,
        families: &[Family],
        survivors: Vec<Hypothesis>,
    ) -> Result<Vec<Hypothesis>> {
        let agrees = |run: &mut Run, stage: &str, survivors: &[Hypothesis]| {
            let full = Level { particles: self.particles(run)?, observed: self.observed };
            let keep = (survivors.len(), f64::INFINITY);
            let rung = Rung { stage, fidelity: Fidelity::Full, world: true, steps: 0, keep };
            let best = self.rung(run, rung, families, &full, survivors[..1].to_vec())?;
            Ok::<_, gradreel::Error>(best[0].cost.unwrap_or(f64::INFINITY))
        };
        self.reshape(run, &format!("shape in motion {round}"), &survivors[0].unknowns)?;
        if run.config.flows(self.law) {
            // what flows forgets its shape
            return Ok(survivors);
        }
        let stage = format!("shape and material {round}");
        let undone = format!("{stage}: undone");
        if run.has_finished(&undone) {
            return Ok(survivors);
        }
        let held = agrees(run, &format!("shape in motion {round}: agreement"), &survivors)?;
        let better = match self.reshape_and_follow(run, &stage, &survivors[0].unknowns) {
            Ok(unknowns) => {
                let mut better = survivors.clone();
                better[0].unknowns = unknowns;
                (agrees(run, &format!("{stage}: agreement"), &better)? < held).then_some(better)
            }
            Err(error) if matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                run.note(format!("{stage}: given up: {error}"));
                None
            }
            Err(error) => return Err(error),
        };
        if let Some(better) = better {
            return Ok(better);
        }
        let since = Instant::now();
        run.restore_field()?;
        run.finish(&undone, since)?;
        Ok(survivors)
    }

    /// The pool on the coarse body, and the better ones on the full one.
    fn halve(&self, run: &mut Run, families: &[Family], start: &Unknowns) -> Result<Vec<Hypothesis>> {
        let particles = self.particles(run)?;
        let small = Observed::of(&self.clip.scaled(2), &run.config, DTYPE)?;
        let coarse = Level { particles: particles.merged(), observed: &small };
        let full = Level { particles, observed: self.observed };
        let (steps, most) = (run.config.pool.steps, run.config.pool.survivors);
        let rung = |stage, fidelity, steps, keep| Rung { stage, fidelity, world: false, steps, keep };
        let mut survivors = self.pool(run, families, start)?;
        for (stage, fidelity, steps, times, worse) in RUNGS {
            let level = if fidelity == Fidelity::Coarse { &coarse } else { &full };
            survivors =
                self.rung(run, rung(stage, fidelity, steps, (times * most, worse)), families, level, survivors)?;
        }
        self.rung(run, rung("material", Fidelity::Full, steps, (most, GO_ON[0])), families, &full, survivors)
    }
}

/// The families that go on: of several, that of the best survivor.
fn decide(run: &mut Run, families: Vec<Family>, survivors: &[Hypothesis]) -> Result<Vec<Family>> {
    if !run.config.chooses_family() {
        return Ok(families);
    }
    let best = survivors[0].family.clone();
    run.config.material = MaterialConfig { name: best.clone(), ..MaterialConfig::default() };
    run.save()?;
    run.save_config()?;
    Ok(families.into_iter().filter(|family| family.name == best).collect())
}
