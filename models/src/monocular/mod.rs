//! Monocular: position and scale of an object seen by a single camera.
//!
//! One camera does not observe depth, but it observes the object's fall, and gravity fixes the metric scale.
//! `FreeFall` fits a ballistic trajectory to the silhouettes (`Sighting`), frame after frame until contact;
//! `locate` corrects the bias between silhouette and object centre with a body as deep as it is wide
//! (`half_thickness`). `sight` does so for a calibrated camera.
//!
//! [`clip_of_film`] makes a clip of an uncalibrated film. The film's survey says how many frames are in free flight and
//! how fast all flights accelerate; without it frames are added until one does not fit. The camera is assumed to be upright; its pitch is fitted
//! jointly with the fall. Its angle of view is assumed, which hardly affects the metric scale: an image
//! acceleration in pixels fixes the distance in focal lengths. The ground is at the lowest position of the object
//! after its fall.
//!
//! `bounces` fits all flights of a film whose contacts are shorter than a frame together, for the restitution.
//!
//! `surround` adds synthesized views around the object.

mod bounces;
mod film;
mod free_fall;
mod ground;
mod locate;
mod rate;
mod sighting;
mod story;
mod surround;
#[cfg(test)]
mod tests;

pub use film::clip_of_film;
pub(crate) use free_fall::Down;
pub(crate) use locate::{locate, locate_known};
pub(crate) use surround::surround;

use gradreel::Result;

use crate::vector::dot;
use crate::video::{Clip, Flight};

/// Adds a [`Flight`] to a clip of a single calibrated camera, if that camera sees the object fall, and reports what
/// follows from it; other clips are unchanged.
///
/// # Errors
/// [`gradreel::ErrorKind::NonFinite`] for a camera with a non-finite matrix.
pub(crate) fn sight(clip: &mut Clip, gravity: [f64; 3]) -> Result<()> {
    let strength = dot(gravity, gravity).sqrt();
    let ([camera], true) = (&clip.cameras[..], strength > 0.0) else { return Ok(()) };
    let turn = camera.c2w.map(|row| [row[0], row[1], row[2]]);
    let down = [0, 1, 2].map(|j| (0..3).map(|i| turn[i][j] * gravity[i]).sum::<f64>() / strength);
    let Some(fall) = locate(clip, Down::Known(down))? else { return Ok(()) };
    let distance = strength / fall.gravity;
    let world = |x: [f64; 3]| turn.map(|row| distance * dot(row, x));
    let (centre, from) = (world(fall.start), camera.centre());
    clip.flight = Some(Flight {
        centre: [0, 1, 2].map(|axis| centre[axis] + from[axis]),
        velocity: world(fall.velocity),
        velocity_covariance: fall.velocity_covariance(&turn, distance),
        velocity_with_distance: fall.velocity_with_distance(&turn, distance),
        gravity,
        frames: fall.frames,
        distance,
        diameter: 2.0 * distance * half_extent(clip),
        deviation: fall.deviation,
        scales_world: false,
        pitch: fall.pitch_spread(&turn, distance),
    });
    clip.assumptions.push(format!(
        "a single camera: the object is {distance:.3} m away (± {:.0} %), as it falls freely in the first {} frames; it is taken \
         to be as deep as it is wide, part by part",
        100.0 * fall.deviation,
        fall.frames
    ));
    Ok(())
}

/// Half of the larger extent of the object in the first frame, as a share of its distance.
fn half_extent(clip: &Clip) -> f64 {
    locate::Body::of(&clip.cameras[0], &clip.frames[0][0]).map_or(0.0, |body| body.half_extent())
}
