//! A second look at bodies that keep their shape, before one is taken for something that flows.

use std::time::Instant;

use gradreel::Result;

use crate::identify::family::{Candidate, STAY, choose, of_family};
use crate::identify::reconstruct::{Moved, OF_WHAT_STAYS, Stages};
use crate::identify::run::Run;
use crate::identify::stages::AUTO;
use crate::identify::{Unknowns, law_of};

/// A rubber whose loss is so many times that of the best at most is looked at again. Of films of anything else it was 15 to 50 times that; of a
/// bird of rubber, which has thin parts, 2.3 times.
const NEAR: f64 = 4.0;

/// The stage that ends it.
const LOOKED: &str = "auto: solids";

impl Stages<'_> {
    /// Looks again at the families of bodies that keep their shape, with the shape and surface that they are given once they are chosen. While the family
    /// is open all are pictured as what flows, smooth and sharpened, and that eats thin parts: the bird of rubber had a loss of 0.093 then, whatever its
    /// modulus, and of 0.039 with its wings; it was taken for a paste (0.047). Only where rubber is not the best but [`NEAR`] it: pictures that differ
    /// cannot be compared closely, and of films of anything else rubber is far from it.
    pub(super) fn look_again(
        &self,
        run: &mut Run,
        frames: [usize; 3],
        flying: Moved<'_>,
        start: &Unknowns,
    ) -> Result<()> {
        let chosen = |run: &Run| choose(&run.state.candidates, self.observed.pictures(), frames[2]).cloned();
        if !run.has_finished(LOOKED) {
            let Some(winner) = chosen(run) else { return Ok(()) };
            let near = |rubber: &Candidate| rubber.all <= NEAR * winner.all;
            let rubber = run.state.candidates.iter().find(|candidate| candidate.family == STAY[0]);
            if winner.family == STAY[0] || !rubber.is_some_and(near) {
                return Ok(());
            }
            let since = Instant::now();
            // pictured as one of them; the run's file goes on to say that the family is open
            let rubber = of_family(run, STAY[0]).material;
            run.open = Some(std::mem::replace(&mut run.config.material, rubber));
            let looked = self.of_what_stays(run, frames, flying, start);
            run.config.material = run.open.take().unwrap_or_default();
            for candidate in looked? {
                if let Some(other) = run.state.candidates.iter_mut().find(|other| other.family == candidate.family) {
                    *other = candidate;
                }
            }
            run.finish(LOOKED, since)?;
        }
        // what flows has the shape that it had
        if chosen(run).is_some_and(|winner| !STAY.contains(&&*winner.family)) {
            run.restore_field()?;
        }
        Ok(())
    }

    /// The families of bodies that keep their shape, each with the shape of what does.
    fn of_what_stays(
        &self,
        run: &mut Run,
        [contact, seen, frames]: [usize; 3],
        flying: Moved<'_>,
        start: &Unknowns,
    ) -> Result<Vec<Candidate>> {
        let laws = STAY.map(|family| law_of(family).expect("families have laws"));
        let [rubber, solid] = [0, 1].map(|k| Stages { law: &laws[k], ..*self });
        rubber.choose_surface(run)?;
        self.keep_before(run, OF_WHAT_STAYS)?;
        rubber.shape(run, OF_WHAT_STAYS, run.config.geometry.fit.iterations, flying)?;
        let stage = format!("{AUTO} {}: as it is", STAY[0]);
        let first = rubber.explored(run, STAY[0], &stage, [contact, seen, frames], start)?;
        let before = run.state.candidates.iter().find(|candidate| candidate.family == STAY[1]);
        let mut unknowns = before.map_or_else(|| start.clone(), |candidate| candidate.unknowns.clone());
        let own = of_family(run, STAY[1]);
        solid.short_search(run, &own, &format!("{AUTO} {}: as it is", STAY[1]), seen, &mut unknowns)?;
        let second = solid.candidate(run, STAY[1], unknowns, [seen, frames])?;
        let mut both = vec![first, second];
        self.search_from_kin(run, [STAY[1], STAY[0]], ", as it is", &mut None, [seen, frames], &mut both)?;
        Ok(both)
    }
}
