//! Contacts that are shorter than the time between two pictures.
//!
//! A body is on the flight before until it touches, and on the next one from when it leaves. If two consecutive
//! pictures show it on one flight each, the whole contact lies between them, as far as pictures of a contact are told
//! from those of flights. In a contact of the length `τ`, half a sine, it departs from the flight before by
//! `v (s − τ/π sin(π s/τ)) ≈ v π² s³/(6 τ²)` at the time `s` after it touched: what departs by less than the gate
//! around a flight is taken for a part of it. Where the body is not seen around a hit, the flights themselves tell: the
//! one that ends at the speed `v` and the one that begins at `e v`, extended, cross `τ/(1 + e)` before the latter begins.
//! Two hypotheses are compared: a contact of up to half an interval, and one of three.

use super::search::{Model, Scene, gate};
use super::track::Track;

/// Length of a contact that is to be told from a short one, in intervals between pictures.
const LONG: f64 = 3.0;

/// Probability that no picture shows a contact of up to half an interval, of any length alike.
const UNSEEN: f64 = 0.75;

/// Least probability of anything: tracks err.
const LEAST: f64 = 0.03;

/// Probability that flights which were not seen to their ends cross as they do after a short contact.
const CROSSED: f64 = 0.1;

/// Evidence for a short contact from which on it is taken for one \[nat\]: three to one.
const SURE: f64 = 1.1;

/// Reach around the place of a hit in which a picture shows the contact, in widths.
const REACH: f64 = 1.5;

/// What the places of an extended flight err by, in displacements from picture to picture; the middle of a long contact is
/// off by half of one.
const BEYOND: f64 = 0.15;

/// What the pictures around one hit show of its contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Around {
    /// Time between the last picture of the flight before and the first of the next \[s\].
    pub gap: f64,
    /// Number of pictures in between, and of those among them that show the whole object there, off both flights.
    pub between: usize,
    pub seen: usize,
    /// Number of those that do not show the whole object.
    pub hidden: usize,
    /// The longest contact after which the flights cross where they do \[s\].
    pub room: f64,
    /// Displacement from picture to picture before the hit, in gates around a flight.
    pub moves: f64,
}

impl Around {
    /// Whether the flights cross as they do after a short contact only, however far they are extended.
    fn crosses(&self, interval: f64) -> bool {
        2 * self.hidden > self.between && self.room < 0.5 * LONG * interval
    }

    /// Evidence of the hit for a short contact against a long one \[nat\].
    fn evidence(&self, interval: f64) -> f64 {
        // how long a contact looks like a flight on either side \[intervals\]
        let quiet = (6.0 * LONG * LONG / (std::f64::consts::PI.powi(2) * self.moves)).cbrt();
        let shows = (LONG - 2.0 * quiet).clamp(LEAST, 1.0 - LEAST);
        match (self.between, self.seen) {
            (0, _) => (UNSEEN / (1.0 - shows)).ln(),
            // hidden
            (_, 0) if self.crosses(interval) => (UNSEEN / CROSSED).ln(),
            (_, 0) => 0.0,
            (_, 1) => ((1.0 - UNSEEN) / shows).ln(),
            _ => (LEAST / shows).ln(),
        }
    }
}

/// What is seen of each hit between two flights.
pub(super) fn around(scene: &Scene<'_>, track: &Track) -> Vec<Around> {
    let links = &track.chain.links;
    let of = |k: usize| {
        let hit = track.hits[k].filter(|hit| hit.after.is_some())?;
        let (before, after) = (&links[k].flight, &links.get(k + 1)?.flight);
        let (last, first) = (before.last(), after.first());
        let restitution = (-hit.after?[1] / hit.before[1]).clamp(0.05, 1.0);
        let [since, until] = [hit.time - scene.times[last], scene.times[first] - hit.time].map(|t| t.max(0.0));
        let width = before.across.max(after.across).max(1.0);
        let look = Model::of(scene, &before.members);
        let step = hit.before[1].hypot(hit.before[0]) * scene.interval();
        let shows = |k: usize| {
            let from = |to: [f64; 2], place: [f64; 2]| (place[0] - to[0]).hypot(place[1] - to[1]);
            let near = |place: [f64; 2]| from(hit.place, place) / (REACH * width);
            let piece = look.nearest(&scene.pieces[k], near).map(|j| &scene.pieces[k][j]).filter(|piece| !piece.cut)?;
            let flies = [before, after].map(|flight| from(flight.path.at(scene.times[k]), piece.middle));
            Some(flies.into_iter().all(|off| off > gate(width) + BEYOND * step))
        };
        let shown: Vec<bool> = (last + 1..first).filter_map(shows).collect();
        Some(Around {
            gap: (scene.times[first.max(last)] - scene.times[last]).max(scene.interval()),
            room: (until * (1.0 + restitution)).min(since * (1.0 + 1.0 / restitution)),
            between: first.saturating_sub(last + 1),
            hidden: first.saturating_sub(last + 1) - shown.len(),
            seen: shown.iter().filter(|off| **off).count(),
            moves: step / gate(width),
        })
    };
    (0..track.hits.len()).filter_map(of).collect()
}

