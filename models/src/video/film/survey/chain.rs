//! All flights of one object: each begins where the one before ends, with nearly the same acceleration.

use super::flight::{Flight, LEAST_SCATTER};
use super::search::{Model, Scene};
use crate::video::parabola::Parabola;

/// Number of flights that are tried as the first of a chain.
const LEADERS: usize = 12;

/// Longest time between the last position of a flight and the first of the next \[s\].
const APART: f64 = 0.2;

/// Longest time for which the object may be hidden where two flights meet \[s\].
const HIDDEN: f64 = 0.4;

/// A flight of another acceleration is preferred where its score is higher by this factor.
const BETTER: f64 = 3.0;

/// Largest distance of two flights where they meet, in widths of the object.
pub(super) const MEETING: f64 = 0.7;

/// Relative change of the acceleration from flight to flight that the depth of an object can cause.
const NEARER: f64 = 0.07;

/// Largest logarithm of the ratio of the accelerations, or of the widths, of two flights of one object.
const OTHERWISE: f64 = 0.4;

/// Least share of the speed downwards with which an object leaves a hit upwards.
const LEAVES: f64 = 0.05;

/// Longest time between two flights of one object \[s\], and least evidence for either.
const LOST: f64 = 1.0;
const CLEAR: f64 = 8.0;

/// Largest departure of the rest of a flight from its continuation, in widths and in shares of the speed.
const ON: f64 = 0.3;

/// Largest number of flights.
const MOST: usize = 40;

/// A flight of a chain.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Link {
    pub flight: Flight,
    /// Vertical acceleration by the flight and its neighbours \[pixels/s²\], with its relative standard deviation.
    pub acceleration: f64,
    pub deviation: f64,
    /// Relative standard deviation by the flight alone.
    pub own: f64,
}

/// The flights of one object in time order.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Chain {
    pub links: Vec<Link>,
    /// Evidence for it.
    pub score: f64,
}

/// Chains of flights, the best first.
pub(in crate::video::film) fn chains(scene: &Scene<'_>, flights: &[Flight]) -> Vec<Chain> {
    let mut all: Vec<Chain> = Vec::new();
    for leader in flights.iter().take(LEADERS) {
        let known = |chain: &Chain| {
            chain.links.iter().any(|link| {
                let shared = leader.members.iter().filter(|spot| link.flight.members.contains(spot)).count();
                2 * shared > leader.members.len()
            })
        };
        if !all.iter().any(known) {
            all.push(of(scene, leader, flights));
        }
    }
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    all
}

/// The chain that a flight begins, in both directions.
fn of(scene: &Scene<'_>, leader: &Flight, all: &[Flight]) -> Chain {
    let first = linked(scene, leader.clone(), None);
    let mut links = vec![first];
    for forward in [true, false] {
        while links.len() < MOST {
            let end = if forward { links.len() - 1 } else { 0 };
            let found = next(scene, &links[end], all, forward).or_else(|| apart(scene, &links[end], all, forward));
            let Some(link) = found else { break };
            links.insert(if forward { links.len() } else { 0 }, link);
        }
    }
    let score = links.iter().map(|link| link.flight.score).sum();
    Chain { links, score }
}

/// A flight with its acceleration: its own, and that of a neighbour.
fn linked(scene: &Scene<'_>, flight: Flight, neighbour: Option<&Link>) -> Link {
    let points: Vec<_> = flight.members.iter().map(|spot| (scene.times[spot.0], scene.piece(*spot).middle)).collect();
    let own = Parabola::fit(&points, None).filter(|path| path.acceleration[1] > 0.0);
    let own = own.map(|path| (path.acceleration[1], path.scatter.max(LEAST_SCATTER) * path.leverage));
    let prior = neighbour.map(|link| (link.acceleration, link.acceleration * link.deviation.hypot(NEARER)));
    let (mut weight, mut sum) = (0.0, 0.0);
    for (value, sigma) in own.into_iter().chain(prior) {
        weight += 1.0 / (sigma * sigma);
        sum += value / (sigma * sigma);
    }
    let acceleration = sum / weight;
    let alone = own.map_or(f64::INFINITY, |(_, sigma)| sigma / acceleration);
    Link { flight, acceleration, deviation: (1.0 / weight).sqrt() / acceleration, own: alone }
}

