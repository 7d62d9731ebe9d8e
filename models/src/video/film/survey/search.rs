//! Search for free flights among the components: sets of positions on one downward parabola in time.
//!
//! Nothing but a body in free flight moves so: hands, shadows on the ground and noise do not. Triples of components
//! at even distances in time propose parabolas, which grow from picture to picture while positions are found where
//! they predict them.

use std::collections::HashMap;
use std::ops::RangeInclusive;

use rayon::prelude::*;

use super::components::Component;
use super::flight::{Flight, middle};
use crate::video::parabola::{GRAVITY, Parabola};

/// Distances in time of the positions of a triple: pictures at least, and seconds.
const STRIDES: [(usize, f64); 4] = [(1, 0.0), (2, 0.04), (3, 0.07), (4, 0.1)];

/// Largest displacement between the pictures of a triple, in sizes of the component.
const FASTEST: f64 = 8.0;

/// Largest ratio of the widths of an object in two pictures.
const ALIKE: f64 = 1.7;

/// Distance of a position from its prediction that is accepted: a share of the width, with a minimum in pixels.
const GATE: (f64, f64) = (0.2, 1.2);

/// What is accepted along the motion in addition, in intervals between pictures: times are not exact.
const JITTER: f64 = 0.05;

/// Positions further off than this number of deviations are left out at last.
const OUTLIERS: f64 = 4.0;

/// Time and number of pictures in a row in which the object may be missed.
const MISSED: (usize, f64) = (2, 0.1);

/// Least ratio of the acceleration to its standard deviation.
const SURE: f64 = 6.0;

/// Largest deviation of the acceleration from the vertical of the picture (tangent): the roll of a camera.
const ROLL: f64 = 0.27;

/// Least share of the pictures between the first and the last position in which there is one.
const COVERED: f64 = 0.6;

/// Least positional error of a component \[pixels\].
const LEAST_SCATTER: f64 = 0.2;

/// Least curve of a triple \[pixels\]: the second difference of its heights.
const LEAST_CURVE: f64 = 1.0;

/// Least sag of a flight below its chord: a share of the width, with a minimum in pixels.
const LEAST_SAG: (f64, f64) = (0.15, 1.5);

/// Largest scatter about the parabola as a share of that about a straight line.
const BENDS: f64 = 0.5;

/// Number of flights that are kept.
const MOST: usize = 24;

/// The components of a film and the times of its pictures.
pub(in crate::video::film) struct Scene<'a> {
    pub pieces: &'a [Vec<Component>],
    pub times: &'a [f64],
}

/// Picture and index of a component.
type Spot = (usize, usize);

