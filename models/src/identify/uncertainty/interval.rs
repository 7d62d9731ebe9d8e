//! How sure an estimate of one unknown is.

use serde::{Deserialize, Serialize};

use crate::identify::Unknowns;
use crate::identify::model::unknowns::Unknown;
use crate::physics::{Law, Map};

/// What is known of one unknown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Name of the parameter, or `velocity_x`, `spin_x` and so on, `contact`, `depth_shear_right`, `depth_shear_up`, `depth_scale`, `pitch`.
    pub name: String,
    /// Ends of the interval that holds the truth in nine of ten cases, in the unknown's unit.
    pub interval_90: [f64; 2],
    /// Whether the clip says clearly more than what is plausible of any such material: whether the interval is at most a
    /// third as wide as the plausible range (in decades for magnitudes).
    pub determined: bool,
}

/// The ends of an interval of an unknown: what bounds a parameter bounds what is known of it, unless the estimate itself lies beyond.
pub(in crate::identify) fn within(law: &Law, unknown: Unknown, at: &Unknowns, [low, high]: [f64; 2]) -> [f64; 2] {
    match unknown {
        Unknown::Parameter(p) if law.parameters()[p].map != Map::Log10 => {
            let ([least, most], value) = (law.parameters()[p].prior, at.parameters[p]);
            [low.max(least.min(value)), high.min(most.max(value))]
        }
        _ => [low, high],
    }
}
