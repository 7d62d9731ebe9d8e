//! Which family of materials it is, when nobody said: each is fitted to the first frames, and has to agree with all of them.

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
    /// The mean loss of all frames.
    #[serde(default)]
    pub all: f64,
}

/// What a parameter must be worth: a family with one more is chosen if its loss is smaller by this factor. Those that contain
/// another (a plasticine that hardly yields is a rubber) can imitate it.
const PARSIMONY: f64 = 1.075;

/// The candidate to go on with: the one of least loss over all frames for the number of its parameters, which `parameters` tells. Frames
/// that it was fitted to count as well as those that it foretold: a law that cannot even fit them is not that of the object.
pub fn choose(candidates: &[Candidate], parameters: impl Fn(&str) -> usize) -> Option<&Candidate> {
    let price = |candidate: &Candidate| candidate.all * PARSIMONY.powi(parameters(&candidate.family) as i32);
    candidates.iter().filter(|candidate| candidate.all.is_finite()).min_by(|a, b| price(a).total_cmp(&price(b)))
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
            candidates.push(Candidate { family: family.to_owned(), unknowns, seen: first, foretold, all });
        }
        let searched = |law: Law| law.parameters().iter().filter(|p| published(&law, p).is_none()).count();
        let size = |family: &str| law_of(family).map_or(usize::MAX, searched);
        let Some(winner) = choose(&candidates, size) else {
            return Err(Error::new(ErrorKind::Physics, "no family of materials can be simulated with this object")
                .fix("check the size of the object and the ground with `gradreel check`"));
        };
        let family = winner.family.clone();
        run.note(format!(
            "the family was chosen by how well each, fitted to the frames before {seen}, agrees with all: {family}"
        ));
        // what the run has found so far is of the material that its file names
        run.state.unknowns = Some(winner.unknowns.clone());
        run.config.material = MaterialConfig { name: family, ..MaterialConfig::default() };
        run.state.candidates = candidates;
        run.save()?;
        run.save_config()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_wins_unless_a_simpler_one_does_nearly_as_well() {
        let candidate = |family: &str, all| Candidate {
            family: family.into(),
            unknowns: Unknowns::default(),
            seen: all,
            foretold: all,
            all,
        };
        let size = |family: &str| family.len();
        let three = [candidate("longer", 0.100), candidate("long", 0.109), candidate("s", 0.2)];
        // two parameters more are worth a seventh, five more not a half
        assert_eq!(choose(&three, size).unwrap().family, "long");
        assert_eq!(choose(&three[..1], size).unwrap().family, "longer");
        let two = [candidate("longer", 0.100), candidate("long", 0.117)];
        assert_eq!(choose(&two, size).unwrap().family, "longer");
        assert!(choose(&[candidate("s", f64::NAN)], size).is_none());
    }
}