impl Scene<'_> {
    pub fn piece(&self, (picture, index): Spot) -> &Component {
        &self.pieces[picture][index]
    }

    /// Largest number of pictures in a row in which the object may be missed.
    pub fn missed(&self) -> usize {
        MISSED.0.max((MISSED.1 / self.interval()) as usize)
    }

    /// Mean time between pictures \[s\].
    pub fn interval(&self) -> f64 {
        let count = self.times.len();
        ((self.times[count - 1] - self.times[0]) / (count - 1).max(1) as f64).max(1e-6)
    }

    /// Flights of at least four positions, whose objects have a diameter in a range \[m\], the best first.
    pub fn flights(&self, sizes: &RangeInclusive<f64>) -> Vec<Flight> {
        let mut kept: Vec<Flight> = Vec::new();
        // the flights of each position
        let mut of: HashMap<Spot, Vec<usize>> = HashMap::new();
        for picture in 0..self.pieces.len() {
            let known = |seed: &Vec<Spot>| {
                let mut lists = seed.iter().map(|spot| of.get(spot));
                let first = lists.next().flatten();
                let rest: Vec<_> = lists.collect();
                first.is_some_and(|list| {
                    list.iter().any(|flight| rest.iter().all(|other| other.is_some_and(|l| l.contains(flight))))
                })
            };
            let found: Vec<Flight> = (0..self.pieces[picture].len())
                .into_par_iter()
                .flat_map_iter(|index| self.seeds((picture, index), sizes))
                .filter(|seed| !known(seed))
                .filter_map(|seed| self.grown(seed, None))
                .filter(|flight| flight.members.len() >= 4 && sizes.contains(&self.size(flight)))
                .collect();
            let mut found = found;
            found.sort_by(|a, b| b.score.total_cmp(&a.score));
            for flight in found.into_iter().take(MOST) {
                let number = kept.len();
                if !kept.iter().any(|other| other.score >= flight.score && same(other, &flight)) {
                    flight.members.iter().for_each(|spot| of.entry(*spot).or_default().push(number));
                    kept.push(flight);
                }
            }
        }
        kept.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut best: Vec<Flight> = Vec::new();
        for flight in kept {
            if best.len() < MOST && !best.iter().any(|other| same(other, &flight)) {
                best.push(flight);
            }
        }
        best
    }

    /// Diameter that gravity gives the object of a flight \[m\].
    pub fn size(&self, flight: &Flight) -> f64 {
        GRAVITY * flight.across / flight.path.acceleration[1]
    }

    /// Triples that start with a component and are on a downward parabola.
    fn seeds(&self, start: Spot, sizes: &RangeInclusive<f64>) -> Vec<Vec<Spot>> {
        let mut seeds = Vec::new();
        let mut before = 0;
        for (pictures, seconds) in STRIDES {
            let from = self.times[start.0];
            let later = self.times.partition_point(|t| *t < from + seconds - 1e-9) - start.0;
            let stride = later.max(pictures);
            if stride > before && start.0 + 2 * stride < self.times.len() {
                self.triples(start, stride, sizes, &mut seeds);
            }
            before = stride;
        }
        seeds
    }

    fn triples(&self, start: Spot, stride: usize, sizes: &RangeInclusive<f64>, seeds: &mut Vec<Vec<Spot>>) {
        let (second, third) = (start.0 + stride, start.0 + 2 * stride);
        let a = self.piece(start);
        let size = a.across().max(3.0);
        let [old, new] = [self.times[second] - self.times[start.0], self.times[third] - self.times[second]];
        let share = new / old;
        // second difference of the heights, from the sizes that are possible
        let bend = |metres: f64| GRAVITY * size / metres * 0.5 * new * (old + new);
        let least = (bend(*sizes.end()) / ALIKE).max(LEAST_CURVE);
        let most = (bend(*sizes.start()) * ALIKE).min(FASTEST * size);
        for (j, b) in self.pieces[second].iter().enumerate() {
            let moved = [0, 1].map(|c| b.middle[c] - a.middle[c]);
            if !alike(a, b) || moved[0].hypot(moved[1]) > FASTEST * size {
                continue;
            }
            let straight = [0, 1].map(|c| b.middle[c] + share * moved[c]);
            for (l, c) in self.pieces[third].iter().enumerate() {
                let off = [0, 1].map(|k| c.middle[k] - straight[k]);
                if !(least..=most).contains(&off[1]) || off[0].abs() - ROLL * off[1] > GATE.0 * size {
                    continue;
                }
                if alike(a, c) && alike(b, c) {
                    seeds.push(vec![start, (second, j), (third, l)]);
                }
            }
        }
    }

    /// Extends a seed in both directions while positions are where the parabola predicts them; `None` if it is no
    /// free flight. The acceleration may be given.
    pub fn grown(&self, seed: Vec<Spot>, acceleration: Option<[f64; 2]>) -> Option<Flight> {
        let mut members = seed;
        let fit = |members: &[Spot]| {
            let points: Vec<_> = members.iter().map(|spot| (self.times[spot.0], self.piece(*spot).middle)).collect();
            Parabola::fit(&points, acceleration)
        };
        let mut path = fit(&members)?;
        let model = Model::of(self, &members);
        let gate = gate(model.across);
        let interval = self.interval();
        let nearest = |path: &Parabola, k: usize| {
            let velocity = path.velocity_at(self.times[k]);
            let speed = velocity[0].hypot(velocity[1]).max(f64::MIN_POSITIVE);
            let [x, y] = velocity.map(|v| v / speed);
            let at = path.at(self.times[k]);
            // distance in gates, which are longer along the motion
            let off = |place: [f64; 2]| {
                let [dx, dy] = [place[0] - at[0], place[1] - at[1]];
                ((dx * x + dy * y) / (gate + JITTER * speed * interval)).hypot((dx * y - dy * x) / gate)
            };
            model.nearest(&self.pieces[k], off)
        };
        // the pictures between those of the seed
        let (first, last) = (members[0].0, members[members.len() - 1].0);
        for k in first + 1..last {
            if members.iter().all(|spot| spot.0 != k) {
                members.extend(nearest(&path, k).map(|j| (k, j)));
            }
        }
        if (members.len() as f64) < COVERED * (last - first + 1) as f64 {
            return None;
        }
        members.sort_unstable();
        path = fit(&members)?;
        for forward in [true, false] {
            let mut missed = 0;
            let mut k = if forward { last } else { first };
            while missed <= self.missed() {
                k = match forward {
                    true if k + 1 < self.pieces.len() => k + 1,
                    false if k > 0 => k - 1,
                    _ => break,
                };
                match nearest(&path, k) {
                    Some(j) => {
                        missed = 0;
                        let at = if forward { members.len() } else { 0 };
                        members.insert(at, (k, j));
                        path = fit(&members)?;
                    }
                    None => missed += 1,
                }
            }
        }
        // positions that the whole does not support
        loop {
            let off = |spot: &Spot| {
                let (at, is) = (path.at(self.times[spot.0]), self.piece(*spot).middle);
                (at[0] - is[0]).hypot(at[1] - is[1])
            };
            let all: Vec<f64> = members.iter().map(off).collect();
            let worst = (0..all.len()).max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
            // half of the distances in a plane are below 1.18 deviations
            let limit = (OUTLIERS / 1.18 * middle(all.clone())).max(0.5 * gate);
            if all[worst] <= limit || members.len() <= 3 {
                break;
            }
            members.remove(worst);
            path = fit(&members)?;
        }
        self.judged(Flight::of(members, self, acceleration)?, acceleration.is_some())
    }

    /// Whether a flight bends more than errors of its positions can make it appear.
    fn sags(&self, flight: &Flight) -> bool {
        self.sag(flight) >= (LEAST_SAG.0 * flight.across).max(LEAST_SAG.1).max(3.0 * flight.path.scatter)
    }

    /// Whether its parabola explains its positions better than a straight line does: that of a body at rest, too.
    fn bends(&self, flight: &Flight) -> bool {
        let points: Vec<_> = flight.members.iter().map(|spot| (self.times[spot.0], self.piece(*spot).middle)).collect();
        Parabola::fit(&points, Some([0.0; 2])).is_some_and(|line| flight.path.scatter < BENDS * line.scatter)
    }

    /// Largest distance of a flight from its chord \[pixels\].
    fn sag(&self, flight: &Flight) -> f64 {
        let time = self.times[flight.last()] - self.times[flight.first()];
        flight.path.acceleration[1] * time * time / 8.0
    }

    /// A flight with its score, if it is one.
    fn judged(&self, mut flight: Flight, known: bool) -> Option<Flight> {
        let path = &flight.path;
        let [aside, down] = path.acceleration;
        let scatter = path.scatter.max(LEAST_SCATTER);
        let sure = down / (scatter * path.leverage);
        let span = (flight.last() - flight.first() + 1) as f64;
        let covered = flight.members.len() as f64 / span;
        let steep = aside.abs() - ROLL * down < 2.0 * scatter * path.leverage;
        if down <= 0.0 || covered < COVERED || !(known || (sure > SURE && steep)) {
            return None;
        }
        if !self.sags(&flight) || !self.bends(&flight) {
            return None;
        }
        let whole = flight.members.iter().filter(|spot| !self.piece(**spot).cut).count() as f64;
        let free = if known { 1.5 } else { 2.5 };
        // each position that is found within the gate could have been anywhere in it
        let tight = (gate(flight.across) / scatter).ln().max(0.1);
        let certain = if known { 1.0 } else { (1.0 + (sure / SURE).ln().max(0.0)).min(2.0) };
        let bent = (self.sag(&flight) / flight.across.max(1.0)).min(1.0);
        flight.score = bent * (whole - free).max(0.0) * tight * certain * covered * (1.0 - 0.5 * flight.shadow);
        Some(flight)
    }
}

