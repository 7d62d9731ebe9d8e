//! Which family of materials it is, when nobody said: each is fitted to the first frames, and has to agree with all of them.

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::identify::plausible::Plausible;
use crate::identify::reconstruct::{DTYPE, Moved, Stages};
use crate::identify::run::Run;
use crate::identify::stages::AUTO;
use crate::identify::{Config, FAMILIES, Free, MaterialConfig, Problem, Unknowns, law_of};
use crate::physics::{Law, lame, materials};

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
    /// How unusual such a material is, and how many parameters were searched: `½ Σ z² + k` \[nat\], with `z` in standard deviations from
    /// what materials usually have ([`Parameter::usual`](crate::physics::Parameter::usual)).
    #[serde(default)]
    pub price: f64,
}

impl Candidate {
    /// What speaks against it after so many pictures, `½ n ln(loss) + ½ Σ z² + k` \[nat\]: minus the logarithm of how probable they are
    /// with such a material, but for a constant. A loss is as the square of an error whose size is not known, and alike over a picture, so
    /// that each picture counts once; a parameter costs as much as fitting it to noise gains (Akaike 1974).
    pub fn against(&self, pictures: usize) -> f64 {
        0.5 * pictures as f64 * self.all.ln() + self.price
    }
}

/// Every candidate with how much less probable it is than the most probable one, after so many pictures \[nat\].
///
/// ```
/// use gradreel_models::identify::{Candidate, Unknowns, compared};
///
/// let of = |family: &str, all| {
///     let (family, unknowns) = (family.to_owned(), Unknowns::default());
///     Candidate { family, unknowns, seen: all, foretold: all, all, price: 2.0 }
/// };
/// let candidates = [of("elastic", 0.1), of("sand", 0.2)];
/// let [best, other] = compared(&candidates, 98)[..] else { panic!("two of two") };
/// assert!(best.1 == 0.0 && (other.1 - 49.0 * 2f64.ln()).abs() < 1e-9);
/// ```
pub fn compared(candidates: &[Candidate], pictures: usize) -> Vec<(&Candidate, f64)> {
    let least = candidates.iter().map(|candidate| candidate.against(pictures)).fold(f64::INFINITY, f64::min);
    candidates.iter().map(|candidate| (candidate, candidate.against(pictures) - least)).collect()
}

/// The candidate to go on with, of so many pictures of so many frames: the one against which least speaks. Frames that it was fitted to count as
/// well as those that it foretold: a law that cannot even fit them is not that of the object. Nor is one that fits them by numbers that no such
/// material has: a paste whose shear modulus is ten thousand times its yield stress only imitates a fluid.
///
/// Plasticine has to be more probable than rubber by the frames alone, too. What a shape lacks is alike in all pictures of a frame; how it
/// bounces and rolls on shows that more than its material, and yielding makes up for some of it.
pub fn choose(candidates: &[Candidate], pictures: usize, frames: usize) -> Option<&Candidate> {
    let against = |candidate: &Candidate| candidate.against(pictures);
    let usable = || candidates.iter().filter(|candidate| candidate.all.is_finite());
    let best = usable().min_by(|a, b| against(a).total_cmp(&against(b)))?;
    let [rubber, plasticine] = STAY;
    let simpler = usable().find(|candidate| candidate.family == rubber && best.family == plasticine);
    Some(simpler.filter(|rubber| rubber.against(frames) < best.against(frames)).unwrap_or(best))
}

/// Families that contain another: a fluid beyond a yield stress without its viscosity is plasticine, and that is rubber if it never yields.
const CONTAINING: [[&str; 2]; 2] = [["non_newtonian", STAY[1]], [STAY[1], STAY[0]]];

/// The families of bodies that keep their shape until they yield.
pub(super) const STAY: [&str; 2] = ["elastic", "plasticine"];

/// A family whose loss is so many times that of the best is not looked for again: more than a better start can mend.
const BEATEN: f64 = 2.0;

/// Shear and bulk modulus \[Pa\] of a law's parameters, if they tell them.
fn moduli(law: &Law, values: &[f64]) -> Option<[f64; 2]> {
    let value = |name| law.parameters().iter().position(|p| p.name == name).map(|k| values[k]);
    value("shear").zip(value("bulk")).map(|(shear, bulk)| [shear, bulk]).or_else(|| {
        let (mu, lambda) = value("young").zip(value("poisson")).map(|(young, poisson)| lame(young, poisson))?;
        Some([mu, lambda + 2.0 / 3.0 * mu])
    })
}

