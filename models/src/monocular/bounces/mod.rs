//! Restitution from the free flights on both sides of hits whose contact is shorter than the time between two pictures.
//!
//! All flights are fitted together in space: one gravity, which gives the metres, one ground, and at each hit a
//! restitution and a velocity along the ground ([`path`]). What a flight looks like in the picture is exact perspective.

mod dual;
mod fit;
mod path;
#[cfg(test)]
mod tests;

use self::dual::Dual;
use self::fit::Task;
use self::path::Way;
use super::free_fall::Down;
use crate::vector::{minus, times};
use crate::video::parabola::GRAVITY;
use crate::video::{Bounces, Camera, FreeFlight, Hit, Known};

/// Relative standard deviation of a restitution that no fit shows: drag of the air, which takes speed from a light ball on
/// its way, spin, and rows that are read one after the other.
const UNMODELLED: f64 = 0.015;

/// Difference of times that are meant to be the same \[s\].
const SLACK: f64 = 1e-6;

/// Least number of places of a flight that is fitted.
const LEAST: usize = 3;

/// A velocity along the ground of this many standard deviations tells how much of it a hit leaves.
const MOVES: f64 = 4.0;

/// The frames of a clip, for the way of the object through them.
pub(super) struct Shown<'a> {
    /// Times in the film \[s\].
    pub seconds: &'a [f64],
    /// Depth of the object in the first of them \[m\].
    pub depth: f64,
    /// Camera to world.
    pub turn: [[f64; 3]; 3],
}

/// What the flights of a film tell, whose contacts last at most so long \[s\]; `None` if they do not fit together.
pub(super) fn of(
    camera: &Camera,
    flights: &[FreeFlight],
    contact: f64,
    down: Down,
    shown: &Shown<'_>,
) -> Option<Bounces> {
    // the flight that the clip begins with
    let own = flights.iter().rposition(|f| f.sights.first().is_some_and(|s| s.seconds <= shown.seconds[0] + SLACK))?;
    // one before it may not be free, as a hand may still hold the object
    let fitted = |from: usize| {
        let clear = flights[from..].iter().take_while(|flight| flight.sights.len() >= LEAST).count();
        let task = Task::of(camera, &flights[from..from + clear], down)?;
        let found = task.fitted()?;
        (from + found.flights > own + 1).then_some((task, found))
    };
    let all = (0..=own).filter_map(fitted);
    let (task, found) = all.reduce(|best, other| if other.1.flights > best.1.flights { other } else { best })?;
    let (way, covariance) = (&found.way, &found.covariance);
    let metres = GRAVITY / way.gravity.value;
    let deviation = |x: Dual| x.variance(covariance).max(0.0).sqrt();
    let hit = |struck: &path::Struck| {
        let value = struck.restitution.value;
        let along = struck.along[0];
        let moves = along.value.abs() > MOVES * deviation(along);
        Hit {
            seconds: task.seconds(struck.time.value),
            speed: metres * struck.speed.value,
            restitution: Known { value, deviation: deviation(struck.restitution).hypot(UNMODELLED * value) },
            tangential: moves.then(|| {
                let ratio = struck.after[0] / along;
                Known { value: ratio.value, deviation: deviation(ratio) }
            }),
        }
    };
    let hits: Vec<Hit> = way.hits.iter().map(hit).collect();
    let restitutions: Vec<Known> = hits.iter().map(|hit| hit.restitution).collect();
    let restitution = another(&restitutions)?;
    let tangential: Vec<Known> = hits.iter().filter_map(|hit| hit.tangential).collect();
    let begin = task.since(shown.seconds[0]);
    let in_metres = |v: Dual| {
        let v = v / way.gravity * GRAVITY;
        Known { value: v.value, deviation: deviation(v) }
    };
    Some(Bounces {
        contact,
        flights: found.flights,
        restitution,
        tangential: another(&tangential),
        velocity: way.velocity_at(begin).map(in_metres),
        path: displacements(way, shown, &task),
        hits,
    })
}

/// Displacement since the first frame in each frame \[m\], in a clip that has the object at its own depth.
fn displacements(way: &Way, shown: &Shown<'_>, task: &Task<'_>) -> Vec<[f64; 3]> {
    let at = |seconds: &f64| way.at(task.since(*seconds));
    let first = at(&shown.seconds[0]);
    let metres = shown.depth / -first[2];
    shown.seconds.iter().map(|time| times(&shown.turn, minus(at(time), first)).map(|x| metres * x)).collect()
}

/// What is to be expected of another one like these: their mean, with the deviation of one of them (DerSimonian and Laird
/// 1986, *Meta-analysis in clinical trials*).
fn another(all: &[Known]) -> Option<Known> {
    let weights: Vec<f64> = all.iter().map(|known| known.deviation.powi(-2)).collect();
    let sum: f64 = weights.iter().sum();
    let mean = |weights: &[f64]| {
        all.iter().zip(weights).map(|(known, w)| w * known.value).sum::<f64>() / weights.iter().sum::<f64>()
    };
    let common = mean(&weights);
    let off: f64 = all.iter().zip(&weights).map(|(known, w)| w * (known.value - common).powi(2)).sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    let between = ((off - (all.len() as f64 - 1.0)) / (sum - squares / sum).max(f64::MIN_POSITIVE)).max(0.0);
    let between = if all.len() > 1 { between } else { 0.0 };
    let weights: Vec<f64> = all.iter().map(|known| 1.0 / (known.deviation.powi(2) + between)).collect();
    let value = mean(&weights);
    (!all.is_empty() && value.is_finite())
        .then(|| Known { value, deviation: (1.0 / weights.iter().sum::<f64>() + between).sqrt() })
}
