//! The stages of a reconstruction: what its state, its progress and its report match on.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use gradreel::{Error, ErrorKind};
use serde::{Deserialize, Serialize};

/// A stage of a reconstruction, in the order in which they run. Rounds of the shape in motion count from 1.
///
/// ```
/// use gradreel_models::identify::Stage;
///
/// assert_eq!(Stage::Together(1).to_string(), "shape and material 1");
/// assert_eq!("posterior".parse::<Stage>().unwrap(), Stage::Posterior);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Stage {
    /// Voxels fitted to the first frame.
    #[default]
    Shape,
    /// Hits from the free flights around them, in place of all that follows.
    FreeFlights,
    /// The temporal field of the first frames.
    TemporalField,
    /// Velocity from the first frames.
    Velocity,
    /// Voxels fitted to the frames before contact.
    ShapeInFlight,
    /// Velocity from all frames before contact.
    VelocityInFlight,
    /// The exposure of a film, from its flight.
    Exposure,
    /// The time from row to row of a film, from its flight.
    RowTime,
    /// Points of the prior on a coarse body.
    Plausible,
    /// The better ones searched on a coarse body.
    Coarse,
    /// The better ones on the full body, with few substeps.
    FewSubsteps,
    /// The better ones searched there.
    FewSubstepsOn,
    /// The best searched with the full forward model.
    Material,
    /// Voxels fitted to all frames, moved as the best hypothesis moves.
    ShapeInMotion(u16),
    /// The cost of the best hypothesis with that shape.
    HeldAgreement(u16),
    /// Voxels and material fitted together.
    Together(u16),
    /// The cost of the best hypothesis with that shape.
    TogetherAgreement(u16),
    /// The shape from before, where both together are the less probable.
    Undone(u16),
    /// The survivors searched with the shape in motion.
    MaterialAgain(u16),
    /// What the clip says of each survivor.
    Posterior,
}

use Stage::*;

/// Stages that are no rounds, with their names.
const SINGLE: [(Stage, &str); 14] = [
    (Shape, "shape"),
    (FreeFlights, "free flights"),
    (TemporalField, "temporal field"),
    (Velocity, "velocity"),
    (ShapeInFlight, "shape in flight"),
    (VelocityInFlight, "velocity in flight"),
    (Exposure, "exposure"),
    (RowTime, "rows"),
    (Plausible, "what is plausible"),
    (Coarse, "material, coarse"),
    (FewSubsteps, "material, few substeps"),
    (FewSubstepsOn, "material, few substeps, on"),
    (Material, "material"),
    (Posterior, "posterior"),
];

/// A stage of a round.
type OfRound = fn(u16) -> Stage;

/// Stages of a round, with what their names have before and after its number.
const ROUND: [(OfRound, &str, &str); 6] = [
    (ShapeInMotion, "shape in motion ", ""),
    (HeldAgreement, "shape in motion ", ": agreement"),
    (Together, "shape and material ", ""),
    (TogetherAgreement, "shape and material ", ": agreement"),
    (Undone, "shape and material ", ": undone"),
    (MaterialAgain, "material ", ""),
];

/// How a reconstruction will go, as far as it is known when it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Course {
    /// Whether the free flights tell all there is.
    pub by_flights: bool,
    /// Whether the fall of what a single camera saw is known.
    pub fallen: bool,
    /// Whether the spin is free.
    pub spin: bool,
    /// Whether the temporal field is fitted.
    pub temporal: bool,
    /// Whether exposure and row time are searched.
    pub shutter: [bool; 2],
    /// Whether the material forgets its shape.
    pub flows: bool,
    /// Rounds of the shape in motion.
    pub rounds: usize,
}

impl Course {
    /// The stages that show their progress, in their order.
    pub fn stages(self) -> Vec<Stage> {
        if self.by_flights {
            return vec![Shape];
        }
        let mut all = vec![Shape];
        all.extend(self.temporal.then_some(TemporalField));
        let velocity = !self.fallen || self.spin;
        all.extend(velocity.then_some(Velocity));
        all.push(ShapeInFlight);
        all.extend(velocity.then_some(VelocityInFlight));
        all.extend([Exposure, RowTime].into_iter().zip(self.shutter).filter(|(_, open)| *open).map(|(stage, _)| stage));
        all.extend([Plausible, Coarse, FewSubsteps, FewSubstepsOn, Material]);
        for round in (1..=self.rounds).map(number) {
            all.push(ShapeInMotion(round));
            if !self.flows {
                all.extend([HeldAgreement(round), Together(round), TogetherAgreement(round)]);
            }
            all.push(MaterialAgain(round));
        }
        all.push(Posterior);
        all
    }
}

/// The number of a round in a stage.
pub(crate) fn number(round: usize) -> u16 {
    round.try_into().unwrap_or(u16::MAX)
}