/// Parameters of the law `to` with which it does what `from` does with these `values`, as far as they have names or moduli in common;
/// the rest as it is in `rest`. Each within its plausible range.
fn alike(from: &Law, values: &[f64], to: &Law, rest: &[f64]) -> Vec<f64> {
    let same = |name| from.parameters().iter().position(|p| p.name == name).map(|k| values[k]);
    let elastic = |name: &str| {
        let [shear, bulk] = moduli(from, values)?;
        match name {
            "shear" => Some(shear),
            "bulk" => Some(bulk),
            "young" => Some(9.0 * bulk * shear / (3.0 * bulk + shear)),
            "poisson" => Some((3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear)),
            _ => None,
        }
    };
    let known = to.parameters().iter().map(|p| (p, same(p.name).or_else(|| elastic(p.name))));
    known.zip(rest).map(|((p, known), rest)| known.map_or(*rest, |x| x.clamp(p.prior[0], p.prior[1]))).collect()
}

impl Stages<'_> {
    /// Fits every family to three fifths of the frames in contact, lets it foretell the rest, and makes the
    /// run one of the family that [`choose`] names.
    pub(super) fn choose_family(
        &self,
        run: &mut Run,
        contact: usize,
        frames: usize,
        flying: Moved<'_>,
        start: &Unknowns,
    ) -> Result<()> {
        let seen =
            (contact + (3 * frames.saturating_sub(contact)).div_ceil(5)).clamp(1, frames.saturating_sub(1).max(1));
        if run.state.candidates.is_empty() {
            run.state.candidates = self.compare(run, [contact, seen, frames], start)?;
            // from here on the voxels may be others than what they were compared with
            run.save()?;
        }
        self.look_again(run, [contact, seen, frames], flying, start)?;
        let Some(winner) = choose(&run.state.candidates, self.observed.pictures(), frames).cloned() else {
            return Err(Error::new(ErrorKind::Physics, "no family of materials can be simulated with this object")
                .fix("check the size of the object and the ground with `gradreel check`"));
        };
        let family = winner.family;
        run.note(format!(
            "the family was chosen by how well each, fitted to the frames before {seen}, agrees with all, and how usual it is: {family}"
        ));
        // what the run has found so far is of the material that its file names
        run.state.unknowns = Some(winner.unknowns);
        run.config.material = MaterialConfig { name: family, ..MaterialConfig::default() };
        run.save()?;
        run.save_config()
    }

    /// What every family makes of the clip.
    fn compare(&self, run: &mut Run, [contact, seen, frames]: [usize; 3], start: &Unknowns) -> Result<Vec<Candidate>> {
        let mut candidates = Vec::new();
        for (family, law) in FAMILIES {
            let law = materials::find(law).expect("families have laws");
            let stages = Stages { law: &law, ..*self };
            let stage = format!("{AUTO} {family}");
            candidates.push(stages.explored(run, family, &stage, [contact, seen, frames], start)?);
        }
        let mut from = [None, None];
        for again in ["", ", again"] {
            for (pair, from) in CONTAINING.iter().zip(&mut from) {
                self.search_from_kin(run, *pair, again, from, [seen, frames], &mut candidates)?;
            }
        }
        Ok(candidates)
    }

    /// What a family makes of the clip from nothing, in stages whose names begin with `stage`.
    pub(super) fn explored(
        &self,
        run: &mut Run,
        family: &str,
        stage: &str,
        [contact, seen, frames]: [usize; 3],
        start: &Unknowns,
    ) -> Result<Candidate> {
        let own = of_family(run, family);
        let mut unknowns = Unknowns { parameters: own.starting_values(self.law)?, ..start.clone() };
        let early = self.explore(run, &own, stage, [contact, seen], &mut unknowns)?;
        if early < seen {
            self.short_search(run, &own, &format!("{stage}: later"), seen, &mut unknowns)?;
        }
        self.candidate(run, family, unknowns, [seen, frames])
    }

    /// A search from where the better of two families came to, of which the one contains the other, for the worse: two that can do the same
    /// should not be told apart by where their searches began. `from` is where such a search of this pair began last: not there once more.
    pub(super) fn search_from_kin(
        &self,
        run: &mut Run,
        pair: [&str; 2],
        again: &str,
        from: &mut Option<Unknowns>,
        frames: [usize; 2],
        candidates: &mut [Candidate],
    ) -> Result<()> {
        let best = candidates.iter().map(|candidate| candidate.all).fold(f64::INFINITY, f64::min);
        let at = |family: &str| candidates.iter().position(|candidate| candidate.family == family);
        let [Some(one), Some(other)] = pair.map(at) else { return Ok(()) };
        let (better, worse) = if candidates[one].all < candidates[other].all { (one, other) } else { (other, one) };
        let law = |index: usize| law_of(&candidates[index].family).expect("families have laws");
        let (its, to) = (law(better), law(worse));
        let (better, family) = (candidates[better].clone(), candidates[worse].family.clone());
        if better.all > BEATEN * best || from.as_ref() == Some(&better.unknowns) {
            return Ok(());
        }
        *from = Some(better.unknowns.clone());
        let parameters = alike(&its, &better.unknowns.parameters, &to, &candidates[worse].unknowns.parameters);
        let mut unknowns = Unknowns { parameters, ..better.unknowns };
        let stages = Stages { law: &to, ..*self };
        let stage = format!("{AUTO} {family}: from {}{again}", better.family);
        stages.short_search(run, &of_family(run, &family), &stage, frames[0], &mut unknowns)?;
        let found = stages.candidate(run, &family, unknowns, frames)?;
        if found.all < candidates[worse].all {
            candidates[worse] = found;
        }
        Ok(())
    }

    /// What this law makes of the frames it was fitted to, and of all.
    pub(super) fn candidate(
        &self,
        run: &Run,
        family: &str,
        unknowns: Unknowns,
        [seen, frames]: [usize; 2],
    ) -> Result<Candidate> {
        let particles = self.particles(run)?;
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE);
        let loss = |frames: usize| match problem.misfit(&unknowns, frames, &mut 0, &mut |_| ()) {
            Err(error) if error.kind() == ErrorKind::Physics => Ok(f64::MAX),
            loss => loss,
        };
        let (first, all) = (loss(seen)?, loss(frames)?);
        let rest = (frames - seen).max(1) as f64;
        let foretold = ((all * frames as f64 - first * seen as f64) / rest).min(f64::MAX);
        let free = Free::all_but(self.law, &of_family(run, family).held(self.law)?, false);
        let parameters = free.list(self.law).len();
        let plausible = Plausible::new(self.law, free).pulling(vec![1.0; parameters]);
        let price = plausible.penalty(&unknowns).0 + parameters as f64;
        Ok(Candidate { family: family.to_owned(), unknowns, seen: first, foretold, all, price })
    }
}

