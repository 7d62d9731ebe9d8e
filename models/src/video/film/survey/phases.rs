//! Phases of a track: held, in free flight, in contact, and what follows.

use super::choose::free;
use super::search::Scene;
use super::track::Track;
use crate::video::story::{Doing, Phase, WITHIN};

/// Standard deviation of the time at which two fitted flights meet, in intervals.
const MET: f64 = 0.1;

/// The phases of a track.
pub(super) fn of(scene: &Scene<'_>, track: &Track, numbers: &[usize]) -> Vec<Phase> {
    let mut phases = Vec::new();
    let interval = scene.interval();
    let (seen, met) = (WITHIN * interval, MET * interval);
    let phase = |doing, [first, last]: [usize; 2], begin, end| Phase {
        doing,
        frames: numbers[first]..=numbers[last.max(first)],
        begin,
        end,
    };
    let links = &track.chain.links;
    let begin = free(scene, track, 0).first().copied().unwrap_or_else(|| links[0].flight.first());
    if begin > 0 {
        phases.push(phase(Doing::Held, [0, begin - 1], (scene.times[0], 0.0), (scene.times[begin], seen)));
    }
    let mut from = (begin, (scene.times[begin], seen));
    for (link, hit) in links.iter().zip(&track.hits) {
        let last = link.flight.last();
        let end = hit.map_or((scene.times[last], seen), |hit| (hit.time, if hit.after.is_some() { met } else { seen }));
        phases.push(phase(Doing::Flight, [from.0.min(last), last], from.1, end));
        if let Some(hit) = hit {
            let before = scene.times.partition_point(|t| *t < hit.time).saturating_sub(1);
            let after = (before + 1).min(scene.times.len() - 1);
            phases.push(phase(Doing::Contact, [before, after], end, end));
            from = (after, end);
        }
    }
    let seen_last = track.spots.iter().rposition(Option::is_some).unwrap_or(0);
    let last = links[links.len() - 1].flight.last();
    if track.hits.last().is_some_and(Option::is_some) && seen_last > last {
        phases.push(phase(Doing::Rest, [last + 1, seen_last], from.1, (scene.times[seen_last], seen)));
    }
    phases
}
