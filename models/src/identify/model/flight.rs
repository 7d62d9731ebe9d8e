//! Free flight as the silhouettes show it, before anything was fitted.

use crate::field::{bounding_sphere, meeting_point, middle};
use crate::video::Clip;

/// How strongly an unseen depth is held to that of the first frame: next to nothing beside what two cameras see.
const DEPTH_HELD: f64 = 1e-6;

/// How far free flight has gone after a time \[m\]: `v t + g t²/2`.
pub(in crate::identify) fn displacement(velocity: [f64; 3], gravity: [f64; 3], t: f64) -> [f64; 3] {
    [0, 1, 2].map(|axis| velocity[axis] * t + 0.5 * gravity[axis] * t * t)
}

/// The initial velocity \[m/s\] with which a point in free flight follows the middles of the silhouettes through the first
/// `frames` frames: least squares of `x₀ + v t + g t²/2`.
///
/// What a single camera saw of a flight has told its velocity already. Of several, a camera counts in a frame when it has the
/// whole object in that frame and in the first one. With a single camera and no flight the object is taken to stay as deep as it
/// was. `None` when no camera shows a motion.
pub fn velocity_of_silhouettes(clip: &Clip, gravity: [f64; 3], frames: usize) -> Option<[f64; 3]> {
    if let Some(flight) = &clip.flight {
        return Some(flight.velocity);
    }
    let depth = bounding_sphere(clip, 0).ok()?.centre;
    let (mut weight, mut moved) = (0.0, [0.0; 3]);
    for frame in 1..frames.min(clip.frame_count()) {
        let views = clip.cameras.iter().zip(&clip.frames);
        let pairs: Vec<_> =
            views.filter_map(|(camera, f)| Some((camera, middle(&f[0])?, middle(&f[frame])?))).collect();
        if pairs.is_empty() {
            continue;
        }
        let before = meeting_point(pairs.iter().map(|(camera, from, _)| (*camera, *from)), depth, DEPTH_HELD)?;
        let after = meeting_point(pairs.iter().map(|(camera, _, to)| (*camera, *to)), before, DEPTH_HELD)?;
        let t = clip.times[frame] - clip.times[0];
        weight += t * t;
        let fallen = displacement([0.0; 3], gravity, t);
        for axis in 0..3 {
            moved[axis] += t * (after[axis] - before[axis] - fallen[axis]);
        }
    }
    (weight > 0.0).then(|| moved.map(|sum| sum / weight))
}
