//! Which family of materials it is, when nobody said: each is fitted to the first frames and has to foretell the others.

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::identify::config::published;
use crate::identify::reconstruct::{DTYPE, Stages};
use crate::identify::run::Run;
use crate::identify::stages::AUTO;
use crate::identify::{FAMILIES, MaterialConfig, Problem, Unknowns, law_of};
use crate::physics::{Law, materials};

/// What one family made of a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Name of the family, as in [`FAMILIES`].
    pub family: String,
    /// Its best material.
    pub unknowns: Unknowns,
    /// The mean loss of the frames it was fitted to.
    pub seen: f64,
    /// The mean loss of the frames after those.
    pub foretold: f64,
}

/// A family with fewer parameters is preferred as long as its loss is at most this much larger: those that contain it (a
/// plasticine that hardly yields is a rubber) can imitate it.
const PARSIMONY: f64 = 1.1;

/// The candidate to go on with: the one that foretells best, or a simpler one that does nearly as well. `parameters` tells how
/// many of a family's are searched.
pub fn choose(candidates: &[Candidate], parameters: impl Fn(&str) -> usize) -> Option<&Candidate> {
    let sound = || candidates.iter().filter(|candidate| candidate.foretold.is_finite());
    let best = sound().map(|candidate| candidate.foretold).fold(f64::INFINITY, f64::min);
    sound().filter(|candidate| candidate.foretold <= PARSIMONY * best).min_by(|a, b| {
        let size = |candidate: &Candidate| parameters(&candidate.family);
        size(a).cmp(&size(b)).then(a.foretold.total_cmp(&b.foretold))
    })
}

impl Stages<'_> {
    /// Fits every family to three fifths of the frames in contact, lets it foretell the rest, and makes the
    /// run one of the family that [`choose`] names.
    pub(super) fn choose_family(&self, run: &mut Run, contact: usize, frames: usize, start: &Unknowns) -> Result<()> {
        let seen =
            (contact + (3 * frames.saturating_sub(contact)).div_ceil(5)).clamp(1, frames.saturating_sub(1).max(1));
        let particles = self.particles(run)?;
        let mut candidates = Vec::new();
        for (family, law) in FAMILIES {
            let law = materials::find(law).expect("families have laws");
            let stages = Stages { law: &law, ..*self };
            let mut own = run.config.clone();
            own.material = MaterialConfig { name: family.to_owned(), ..MaterialConfig::default() };
            let mut unknowns = Unknowns { parameters: own.starting_values(&law)?, ..start.clone() };
            stages.explore(run, &own, &format!("{AUTO} {family}"), seen, &mut unknowns)?;
            let problem = Problem::new(&particles, self.observed, law.clone(), &run.config, DTYPE);
            let loss = |frames: usize| match problem.misfit(&unknowns, frames, &mut 0, &mut |_| ()) {
                Err(error) if error.kind() == ErrorKind::Physics => Ok(f64::MAX),
                loss => loss,
            };
            let (first, all) = (loss(seen)?, loss(frames)?);
            let rest = (frames - seen).max(1) as f64;
            let foretold = ((all * frames as f64 - first * seen as f64) / rest).min(f64::MAX);
            candidates.push(Candidate { family: family.to_owned(), unknowns, seen: first, foretold });
        }
        let searched = |law: Law| law.parameters().iter().filter(|p| published(&law, p).is_none()).count();
        let size = |family: &str| law_of(family).map_or(usize::MAX, searched);
        let Some(winner) = choose(&candidates, size) else {
            return Err(Error::new(ErrorKind::Physics, "no family of materials can be simulated with this object")
                .fix("check the size of the object and the ground with `gradreel check`"));
        };
        let family = winner.family.clone();
        run.note(format!("the family was chosen by how well each foretold frames {seen} to {}: {family}", frames - 1));
        // what the run has found so far is of the material that its file names
        run.state.unknowns = Some(winner.unknowns.clone());
        run.config.material = MaterialConfig { name: family, ..MaterialConfig::default() };
        run.state.candidates = candidates;
        run.save()?;
        run.folder.write("config.toml", run.config.to_toml()?.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_wins_unless_a_simpler_one_does_nearly_as_well() {
        let candidate = |family: &str, foretold| Candidate {
            family: family.into(),
            unknowns: Unknowns::default(),
            seen: 0.1,
            foretold,
        };
        let size = |family: &str| family.len();
        let three = [candidate("longest", 0.100), candidate("long", 0.105), candidate("s", 0.2)];
        assert_eq!(choose(&three, size).unwrap().family, "long");
        assert_eq!(choose(&three[..1], size).unwrap().family, "longest");
        assert!(choose(&[candidate("s", f64::NAN)], size).is_none());
    }
}
