//! Phases of a track: held, in free flight, in contact, and what follows.

use super::choose::free;
use super::search::Scene;
use super::track::Track;

/// What happens to the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Something holds it.
    Held,
    /// It flies freely.
    Ballistic,
    /// It touches the ground: the time between two pictures that contains the hit.
    Contact,
    /// It has stopped flying: it rolls, slides or rests.
    Rest,
}

/// A phase with its pictures and times.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Span {
    /// What happens.
    pub phase: Phase,
    /// Numbers of its first and last picture in the film.
    pub frames: [usize; 2],
    /// Its beginning and end \[s\].
    pub seconds: [f64; 2],
}

/// The phases of a track.
pub(super) fn of(scene: &Scene<'_>, track: &Track, numbers: &[usize]) -> Vec<Span> {
    let mut phases = Vec::new();
    let span =
        |phase, [first, last]: [usize; 2], seconds| Span { phase, frames: [numbers[first], numbers[last]], seconds };
    let links = &track.chain.links;
    let begin = free(scene, track, 0).first().copied().unwrap_or_else(|| links[0].flight.first());
    if begin > 0 {
        phases.push(span(Phase::Held, [0, begin - 1], [scene.times[0], scene.times[begin]]));
    }
    let mut from = (begin, scene.times[begin]);
    for (link, hit) in links.iter().zip(&track.hits) {
        let last = link.flight.last();
        let end = hit.map_or(scene.times[last], |hit| hit.time);
        phases.push(span(Phase::Ballistic, [from.0.min(last), last], [from.1, end]));
        if let Some(hit) = hit {
            let before = scene.times.partition_point(|t| *t < hit.time).saturating_sub(1);
            let after = (before + 1).min(scene.times.len() - 1);
            phases.push(span(Phase::Contact, [before, after], [hit.time; 2]));
            from = (after, hit.time);
        }
    }
    let seen = track.spots.iter().rposition(Option::is_some).unwrap_or(0);
    let last = links[links.len() - 1].flight.last();
    if track.hits.last().is_some_and(Option::is_some) && seen > last {
        phases.push(span(Phase::Rest, [last + 1, seen], [from.1, scene.times[seen]]));
    }
    phases
}