/// Distance of a position from its prediction that is accepted \[pixels\].
pub(super) fn gate(across: f64) -> f64 {
    (GATE.0 * across).max(GATE.1)
}

/// Whether most positions of the shorter one are of the other.
fn same(first: &Flight, second: &Flight) -> bool {
    let shared = second.members.iter().filter(|member| first.members.contains(member)).count();
    let (a, b) = (first, second);
    let overlap = (a.last().min(b.last()) + 1).saturating_sub(a.first().max(b.first()));
    let shorter = a.members.len().min(b.members.len());
    // another level of the same object is as far along the same path
    let near = |t: f64| {
        let (p, q) = (a.path.at(t), b.path.at(t));
        (p[0] - q[0]).hypot(p[1] - q[1]) < 0.5 * a.across.max(b.across)
    };
    2 * shared > shorter || (2 * overlap > shorter && near(b.path.time) && near(a.path.time))
}

fn alike(a: &Component, b: &Component) -> bool {
    let (a, b) = (a.across().max(1.0), b.across().max(1.0));
    a < ALIKE * b && b < ALIKE * a
}

/// Number of components of a picture that are tried as the object.
const CANDIDATES: usize = 4;

/// How an object looks.
pub(super) struct Model {
    pub across: f64,
    pub area: f64,
    pub colour: [f64; 3],
}