/// The longest contact for which the pictures leave room, if it is shorter than the time between two of them; `None` if
/// contact is seen, or the hits do not tell.
pub(super) fn longest(hits: &[Around], interval: f64) -> Option<f64> {
    let short = hits.iter().map(|hit| hit.evidence(interval)).sum::<f64>() > SURE;
    let bound = |hit: &Around| match (hit.between, hit.seen) {
        (0, _) => Some(hit.gap),
        (_, 0) if hit.crosses(interval) => Some(hit.room.max(interval)),
        _ => None,
    };
    hits.iter().filter_map(bound).filter(|_| short).reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::super::chain::chains;
    use super::super::components::Component;
    use super::*;
    use crate::video::parabola::GRAVITY;

    fn hit(between: usize, seen: usize, moves: f64) -> Around {
        Around { gap: 0.02 * (between + 1) as f64, room: 0.06, between, seen, hidden: between - seen, moves }
    }

    #[test]
    fn what_the_pictures_around_hits_tell() {
        let longest = |hits: &[Around]| longest(hits, 0.02);
        assert_eq!(longest(&[]), None);
        assert_eq!(longest(&[hit(0, 0, 6.0)]), Some(0.02));
        // a picture of it is no bound
        assert_eq!(longest(&[hit(1, 1, 6.0)]), None);
        // one picture may show a short contact by chance
        assert_eq!(longest(&[hit(1, 1, 6.0), hit(0, 0, 6.0)]), Some(0.02));
        // two may not
        assert_eq!(longest(&[hit(2, 2, 6.0), hit(0, 0, 6.0)]), None);
        assert_eq!(longest(&[hit(2, 2, 6.0), hit(0, 0, 6.0), hit(0, 0, 6.0)]), Some(0.02));
        // where it hardly moves, a contact is not told from a flight
        assert_eq!(longest(&[hit(0, 0, 2.0); 9]), None);
        // what a single hit does not tell, several do
        assert_eq!(longest(&[hit(0, 0, 3.5)]), None);
        assert_eq!(longest(&[hit(0, 0, 3.5); 3]), Some(0.02));
        // hidden for some pictures
        assert_eq!(longest(&[hit(3, 0, 6.0)]), None);
        // but its flights cross where a long contact would not let them
        assert_eq!(longest(&[Around { room: 0.025, ..hit(3, 0, 6.0) }]), Some(0.025));
    }

    /// A number from 0 to 1.
    fn random(seed: u64, number: u64) -> f64 {
        let mut h = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        for _ in 0..3 {
            h = (h ^ (h >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb).wrapping_add(0x1234_5678_9abc_def1);
        }
        (h >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A disc as a component.
    fn disc(middle: [f64; 2], across: f64) -> Component {
        let variance = across * across / 16.0;
        let rect = [0, 1].map(|c| (middle[c] - 0.5 * across).max(0.0) as usize);
        Component {
            middle,
            spread: [variance, 0.0, variance],
            body: [variance, 0.0, variance],
            area: 0.785 * across * across,
            rect: [rect[0], rect[1], rect[0] + across as usize, rect[1] + across as usize],
            colour: [200.0, 60.0, 40.0],
            contrast: 100.0,
            shadow: 0.0,
            cut: false,
            runs: vec![],
        }
    }

    /// A track of a ball whose contacts last `share` of an interval, with pictures at any phase of it.
    ///
    /// The contact is that of a spring: a quarter of a sine while it is compressed, and a longer quarter of one as it is
    /// thrown back.
    ///
    /// It may be `hidden` for some pictures before the first hit.
    fn made(seed: u64, share: f64, hidden: usize) -> Option<f64> {
        let between = |number: u64, low: f64, high: f64| low + (high - low) * random(seed, number);
        let restitution = between(2, 0.3, 0.9);
        let across = between(3, 8.0, 30.0);
        let metres = between(4, 0.03, 0.2) / across;
        let noise = between(5, 0.1, 0.4);
        let a = GRAVITY / metres;
        let fall = between(6, 0.4, 1.5) / metres;
        // it moves by this many of its widths from picture to picture as it hits
        let rate = (2.0 * a * fall).sqrt() / (between(1, 0.7, 3.0) * across);
        let contact = share / rate;
        let first = between(7, 0.0, 1.0) / rate;
        let place = |time: f64| {
            let x = 50.0 + 0.3 / metres * time;
            let (mut from, mut speed) = ((2.0 * fall / a).sqrt(), (2.0 * a * fall).sqrt());
            if time < from {
                return [x, 0.5 * a * time * time];
            }
            loop {
                let quarter = contact / (1.0 + 1.0 / restitution);
                let deep = speed * quarter * 2.0 / std::f64::consts::PI;
                let since = time - from;
                if since < contact {
                    let phase = match since < quarter {
                        true => since / quarter,
                        false => 1.0 + (since - quarter) / (contact - quarter),
                    };
                    return [x, fall + deep * (0.5 * std::f64::consts::PI * phase).sin()];
                }
                speed *= restitution;
                let rises = 2.0 * speed / a;
                if since < contact + rises || speed < 1.0 {
                    let t = (since - contact).min(rises);
                    return [x, fall - speed * t + 0.5 * a * t * t];
                }
                from += contact + rises;
            }
        };
        let times: Vec<f64> = (0..(1.6 * rate) as usize).map(|k| first + k as f64 / rate).collect();
        let hit = times.partition_point(|time| *time < (2.0 * fall / a).sqrt());
        let normal = |number: u64| (0..4).map(|k| random(seed, 4 * number + k) - 0.5).sum::<f64>() * 3f64.sqrt();
        let pieces: Vec<Vec<Component>> = times
            .iter()
            .enumerate()
            .map(|(k, time)| {
                if (hit.saturating_sub(hidden)..hit).contains(&k) {
                    return vec![];
                }
                let [x, y] = place(*time);
                vec![disc(
                    [x + noise * normal(1000 + 2 * k as u64), y + 40.0 + noise * normal(1001 + 2 * k as u64)],
                    across,
                )]
            })
            .collect();
        let scene = Scene { pieces: &pieces, times: &times };
        let chain = chains(&scene, &scene.flights(&(0.005..=3.0))).into_iter().next()?;
        longest(&around(&scene, &Track::of(&scene, chain)), scene.interval())
    }

    #[test]
    fn contacts_of_made_tracks() {
        let count = 120;
        let recognised =
            |share: f64, hidden: usize| (0..count).filter(|seed| made(*seed, share, hidden).is_some()).count();
        let [tiny, third, three, five] = [0.05, 0.3, 3.0, 5.0].map(|share| recognised(share, 0));
        let behind = [0.3, 3.0].map(|share| recognised(share, 2));

        // what is taken for short at three to one is as often short as that says
        let count = count as usize;
        assert!(tiny * 4 >= 3 * count, "{tiny} of {count}, at a twentieth of an interval");
        assert!(third * 4 >= 3 * count, "{third} of {count}, at a third");
        assert!(three * 3 <= third, "{three} of {count}, at three intervals");
        assert!(five * 10 <= count, "{five} of {count}, at five");
        assert!(
            behind[0] * 4 >= 3 * count && behind[1] * 3 <= behind[0],
            "{behind:?} of {count}, unseen before the hit"
        );
        // the bound holds
        for seed in 0..count as u64 {
            let bound = made(seed, 0.3, 0);
            assert!(bound.is_none_or(|bound| bound > 0.3 / 120.0), "{bound:?}");
        }
    }
}
