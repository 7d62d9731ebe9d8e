//! Where the object is in each picture: on its flights, and after them.

use super::chain::{Chain, MEETING};
use super::flight::middle;
use super::search::{Model, Scene, gate};

/// Reach of the object from one picture to the next after its flights, in its widths.
const REACH: f64 = 1.5;

/// Number of pictures after the fall that tell where it ended.
const LANDED: usize = 5;

/// One hit of the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::video::film) struct Hit {
    /// Its time \[s\].
    pub time: f64,
    /// Place of the object's centre \[pixels\].
    pub place: [f64; 2],
    /// Velocity before and after \[pixels/s\]; `None` where no flight follows.
    pub before: [f64; 2],
    pub after: Option<[f64; 2]>,
}

/// The way of an object through the film.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Track {
    pub chain: Chain,
    /// The hit that ends each flight, if it ends with one.
    pub hits: Vec<Option<Hit>>,
    /// Component of each picture, where it is known.
    pub spots: Vec<Option<usize>>,
}

impl Track {
    pub fn of(scene: &Scene<'_>, chain: Chain) -> Self {
        let mut spots = vec![None; scene.pieces.len()];
        for link in &chain.links {
            link.flight.members.iter().for_each(|(k, j)| spots[*k] = Some(*j));
        }
        let meeting = |k: usize| {
            let (a, b) = (&chain.links[k].flight.path, &chain.links[k + 1].flight.path);
            let hits = |time: f64| a.velocity_at(time)[1] > 0.0 && b.velocity_at(time)[1] < 0.0;
            let width = chain.links[k].flight.across.max(chain.links[k + 1].flight.across);
            let times = [chain.links[k].flight.last(), chain.links[k + 1].flight.first()].map(|k| scene.times[k]);
            let slack = scene.interval();
            let meet = |&(time, apart): &(f64, f64)| {
                let between = (times[0] - slack..=times[1] + slack).contains(&time);
                hits(time) && between && apart < MEETING * width
            };
            a.meets(b).filter(meet).map(|(time, _)| Hit {
                time,
                place: a.at(time),
                before: a.velocity_at(time),
                after: Some(b.velocity_at(time)),
            })
        };
        let mut hits: Vec<Option<Hit>> = (0..chain.links.len() - 1).map(meeting).collect();
        let mut track = Self { chain, hits: vec![], spots };
        hits.push(track.land(scene));
        track.hits = hits;
        track
    }

    /// Follows the object after its last flight; the hit that ended it, if one did.
    fn land(&mut self, scene: &Scene<'_>) -> Option<Hit> {
        let link = self.chain.links.last().expect("at least one flight");
        let flight = &link.flight;
        let look = Model::of(scene, &flight.members);
        let path = flight.path;
        let (mut at, mut last) = (path.at(scene.times[flight.last()]), flight.last());
        let mut landed: Vec<(f64, [f64; 2])> = Vec::new();
        for k in flight.last() + 1..scene.pieces.len() {
            let since = scene.times[k] - scene.times[last];
            let speed = match landed.len() {
                0 => path.velocity_at(scene.times[last])[1].abs(),
                _ => 0.0,
            };
            let reach = REACH * flight.across + speed * since;
            // what leaves the picture does not land in it
            match nearest(&look, scene, k, at, reach).filter(|j| !scene.pieces[k][*j].cut) {
                Some(j) => {
                    self.spots[k] = Some(j);
                    (at, last) = (scene.pieces[k][j].middle, k);
                    landed.push((scene.times[k], at));
                }
                None if k - last > scene.missed() + 1 => break,
                None => {}
            }
        }
        // where it stays above the continued parabola
        let above = |(time, place): &&(f64, [f64; 2])| path.at(*time)[1] - place[1] > gate(flight.across);
        let rest: Vec<f64> = landed.iter().filter(above).take(LANDED).map(|(_, place)| place[1]).collect();
        if rest.len() < 2 || rest.len() < landed.len().min(LANDED) / 2 {
            return None;
        }
        let height = middle(rest);
        // when the parabola is there, but not before it was last seen on it
        let [v, a] = [path.velocity_at(scene.times[flight.last()])[1], path.acceleration[1]];
        let below = height - path.at(scene.times[flight.last()])[1];
        let after = match v * v + 2.0 * a * below {
            root if root > 0.0 => (root.sqrt() - v) / a,
            _ => 0.0,
        };
        let end = scene.times[(flight.last() + 1).min(scene.times.len() - 1)];
        let time = (scene.times[flight.last()] + after.max(0.0)).min(end);
        Some(Hit { time, place: path.at(time), before: path.velocity_at(time), after: None })
    }
}

/// The component like the object that is nearest to a place.
fn nearest(look: &Model, scene: &Scene<'_>, picture: usize, at: [f64; 2], reach: f64) -> Option<usize> {
    look.nearest(&scene.pieces[picture], |place| (place[0] - at[0]).hypot(place[1] - at[1]) / reach)
}