impl Stage {
    /// About how much of a run's time the stage takes, in parts of any size: the estimate of the time that is left uses it.
    pub(crate) fn share(self) -> f64 {
        match self {
            TemporalField => 30.0,
            Material => 25.0,
            MaterialAgain(_) => 15.0,
            Coarse | FewSubstepsOn | Together(_) | Posterior => 10.0,
            Shape | ShapeInFlight | Plausible | ShapeInMotion(_) => 5.0,
            FreeFlights | Velocity | VelocityInFlight | Exposure | RowTime | FewSubsteps => 2.0,
            HeldAgreement(_) | TogetherAgreement(_) | Undone(_) => 1.0,
        }
    }

    /// Whether it searches the velocity alone: what flies shows nothing of the material.
    pub fn is_of_velocity(self) -> bool {
        matches!(self, Velocity | VelocityInFlight)
    }

    /// The round that it belongs to.
    fn round(self) -> Option<u16> {
        match self {
            ShapeInMotion(round) | HeldAgreement(round) | Together(round) => Some(round),
            TogetherAgreement(round) | Undone(round) | MaterialAgain(round) => Some(round),
            _ => None,
        }
    }
}

impl Display for Stage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if let Some((_, name)) = SINGLE.iter().find(|(stage, _)| stage == self) {
            return f.write_str(name);
        }
        let round = self.round().expect("a stage is single or of a round");
        let (_, before, after) =
            ROUND.iter().find(|(of, ..)| of(round) == *self).expect("each stage of a round has a name");
        write!(f, "{before}{round}{after}")
    }
}

impl FromStr for Stage {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        let single = SINGLE.iter().find(|(_, known)| *known == name).map(|(stage, _)| *stage);
        let of_round = |(of, before, after): &(OfRound, &str, &str)| {
            let digits = name.strip_prefix(before)?.strip_suffix(after)?;
            digits.parse().ok().filter(|round: &u16| *round > 0 && round.to_string() == digits).map(of)
        };
        single.or_else(|| ROUND.iter().find_map(of_round)).ok_or_else(|| {
            Error::new(ErrorKind::Input, "there is no such stage of a reconstruction")
                .found(format!("{name:?}"))
                .wanted("a stage that this version knows, such as \"shape\" or \"material 1\"")
                .fix("go on with the version that began the run, or begin it again with another --out")
        })
    }
}

impl From<Stage> for String {
    fn from(stage: Stage) -> Self {
        stage.to_string()
    }
}

impl TryFrom<String> for Stage {
    type Error = Error;

    fn try_from(name: String) -> Result<Self, Error> {
        name.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Stage> {
        let rounds = [1, 2, 65535].into_iter().flat_map(|round| ROUND.map(|(of, ..)| of(round)));
        SINGLE.iter().map(|(stage, _)| *stage).chain(rounds).collect()
    }

    #[test]
    fn every_stage_is_read_back_from_its_name() {
        let mut names = std::collections::BTreeSet::new();
        for stage in all() {
            let name = stage.to_string();
            assert_eq!(name.parse::<Stage>().unwrap(), stage, "{name}");
            assert_eq!(serde_json::from_str::<Stage>(&serde_json::to_string(&stage).unwrap()).unwrap(), stage);
            assert!(names.insert(name), "{stage} has the name of another");
        }
    }

    #[test]
    fn names_of_no_stage_are_refused_with_what_they_are() {
        for name in
            ["", "shapes", "material 0", "material 01", "material -1", "material 70000", "shape in motion : agreement"]
        {
            let error = name.parse::<Stage>().unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Input);
            assert!(error.to_string().contains(&format!("{name:?}")), "{error}");
        }
    }

    #[test]
    fn a_course_has_the_stages_that_will_run() {
        let one = Course {
            by_flights: false,
            fallen: true,
            spin: false,
            temporal: false,
            shutter: [false; 2],
            flows: false,
            rounds: 1,
        };
        let stages = one.stages();
        assert!(!stages.contains(&Velocity) && stages.contains(&Together(1)) && !stages.contains(&Together(2)));
        assert!(Course { spin: true, ..one }.stages().contains(&VelocityInFlight));
        let given = Course { shutter: [false, true], ..one }.stages();
        assert!(given.contains(&RowTime) && !given.contains(&Exposure));
        assert!(Course { fallen: false, ..one }.stages().contains(&Velocity));
        assert!(Course { temporal: true, ..one }.stages().contains(&TemporalField));
        let flowing = Course { flows: true, rounds: 2, ..one }.stages();
        assert!(flowing.contains(&ShapeInMotion(2)) && !flowing.contains(&Together(1)));
        assert_eq!(Course { by_flights: true, ..one }.stages(), [Shape]);
        assert!([one.stages(), flowing].iter().all(|stages| stages.last() == Some(&Posterior)));
    }
}
