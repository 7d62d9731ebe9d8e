//! The phases and the track of a film whose silhouettes are known.

use crate::video::parabola::Parabola;
use crate::video::{Clip, Curve, Doing, Phase, Sight, Story, WITHIN};

/// Least coverage of a pixel of the object.
const COVERED: f32 = 0.5;

/// Adds to a story what the silhouettes of a clip and its free flight tell: where the object is, the parabola of the
/// flight, and its end. What the story knows already is left as it is.
pub(super) fn completed(story: Story, clip: &Clip, flying: usize) -> Story {
    let number = |k: usize| clip.frame_numbers.get(k).map_or(k, |number| usize::try_from(*number).unwrap_or(0));
    let dt = clip.frame_dt();
    let seconds = |k: usize| number(0) as f64 * dt + clip.times.get(k).copied().unwrap_or(0.0);
    let frames = clip.frames.first().map_or(&[][..], Vec::as_slice);
    let mut story = story;
    if story.track.is_empty() {
        let sight = |(k, frame): (usize, &crate::video::Frame)| {
            let seen = |((y, x), alpha): ((usize, usize), &f32)| {
                (*alpha > COVERED).then_some([x as f64 + 0.5, y as f64 + 0.5])
            };
            let places: Vec<[f64; 2]> = frame.alpha.indexed_iter().filter_map(seen).collect();
            let count = places.len() as f64;
            let middle = [0, 1].map(|c| places.iter().map(|place| place[c]).sum::<f64>() / count);
            let across = 2.0 * (count / std::f64::consts::PI).sqrt();
            (count > 0.0).then_some(Sight { number: number(k), seconds: seconds(k), middle, across })
        };
        story.track = frames.iter().enumerate().filter_map(sight).collect();
    }
    if story.phases.is_empty() && flying > 0 && !frames.is_empty() {
        let last = (flying - 1).min(frames.len() - 1);
        let flight = Phase {
            doing: Doing::Flight,
            frames: number(0)..=number(last),
            begin: (seconds(0), 0.0),
            end: (seconds(last) + 0.5 * dt, WITHIN * dt),
        };
        let ends = last + 1 < frames.len();
        let contact = Phase {
            doing: Doing::Contact,
            frames: number(last + 1)..=number(last + 1),
            begin: flight.end,
            end: (seconds(last + 1) + 0.5 * dt, WITHIN * dt),
        };
        story.phases = std::iter::once(flight).chain(ends.then_some(contact)).collect();
    }
    if story.curves.is_empty() {
        let of = story.phases.iter().filter(|phase| phase.doing == Doing::Flight);
        let curve = |phase: &Phase| {
            let seen: Vec<&Sight> = story.track.iter().filter(|sight| phase.frames.contains(&sight.number)).collect();
            curve(&seen, [phase.begin.0, phase.end.0])
        };
        story.curves = of.filter_map(curve).collect();
    }
    story
}

/// The parabola of least squares through some positions; `None` for fewer than three.
fn curve(seen: &[&Sight], seconds: [f64; 2]) -> Option<Curve> {
    let points: Vec<(f64, [f64; 2])> = seen.iter().map(|sight| (sight.seconds, sight.middle)).collect();
    Parabola::fit(&points, None).map(|path| Curve::of(&path, seconds, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_goes_through_what_falls() {
        let place = |t: f64| [10.0 + 30.0 * t, 5.0 - 20.0 * t + 0.5 * 400.0 * t * t];
        let seen: Vec<Sight> = (0..5)
            .map(|k| 3.0 + 0.1 * f64::from(k))
            .map(|seconds| Sight { number: 0, seconds, middle: place(seconds - 3.0), across: 4.0 })
            .collect();
        let curve = curve(&seen.iter().collect::<Vec<_>>(), [3.0, 3.4]).unwrap();
        assert!((curve.acceleration[1] - 400.0).abs() < 1e-6 && curve.acceleration[0].abs() < 1e-6, "{curve:?}");
        let [x, y] = curve.at(3.25);
        assert!((x - place(0.25)[0]).abs() < 1e-9 && (y - place(0.25)[1]).abs() < 1e-9);
        assert_eq!(super::curve(&[&seen[0], &seen[1]], [0.0, 1.0]), None);
        assert_eq!(super::curve(&[&seen[0], &seen[0], &seen[0]], [0.0, 1.0]), None);
    }
}
