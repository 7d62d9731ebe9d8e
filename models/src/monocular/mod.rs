//! Monocular: where an object is that a single camera saw.
//!
//! One camera sees no distance, but it sees the object fall: gravity gives every pixel its metres. [`FreeFall`] fits the
//! parabola to what the silhouettes show ([`Sighting`]), frame after frame until the object touches something; [`locate`] corrects
//! what a silhouette shows besides the object's centre, by a body that is as deep as it is wide
//! ([`half_thickness`](crate::field::half_thickness)). [`sight`] does so for a calibrated camera.
//!
//! [`clip_of_film`] makes a clip of a film of which nothing is known: the camera is upright and looks down by an angle that is found
//! with the fall, its angle of view is assumed (the metres hardly depend on it: what falls by so many pixels in a second is so far
//! away in focal lengths), and the ground is where the object is lowest after its fall.
//!
//! [`surround`] puts views that nobody filmed around the object: what it looks like from elsewhere, as a model imagines it.

mod film;
mod free_fall;
mod ground;
mod locate;
mod sighting;
mod surround;

pub use film::clip_of_film;
pub use free_fall::{Down, FreeFall};
pub use locate::locate;
pub use sighting::Sighting;
pub use surround::surround;

use gradreel::Result;

use crate::vector::dot;
use crate::video::{Clip, Flight};

/// Gives a clip of a single calibrated camera its [`Flight`], if that camera sees the object fall, and says what follows from it;
/// other clips are left as they are.
///
/// # Errors
/// [`gradreel::ErrorKind::NonFinite`] for a camera whose matrix is not finite.
pub fn sight(clip: &mut Clip, gravity: [f64; 3]) -> Result<()> {
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
    });
    clip.assumptions.push(format!(
        "a single camera: the object is {distance:.3} m away (± {:.0} %), as it falls freely in the first {} frames; it is taken \
         to be as deep as it is wide, part by part",
        100.0 * fall.deviation,
        fall.frames
    ));
    Ok(())
}

/// Half of the larger extent of what the first frame of a clip shows, as a share of its distance.
fn half_extent(clip: &Clip) -> f64 {
    locate::Body::of(&clip.cameras[0], &clip.frames[0][0]).map_or(0.0, |body| body.half_extent())
}
