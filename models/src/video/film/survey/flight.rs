//! Free flight in the picture: components on a parabola in time.

use super::components::Component;
use super::search::Scene;
use crate::video::parabola::Parabola;

/// Least standard deviation of a place \[pixels of the survey\].
pub(super) const LEAST_SCATTER: f64 = 0.25;

/// Components that lie on one parabola.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Flight {
    pub path: Parabola,
    /// Picture and component of each position, in time order.
    pub members: Vec<(usize, usize)>,
    /// Usual extent across the motion \[pixels\].
    pub across: f64,
    /// Usual likeness with a shadow.
    pub shadow: f64,
    /// Evidence for it.
    pub score: f64,
}

impl Flight {
    pub fn first(&self) -> usize {
        self.members[0].0
    }

    pub fn last(&self) -> usize {
        self.members[self.members.len() - 1].0
    }

    /// Fits members; the acceleration may be given.
    pub fn of(members: Vec<(usize, usize)>, scene: &Scene<'_>, acceleration: Option<[f64; 2]>) -> Option<Self> {
        let points: Vec<_> = members.iter().map(|spot| (scene.times[spot.0], scene.piece(*spot).middle)).collect();
        let path = Parabola::fit(&points, acceleration)?;
        let of = |value: &dyn Fn(&Component, f64) -> f64| {
            middle(members.iter().map(|spot| value(scene.piece(*spot), scene.times[spot.0])).collect())
        };
        Some(Self {
            path,
            across: of(&|piece, t| piece.across_direction(path.velocity_at(t))),
            shadow: of(&|piece, _| piece.shadow),
            score: 0.0,
            members,
        })
    }
}

/// The median.
pub(super) fn middle(mut values: Vec<f64>) -> f64 {
    let at = values.len() / 2;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}
