//! What yields hardly tells how stiff it was before: how far its losses leave that open, and a second start.

use gradreel::Result;

use crate::identify::reconstruct::{MATERIAL, Stages};
use crate::identify::run::Run;
use crate::identify::stages::{Effort, HOPELESS};
use crate::identify::unknowns::Unknown;
use crate::identify::{Free, Method, Unknowns};
use crate::physics::{Map, width};

/// The stage that tries each magnitude larger and smaller, and the one that searches from the best of these.
const ENDS: &str = "material, stiffer and softer";
const OTHER: &str = "material, from the other end";

/// How far a second start lies from where the first search ended, in decades: a search of three crossed bars ended a factor of 3 below their modulus,
/// and at 4 times the one found the loss was 1.3 times that there; a search from there ended lower.
const APART: f64 = 0.6;

/// Losses that differ by this share are those of ends that one can be taken for the other at odds of e: what a shape is fitted to changes them by more.
const TOLD: f64 = 0.1;

impl Stages<'_> {
    /// Looks at what is several times stiffer or softer, stronger or weaker, of bodies that yield and that several cameras saw. Those that do not
    /// flow are searched once more from whichever agrees best with the pictures, and what follows goes on from where that ends if it is lower. (Of
    /// a cream the search from a quarter of the modulus found came back to it.)
    pub(super) fn other_end(&self, run: &mut Run, frames: usize, unknowns: &mut Unknowns) -> Result<()> {
        let config = &run.config;
        if self.law.is_elastic() || !self.several_cameras() || config.estimate.method == Method::Descent {
            return Ok(());
        }
        let free = self.free(run, config)?;
        self.scan(run, ENDS, free, frames, &mut unknowns.clone(), &|start| self.ends(start, free))?;
        let tried = self.tried(run, ENDS);
        let Some((here, others)) = tried.split_first() else { return Ok(()) };
        let Some(best) = others.iter().min_by(|a, b| a.loss.total_cmp(&b.loss)) else { return Ok(()) };
        if !run.config.flows(self.law) && best.loss <= HOPELESS * here.loss {
            let mut there = best.unknowns.clone();
            self.fine(run, &Effort::new(OTHER, run.config.fine_of(self.law)), frames, &mut there)?;
            if self.lower_end(run) == OTHER {
                *unknowns = there;
            }
        }
        run.state.unknowns = Some(unknowns.clone());
        run.save()
    }

    /// Each free magnitude of the material a few times larger and smaller, as far as that is plausible.
    fn ends(&self, start: &Unknowns, free: Free) -> Vec<Unknowns> {
        let x = start.coordinates(self.law, free);
        let list = free.list(self.law);
        let moved = |(k, sign): (usize, f64)| {
            let Unknown::Parameter(p) = list[k] else { return None };
            let parameter = &self.law.parameters()[p];
            let mut x = x.clone();
            x[k] += sign * APART;
            let there = start.moved(self.law, free, &x);
            let plausible = (parameter.prior[0]..=parameter.prior[1]).contains(&there.parameters[p]);
            (parameter.map == Map::Log10 && plausible).then_some(there)
        };
        (0..list.len()).flat_map(|k| [(k, 1.0), (k, -1.0)]).filter_map(moved).collect()
    }

    /// The deviation of a parameter, in decades, that the losses of [`Stages::ends`] leave it by themselves: `d √(t/2r)` if they are `r` times higher
    /// on average at a distance of `d` to both sides, and `t` ([`TOLD`]) times higher at odds of e. 0 of what was not tried.
    pub(super) fn left_open(&self, run: &Run, parameter: usize) -> f64 {
        let tried = self.tried(run, ENDS);
        let Some((here, others)) = tried.split_first() else { return 0.0 };
        let there =
            others.iter().filter(|end| end.unknowns.parameters[parameter] != here.unknowns.parameters[parameter]);
        let rises: Vec<f64> = there.map(|end| end.loss / here.loss - 1.0).collect();
        let widest = width(self.law.parameters()[parameter].prior.map(f64::log10));
        if rises.is_empty() { 0.0 } else { open(rises.iter().sum::<f64>() / rises.len() as f64).min(widest) }
    }

    /// The stage whose end what follows goes on from: the search for the material, or that from the other end if it ended lower.
    pub(super) fn lower_end(&self, run: &Run) -> &'static str {
        let lower = run.has_finished(OTHER) && run.least_loss(OTHER) < run.least_loss(MATERIAL);
        if lower { OTHER } else { MATERIAL }
    }

    /// The deviation of the free unknowns' coordinates, away from `here`, for another end that the pictures do not rule out: with odds `p`
    /// that it is the right one, `√p` times the way there.
    pub(super) fn other_end_error(&self, run: &Run, free: Free, here: &[f64]) -> Vec<f64> {
        let taken = self.lower_end(run);
        let left = if taken == OTHER { MATERIAL } else { OTHER };
        let (true, Some((end, loss))) = (run.has_finished(OTHER), run.best_of(left)) else {
            return vec![0.0; here.len()];
        };
        let share = doubt(loss / run.least_loss(taken)).sqrt();
        let there = end.coordinates(self.law, free);
        there.iter().zip(here).map(|(there, here)| share * (there - here)).collect()
    }
}

/// The deviation in decades of what has a loss so many times higher, less one, at a distance of [`APART`].
fn open(rise: f64) -> f64 {
    APART * (TOLD / (2.0 * rise.max(f64::MIN_POSITIVE))).sqrt()
}

/// The probability of an end whose loss is so many times that of a lower one.
fn doubt(times: f64) -> f64 {
    1.0 / (1.0 + ((times - 1.0) / TOLD).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_as_probable_as_their_losses_are_low() {
        approx::assert_relative_eq!(doubt(1.0), 0.5);
        approx::assert_relative_eq!(doubt(1.1), 1.0 / (1.0 + std::f64::consts::E), max_relative = 1e-12);
        // at a distance of a deviation the loss has risen by half of what is odds of e
        approx::assert_relative_eq!(open(TOLD / 2.0), APART);
        assert!(open(1e300) < 1e-100 && open(f64::INFINITY) == 0.0 && open(-1.0) > 1e3);
        assert!(doubt(1.5) < 0.01 && doubt(1e300) == 0.0 && doubt(f64::INFINITY) == 0.0);
    }
}