/// The run's settings for one family, about whose parameters nothing is told.
pub(super) fn of_family(run: &Run, family: &str) -> Config {
    let material = MaterialConfig { name: family.to_owned(), ..MaterialConfig::default() };
    Config { material, ..run.config.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(family: &str, all: f64, price: f64) -> Candidate {
        Candidate { family: family.into(), unknowns: Unknowns::default(), seen: all, foretold: all, all, price }
    }

    #[test]
    fn the_best_wins_unless_a_simpler_or_a_more_usual_one_does_nearly_as_well() {
        let chosen = |candidates: &[Candidate]| choose(candidates, 100, 20).map(|candidate| candidate.family.clone());
        // a hundred pictures: two hundredths of the loss are worth a parameter
        let [simple, better, best] =
            [candidate("simple", 0.103, 1.0), candidate("better", 0.1002, 2.0), candidate("best", 0.099, 4.0)];
        assert_eq!(chosen(&[simple.clone(), better.clone(), best]).unwrap(), "better");
        let unusual = candidate("unusual", 0.099, 2.0 + 0.5 * 3.0 * 3.0);
        assert_eq!(chosen(&[unusual.clone(), better.clone()]).unwrap(), "better");
        // many more pictures know better than what is usual
        assert_eq!(choose(&[unusual, better], 1000, 20).unwrap().family, "unusual");
        assert!(chosen(&[candidate("s", f64::NAN, 0.0)]).is_none());
    }

    #[test]
    fn what_yields_has_to_be_more_probable_than_rubber_by_the_frames_alone() {
        let chosen = |candidates: &[Candidate]| choose(candidates, 98, 14).map(|candidate| candidate.family.clone());
        // a ring of rubber whose shape nobody had seen well, and a lump that yields
        let (yielding, rubber) = (candidate("plasticine", 0.1162, 5.7), candidate("elastic", 0.1540, 2.2));
        assert_eq!(chosen(&[rubber.clone(), yielding.clone()]).unwrap(), "elastic");
        let lump = candidate("plasticine", 0.0163, 6.6);
        assert_eq!(chosen(&[candidate("elastic", 0.4389, 3.5), lump]).unwrap(), "plasticine");
        // of other families each picture counts
        let paste = candidate("non_newtonian", 0.1, 6.9);
        assert_eq!(chosen(&[rubber, yielding, paste]).unwrap(), "non_newtonian");
    }

    #[test]
    fn what_one_law_does_another_does_with_other_names() {
        let [fluid, solid] = ["non_newtonian", "plasticine"].map(|family| law_of(family).unwrap());
        let found = alike(&fluid, &[4e5, 1e6, 9e3, 2.0], &solid, &[1.0, 0.1, 1.0]);
        let (mu, lambda) = lame(found[0], found[1]);
        approx::assert_relative_eq!(mu, 4e5, max_relative = 1e-12);
        approx::assert_relative_eq!(lambda + 2.0 / 3.0 * mu, 1e6, max_relative = 1e-12);
        assert_eq!(found[2], 9e3);
        // and back, where what only the other has stays
        let back = alike(&solid, &found, &fluid, &[1.0, 1.0, 1.0, 7.0]);
        approx::assert_relative_eq!(back[0], 4e5, max_relative = 1e-12);
        approx::assert_relative_eq!(back[1], 1e6, max_relative = 1e-12);
        assert_eq!(back[2..], [9e3, 7.0]);
        // what expands when pulled is not plausible of a solid
        assert_eq!(alike(&fluid, &[1e5, 1e4, 9e3, 2.0], &solid, &found)[1], 0.0);
    }
}