/// The flight that follows one, or the one before it.
fn next(scene: &Scene<'_>, link: &Link, all: &[Flight], forward: bool) -> Option<Link> {
    let flight = &link.flight;
    let model = Model::of(scene, &flight.members);
    let ratio = link.acceleration / flight.path.acceleration[1];
    let acceleration = flight.path.acceleration.map(|a| a * ratio);
    let count = scene.times.len();
    let end = if forward { flight.last() } else { flight.first() };
    let reach = |k: usize| (scene.times[k] - scene.times[end]).abs() <= APART || k.abs_diff(end) <= 2;
    // the last position may be of both
    let window: Vec<usize> = match forward {
        true => (end.saturating_sub(1)..count).take_while(|k| reach(*k)).collect(),
        false => (0..(end + 2).min(count)).rev().take_while(|k| reach(*k)).collect(),
    };
    let like = |k: usize| model.like(&scene.pieces[k]);
    let mut best: Option<Link> = None;
    // the rest of the same flight, where pictures are missing from the film
    let mut rest: Option<Link> = None;
    let mut tried: Vec<Flight> = Vec::new();
    for &k in &window {
        for step in 1..=2 {
            let other = if forward { k + step } else { k.wrapping_sub(step) };
            if other >= count {
                continue;
            }
            for i in like(k) {
                for j in like(other) {
                    let mut seed = vec![(k, i), (other, j)];
                    seed.sort_unstable();
                    if tried.iter().any(|flight| seed.iter().all(|spot| flight.members.contains(spot))) {
                        continue;
                    }
                    let Some(found) = scene.grown(seed, Some(acceleration)) else { continue };
                    tried.push(found.clone());
                    if !follows(scene, flight, &found, forward) {
                        let more = rest.as_ref().is_none_or(|rest: &Link| rest.flight.score < found.score);
                        if more && continues(scene, flight, &found, forward) {
                            rest = Some(linked(scene, found, Some(link)));
                        }
                        continue;
                    }
                    if best.as_ref().is_none_or(|best| best.flight.score < found.score) {
                        best = Some(linked(scene, found, Some(link)));
                    }
                }
            }
        }
    }
    // or one that was found without knowing the acceleration, which the perspective may have changed
    let alike = |other: &&Flight| {
        let ratio = (other.path.acceleration[1] / link.acceleration).ln().abs();
        let width = (other.across / flight.across).ln().abs();
        ratio < OTHERWISE && width < OTHERWISE && follows(scene, flight, other, forward)
    };
    let gap = |other: &Flight| match forward {
        true => scene.times[other.first()] - scene.times[flight.last()],
        false => scene.times[flight.first()] - scene.times[other.last()],
    };
    let known = best.as_ref().map_or(0.0, |best| BETTER * best.flight.score);
    let mut others: Vec<&Flight> = all.iter().filter(alike).collect();
    for longest in [APART, HIDDEN] {
        others.sort_by(|a, b| b.score.total_cmp(&a.score));
        if let Some(found) = others.iter().find(|other| gap(other) <= longest && other.score > known) {
            return Some(linked(scene, (*found).clone(), None));
        }
        if best.is_some() {
            break;
        }
    }
    best.or(rest)
}

/// The nearest clear flight of the same object before or after one, with what happens between them unknown.
fn apart(scene: &Scene<'_>, link: &Link, all: &[Flight], forward: bool) -> Option<Link> {
    let flight = &link.flight;
    let look = Model::of(scene, &flight.members);
    let gap = |other: &Flight| match forward {
        true => (other.first() > flight.last()).then(|| scene.times[other.first()] - scene.times[flight.last()]),
        false => (other.last() < flight.first()).then(|| scene.times[flight.first()] - scene.times[other.last()]),
    };
    let same = |other: &&Flight| {
        let ratio = (other.path.acceleration[1] / link.acceleration).ln().abs();
        let width = (other.across / flight.across).ln().abs();
        let alike = other.members.iter().filter(|spot| look.unlike(scene.piece(**spot)).is_finite()).count();
        ratio < OTHERWISE && width < OTHERWISE && 2 * alike > other.members.len() && other.score >= CLEAR
    };
    let near = all.iter().filter(same).filter_map(|other| Some((gap(other)?, other))).filter(|(gap, _)| *gap <= LOST);
    let (_, found) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // only where a hit confirms that it is one
    let found = linked(scene, found.clone(), None);
    next(scene, &found, all, forward).is_some_and(|next| next.flight.score >= CLEAR).then_some(found)
}

/// Whether a flight goes on with another, but for an interval that the film's times lack or have too much.
fn continues(scene: &Scene<'_>, known: &Flight, found: &Flight, forward: bool) -> bool {
    let (a, b) = if forward { (known, found) } else { (found, known) };
    if found.members.len() < 4 || b.last() <= a.last() || b.first() <= a.first() || b.first() < a.last() {
        return false;
    }
    let time = scene.times[b.first()];
    let (place, velocity) = (b.path.at(time), b.path.velocity_at(time));
    let width = a.across.max(b.across);
    [0.0, 1.0, -1.0].into_iter().any(|shift| {
        let then = time + shift * scene.interval();
        let (at, was) = (a.path.at(then), a.path.velocity_at(then));
        let off = (at[0] - place[0]).hypot(at[1] - place[1]);
        let turned = (was[0] - velocity[0]).hypot(was[1] - velocity[1]);
        off < ON * width && turned < ON * velocity[0].hypot(velocity[1]).max(width / scene.interval() * 0.2)
    })
}

/// Whether a flight is one that follows another, or precedes it.
pub(super) fn follows(scene: &Scene<'_>, known: &Flight, found: &Flight, forward: bool) -> bool {
    let (a, b) = if forward { (known, found) } else { (found, known) };
    if found.members.len() < 3 || b.last() <= a.last() || b.first() <= a.first() {
        return false;
    }
    let Some((time, distance)) = a.path.meets(&b.path) else { return false };
    let slack = scene.interval();
    let between = time > scene.times[a.last()] - slack && time < scene.times[b.first()] + slack;
    let width = a.across.max(b.across);
    // it falls in and leaves upwards, more slowly
    let (speed_in, speed_out) = (a.path.velocity_at(time)[1], b.path.velocity_at(time)[1]);
    let bounced = speed_in > 0.0 && speed_out < -LEAVES * speed_in && speed_out > -1.1 * speed_in;
    between && bounced && distance < MEETING * width
}
