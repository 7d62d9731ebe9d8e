//! The stages of the pool in their order.

use gradreel::Result;

use super::rung::{Family, Level, Rung};
use crate::identify::hypotheses::Hypothesis;
use crate::identify::reconstruct::{DTYPE, Stages};
use crate::identify::run::Run;
use crate::identify::{MaterialConfig, Observed, Unknowns};

/// How many times as many hypotheses are searched on the coarse grid as on the full one.
const COARSE: usize = 4;

/// Gauss–Newton steps of each there.
const COARSE_STEPS: usize = 5;

/// A hypothesis goes on whose loss is at most so many times that of the best: after the first look, on the coarse grid, on the full one, and
/// once the shape is fitted to the motion.
const GO_ON: [f64; 4] = [4.0, 2.0, 1.5, 1.3];

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
            stages.reshape(run, &format!("shape in motion {round}"), &survivors[0].unknowns)?;
            let full = Level { particles: stages.particles(run)?, observed: self.observed };
            let stage = format!("material {round}");
            let (steps, most) = (run.config.pool.steps.div_ceil(2), run.config.pool.survivors);
            let rung = Rung { stage: &stage, coarse: false, world: true, steps, keep: (most, GO_ON[3]) };
            survivors = stages.rung(run, rung, &families, &full, survivors)?;
        }
        let full = Level { particles: stages.particles(run)?, observed: self.observed };
        stages.survey(run, "posterior", &families, &full, &survivors)?;
        stages.conclude(run, &families)
    }

    /// The pool on the coarse body, and the better ones on the full one.
    fn halve(&self, run: &mut Run, families: &[Family], start: &Unknowns) -> Result<Vec<Hypothesis>> {
        let particles = self.particles(run)?;
        let small = Observed::of(&self.clip.scaled(2), &run.config, DTYPE)?;
        let coarse = Level { particles: particles.merged(), observed: &small };
        let full = Level { particles, observed: self.observed };
        let (steps, most) = (run.config.pool.steps, run.config.pool.survivors);
        let rung = |stage, coarse, steps, keep| Rung { stage, coarse, world: false, steps, keep };
        let pool = self.pool(run, families, start)?;
        let first = rung("what is plausible", true, 0, (COARSE * most, GO_ON[0]));
        let survivors = self.rung(run, first, families, &coarse, pool)?;
        let second = rung("material, coarse", true, COARSE_STEPS, (most, GO_ON[1]));
        let survivors = self.rung(run, second, families, &coarse, survivors)?;
        self.rung(run, rung("material", false, steps, (most, GO_ON[2])), families, &full, survivors)
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