impl Model {
    /// The medians of some components.
    pub fn of(scene: &Scene<'_>, members: &[Spot]) -> Self {
        let of = |value: &dyn Fn(&Component) -> f64| middle(members.iter().map(|s| value(scene.piece(*s))).collect());
        Self {
            across: of(&Component::across).max(1.0),
            area: of(&|piece| piece.area),
            colour: [0, 1, 2].map(|c| of(&|piece| piece.colour[c])),
        }
    }

    /// The component that is most like the object where `off`, the distance in gates, is at most 1.
    pub fn nearest(&self, pieces: &[Component], off: impl Fn([f64; 2]) -> f64) -> Option<usize> {
        let cost = |piece: &Component| {
            let off = off(piece.middle);
            if off > 1.0 { f64::INFINITY } else { off + self.unlike(piece) }
        };
        let costs = pieces.iter().enumerate().map(|(j, piece)| (j, cost(piece)));
        costs.filter(|(_, c)| c.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(j, _)| j)
    }

    /// The components that are most like the object, of all sizes of pictures.
    pub fn like(&self, pieces: &[Component]) -> Vec<usize> {
        let costs = pieces.iter().enumerate().map(|(j, piece)| (j, self.unlike(piece)));
        let mut like: Vec<(usize, f64)> = costs.filter(|(_, cost)| cost.is_finite()).collect();
        like.sort_by(|a, b| a.1.total_cmp(&b.1));
        like.into_iter().take(CANDIDATES).map(|(j, _)| j).collect()
    }

    pub fn unlike(&self, piece: &Component) -> f64 {
        let width = (piece.across().max(1.0) / self.across).ln().abs() / ALIKE.ln();
        let size = (piece.area / self.area).ln().abs() / 1.5;
        let hue = (0..3).map(|c| (piece.colour[c] - self.colour[c]).powi(2)).sum::<f64>().sqrt() / 120.0;
        if width > 1.0 || size > 1.0 || hue > 1.0 { f64::INFINITY } else { width + size + hue }
    }
}
