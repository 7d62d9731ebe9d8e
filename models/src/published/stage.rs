//! The stages of the chain, in state, progress and report.

use serde::{Deserialize, Serialize};

/// A stage of the published chain.
///
/// ```
/// use gradreel_models::published::Stage;
///
/// assert_eq!(Stage::Field.title(&Stage::ALL), "stage 3 of 6: temporal field");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Where the object is in every picture.
    Boxes,
    /// Sixteen views of every frame.
    Views,
    /// The temporal field of all pictures.
    Field,
    /// The particles of its first frame.
    Particles,
    /// The initial velocity.
    Velocity,
    /// The material.
    Material,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 6] = [Self::Boxes, Self::Views, Self::Field, Self::Particles, Self::Velocity, Self::Material];

    /// Those of a clip whose views were all filmed.
    pub const OF_FILMED_VIEWS: [Self; 4] = [Self::Field, Self::Particles, Self::Velocity, Self::Material];

    /// Its name for readers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Boxes => "boxes",
            Self::Views => "views of every frame",
            Self::Field => "temporal field",
            Self::Particles => "particles",
            Self::Velocity => "velocity",
            Self::Material => "material",
        }
    }

    /// Its place among some stages, and its name.
    pub fn title(self, among: &[Self]) -> String {
        let place = among.iter().position(|stage| *stage == self).map_or(0, |place| place + 1);
        format!("stage {place} of {}: {}", among.len(), self.name())
    }

    /// Its usual share of the whole time, in parts.
    pub(super) fn share(self) -> f64 {
        match self {
            Self::Boxes => 0.1,
            Self::Views => 40.0,
            Self::Field => 30.0,
            Self::Particles => 4.0,
            Self::Velocity => 2.0,
            Self::Material => 24.0,
        }
    }
}
