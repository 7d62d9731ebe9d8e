//! The part of a film to use: a free fall, the contact, and what follows.

use super::search::Scene;
use super::track::{Hit, Track};

/// Least number of pictures of free flight before the contact.
pub(super) const LEAST_FREE: usize = 3;

/// Number of pictures of free flight from which on an earlier contact is preferred to one with more.
const ENOUGH_FREE: usize = 5;

/// A component around the object whose area is larger by this factor is a hand that still touches it.
const HELD: f64 = 2.0;

/// Least contrast of a hand as a share of the object's: a change of the light around it is fainter.
const CLEAR: f64 = 0.4;

/// The chosen part, as indices of the surveyed pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::video::film) struct Run {
    /// First picture: the object is whole and free.
    pub first: usize,
    /// Last picture.
    pub last: usize,
    /// Number of the flight that ends with the contact.
    pub flight: usize,
    pub hit: Hit,
}

/// The first flight with a contact and enough pictures before it, or the one with most.
pub(super) fn run(scene: &Scene<'_>, track: &Track) -> Option<Run> {
    let of = |flight: usize| {
        let hit = track.hits[flight]?;
        let free: Vec<usize> = free(scene, track, flight).into_iter().filter(|k| scene.times[*k] < hit.time).collect();
        let first = *free.first()?;
        (free.len() >= LEAST_FREE).then(|| (free.len(), Run { first, last: last(scene, track, flight), flight, hit }))
    };
    let all: Vec<(usize, Run)> = (0..track.hits.len()).filter_map(of).collect();
    let enough = all.iter().find(|(count, _)| *count >= ENOUGH_FREE);
    // of equal ones the first
    let most = all.iter().rev().max_by_key(|(count, _)| *count);
    enough.or(most).map(|(_, run)| *run)
}

/// Pictures of a flight from the first on in which the object is whole and nobody holds it.
pub(super) fn free(scene: &Scene<'_>, track: &Track, flight: usize) -> Vec<usize> {
    let members = &track.chain.links[flight].flight.members;
    let is_free = |&&(k, j): &&(usize, usize)| {
        let own = &scene.pieces[k][j];
        let around = |other: &&super::components::Component| {
            let [left, top, right, bottom] = other.rect;
            let inside = left <= own.rect[0] && top <= own.rect[1] && right >= own.rect[2] && bottom >= own.rect[3];
            let alike = other.contrast > CLEAR * own.contrast;
            inside && alike && other.area > HELD * own.area && other.covers(own.middle)
        };
        !own.cut && !scene.pieces[k].iter().any(|other| around(&other))
    };
    let first = members.iter().position(|member| is_free(&member)).unwrap_or(members.len());
    members[first..].iter().map(|(k, _)| *k).collect()
}

/// The last picture before the next contact, or the last in which the object is seen.
fn last(scene: &Scene<'_>, track: &Track, flight: usize) -> usize {
    match track.hits.get(flight + 1).copied().flatten() {
        Some(next) => scene.times.partition_point(|t| *t < next.time).saturating_sub(1),
        None => track.spots.iter().rposition(Option::is_some).unwrap_or(scene.times.len() - 1),
    }
}
