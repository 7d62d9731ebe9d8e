//! How a body that a single camera saw leans away from it, to the side or upwards, and how far away it is.

use std::borrow::Cow;

use gradreel::Result;

use crate::field::bounding_sphere;
use crate::particles::Particles;
use crate::vector::{dot, minus};
use crate::video::{Camera, Clip};

/// The only camera of a clip, and where it sees the middle of the object in the first frame.
///
/// What lies how deep in that frame, nobody saw. A body that leans has every point moved along its own ray,
/// `x' = e + (x − e) (1 + a u + b v + c)` with the camera at `e` and the tangents `u` (to the right) and `v` (upwards) of the angles between
/// the point and the middle, so that the frame stays as it is, and depth grows by `a` metres for each metre to the right, by `b`
/// for each upwards, and by `c` for each of the distance, with which the body grows as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    eye: [f64; 3],
    /// Right, up and away in the world.
    axes: [[f64; 3]; 3],
    /// Tangents of the middle.
    middle: [f64; 2],
}

impl Sight {
    /// That of a clip; `None` if several cameras saw the object, or views from all around are given.
    ///
    /// # Errors
    /// When no camera sees the object in the first frame.
    pub fn of(clip: &Clip) -> Result<Option<Self>> {
        match (&clip.cameras[..], &clip.around) {
            ([camera], None) => Ok(Self::at(camera, bounding_sphere(clip, 0)?.centre)),
            _ => Ok(None),
        }
    }

    /// That of a camera at the middle of an object; `None` if it lies behind the camera.
    pub fn at(camera: &Camera, middle: [f64; 3]) -> Option<Self> {
        let axis = |column: usize, sign: f64| camera.c2w.map(|row| sign * row[column]);
        let axes = [axis(0, 1.0), axis(1, 1.0), axis(2, -1.0)];
        let sight = Self { eye: camera.centre(), axes, middle: [0.0; 2] };
        sight.tangents(middle).map(|middle| Self { middle, ..sight })
    }

    /// How far to the right of the middle a point is seen, and how far above; `None` behind the camera.
    fn tangents(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let [right, up, away] = self.axes.map(|axis| dot(axis, minus(point, self.eye)));
        (away > 0.0).then(|| [right / away - self.middle[0], up / away - self.middle[1]])
    }

    /// How a point moves for each unit of lean, to the right, upwards and in distance.
    pub fn rates(&self, point: [f64; 3]) -> [[f64; 3]; 3] {
        let ray = minus(point, self.eye);
        let [right, up] = self.tangents(point).unwrap_or_default();
        [right, up, 1.0].map(|share| ray.map(|x| x * share))
    }

    /// The body with this lean.
    pub fn leaning<'a>(&self, body: &'a Particles, lean: [f64; 3]) -> Cow<'a, Particles> {
        if lean == [0.0; 3] {
            return Cow::Borrowed(body);
        }
        let moved = |x: &[f64; 3]| {
            let rates = self.rates(*x);
            std::array::from_fn(|axis| x[axis] + (0..3).map(|k| lean[k] * rates[k][axis]).sum::<f64>())
        };
        Cow::Owned(Particles { positions: body.positions.iter().map(moved).collect(), ..body.clone() })
    }
}

/// The range in which a lean is expected, in metres of depth for each to the right or upwards: 90 % of bodies that are no deeper
/// than they are wide, turned anyhow, lean less.
const LEAN: [f64; 2] = [-0.6, 0.6];

/// The range in which the distance of a body is expected to differ from what its fall says, as a share, where nothing more is said of it.
const FARTHER: [f64; 2] = [-0.15, 0.15];

/// The range in which a component of the lean is expected.
pub(super) fn range_of(axis: usize) -> [f64; 2] {
    if axis < 2 { LEAN } else { FARTHER }
}
