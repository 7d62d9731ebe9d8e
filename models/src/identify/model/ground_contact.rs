//! What the ground does to a body that touches it: an axis of the hypotheses.

use serde::{Deserialize, Serialize};

use crate::identify::uncertainty::prior::FRICTION;
use crate::physics::{Collider, Contact};

/// How a body and the ground meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum GroundContact {
    /// What touches it stays.
    #[default]
    Sticky,
    /// It slides without friction, and does not leave.
    Slip,
    /// It slides with Coulomb friction, whose coefficient is an unknown, and may leave.
    Friction,
    /// Each of these is a hypothesis.
    Auto,
}

impl GroundContact {
    /// Those that can be simulated.
    pub const ALL: [Self; 3] = [Self::Sticky, Self::Slip, Self::Friction];

    /// Horizontal ground of this kind; sticky as long as the kind is not chosen.
    pub(in crate::identify) fn collider(self, height: f64) -> Collider {
        let contact = match self {
            Self::Sticky | Self::Auto => Contact::Sticky,
            Self::Slip => Contact::Slip,
            Self::Friction => Contact::Friction(FRICTION[0]),
        };
        Collider::plane([0.0, height, 0.0], [0.0, 1.0, 0.0], contact)
    }

    /// The kinds to try.
    pub(in crate::identify) fn hypotheses(self) -> Vec<Self> {
        if self == Self::Auto { Self::ALL.to_vec() } else { vec![self] }
    }

    /// A family of materials on such ground, as it is called among hypotheses.
    pub(in crate::identify) fn named(self, family: &str) -> String {
        match self {
            Self::Sticky | Self::Auto => family.to_owned(),
            Self::Slip => format!("{family}, slip"),
            Self::Friction => format!("{family}, friction"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_named_and_tried() {
        assert_eq!(GroundContact::Auto.hypotheses(), GroundContact::ALL);
        assert_eq!(GroundContact::Slip.hypotheses(), [GroundContact::Slip]);
        let names = GroundContact::ALL.map(|kind| kind.named("elastic"));
        assert_eq!(names, ["elastic", "elastic, slip", "elastic, friction"]);
        assert_eq!(GroundContact::Auto.collider(0.3), Collider::ground(0.3));
        assert_eq!(GroundContact::Friction.collider(0.0).contact, Contact::Friction(0.4));
    }
}
