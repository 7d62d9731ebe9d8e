//! Depth modes of a body that a single camera saw: its shear along the rays, its distance, and the camera's pitch.

use std::borrow::Cow;

use gradreel::Result;

use super::pitch::Pitch;
use crate::field::bounding_sphere;
use crate::identify::Unknowns;
use crate::particles::Particles;
use crate::vector::{dot, minus, product};
use crate::video::{Camera, Clip};

/// The only camera of a clip, and where it sees the middle of the object in the first frame.
///
/// What lies how deep in that frame, nobody saw. A body that is sheared has every point moved along its own ray,
/// `x' = e + (x − e) (1 + a u + b v + c)` with the camera at `e` and the tangents `u` (to the right) and `v` (upwards) of the angles between
/// the point and the middle, so that the frame stays as it is, and depth grows by `a` metres for each metre to the right, by `b`
/// for each upwards, and by `c` for each of the distance, with which the body grows as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    camera: [f64; 3],
    /// Right, up and away in the world.
    axes: [[f64; 3]; 3],
    /// The middle, and its tangents.
    centre: [f64; 3],
    middle: [f64; 2],
    /// Growth of all lengths with the camera's pitch \[1/rad\].
    growth: f64,
}

impl Sight {
    /// That of a clip; `None` if several cameras saw the object, or views from all around are given.
    ///
    /// # Errors
    /// When no camera sees the object in the first frame.
    pub fn of(clip: &Clip) -> Result<Option<Self>> {
        match (&clip.cameras[..], &clip.around) {
            ([camera], None) => {
                let sight = Self::at(camera, bounding_sphere(clip, 0)?.centre);
                let pitch = clip.flight.map(|flight| flight.pitch).filter(|pitch| pitch.deviation > 0.0);
                let growth = pitch.map_or(0.0, |pitch| pitch.with_distance / pitch.deviation.powi(2));
                Ok(sight.map(|sight| sight.growing(growth)))
            }
            _ => Ok(None),
        }
    }

    /// That of a camera at the middle of an object; `None` if it lies behind the camera.
    pub fn at(camera: &Camera, middle: [f64; 3]) -> Option<Self> {
        let axis = |column: usize, sign: f64| camera.c2w.map(|row| sign * row[column]);
        let axes = [axis(0, 1.0), axis(1, 1.0), axis(2, -1.0)];
        let sight = Self { camera: camera.centre(), axes, centre: middle, middle: [0.0; 2], growth: 0.0 };
        sight.tangents(middle).map(|middle| Self { middle, ..sight })
    }

    /// The same where all lengths grow so with the camera's pitch \[1/rad\].
    #[must_use]
    pub(in crate::identify) fn growing(self, growth: f64) -> Self {
        Self { growth, ..self }
    }

    /// How far to the right of the middle a point is seen, and how far above; `None` behind the camera.
    fn tangents(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let [right, up, away] = self.axes.map(|axis| dot(axis, minus(point, self.camera)));
        (away > 0.0).then(|| [right / away - self.middle[0], up / away - self.middle[1]])
    }

    /// How a point moves for each unit of shear to the right and upwards, and of scale.
    pub fn rates(&self, point: [f64; 3]) -> [[f64; 3]; 3] {
        let ray = minus(point, self.camera);
        let [right, up] = self.tangents(point).unwrap_or_default();
        [right, up, 1.0].map(|share| ray.map(|x| x * share))
    }

    /// How body and camera stand in the world with these depth modes, over a ground of this height.
    pub(in crate::identify) fn pitch(&self, depth: [f64; 4], ground: f64) -> Pitch {
        Pitch::new(self.centre, self.axes[0], self.growth, ground, depth[3])
    }

    /// Where a point of the body is with these depth modes, before the camera's pitch is counted.
    pub(in crate::identify) fn sheared_at(&self, x: [f64; 3], depth: [f64; 4]) -> [f64; 3] {
        let rates = self.rates(x);
        std::array::from_fn(|axis| x[axis] + (0..3).map(|k| depth[k] * rates[k][axis]).sum::<f64>())
    }

    /// The body with these depth modes, over a ground of this height.
    pub(in crate::identify) fn sheared<'a>(
        &self,
        body: &'a Particles,
        depth: [f64; 4],
        ground: f64,
    ) -> Cow<'a, Particles> {
        if depth == [0.0; 4] {
            return Cow::Borrowed(body);
        }
        let pitch = self.pitch(depth, ground);
        let moved = |x: &[f64; 3]| {
            let sheared = self.sheared_at(*x, depth);
            if depth[3] == 0.0 { sheared } else { pitch.placed(sheared) }
        };
        Cow::Owned(Particles { positions: body.positions.iter().map(moved).collect(), ..body.clone() })
    }

    /// Turns a clip and the body in it as the pitch that was found says, so that the vertical of both is that of the world, and lengths are
    /// those with which it moved. Every camera sees every point where it saw it before.
    pub(in crate::identify) fn stand_upright(
        &self,
        (clip, body, unknowns): &mut (Clip, Particles, Unknowns),
        ground: f64,
    ) {
        if unknowns.depth[3] == 0.0 {
            return;
        }
        let pitch = self.pitch(unknowns.depth, ground);
        unknowns.depth[3] = 0.0;
        for camera in &mut clip.cameras {
            let centre = pitch.placed(camera.centre());
            let axes = camera.c2w.map(|[x, y, z, _]| [x, y, z]);
            let turned = product(pitch.turn, axes);
            camera.c2w = std::array::from_fn(|i| [turned[i][0], turned[i][1], turned[i][2], centre[i]]);
        }
        if let Some(flight) = &mut clip.flight {
            flight.centre = pitch.placed(flight.centre);
            flight.distance *= pitch.scale;
            flight.diameter *= pitch.scale;
        }
        body.positions.iter_mut().for_each(|x| *x = pitch.placed(*x));
        body.spacing *= pitch.scale;
    }
}

/// The range in which a depth shear is expected, in metres of depth for each to the right or upwards: 90 % of bodies that are no deeper
/// than they are wide, turned anyhow, are sheared less.
const DEPTH: [f64; 2] = [-0.6, 0.6];

/// The range in which the distance of a body is expected to differ from what its fall says, as a share, where nothing more is said of it.
const SCALE: [f64; 2] = [-0.15, 0.15];

/// The range of what the camera's pitch is off, where no fall tells of it \[rad\].
const PITCH: [f64; 2] = [-0.5, 0.5];

/// The range in which a depth mode is expected.
pub(in crate::identify) fn range_of(axis: usize) -> [f64; 2] {
    match axis {
        0 | 1 => DEPTH,
        2 => SCALE,
        _ => PITCH,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::rotation;

    /// A camera that was taken to look 20° down and looks 32° down: it sees every point where it saw it, and up is up.
    #[test]
    fn what_stands_upright_is_seen_where_it_was() {
        let (ground, angle, growth) = (0.1, 12f64.to_radians(), 0.3);
        let [x, y, z] = rotation([-20f64.to_radians(), 0.0, 0.0]);
        let c2w = [[x[0], x[1], x[2], 0.2], [y[0], y[1], y[2], 1.5], [z[0], z[1], z[2], 0.4]];
        let camera = Camera { id: 0, width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0, c2w };
        let middle = [0.3, 0.6, -2.0];
        let points = vec![middle, [0.4, 0.7, -2.1], [0.1, 0.5, -1.8]];
        let count = points.len();
        let body = Particles {
            positions: points.clone(),
            opacity: vec![1.0; count],
            colour: vec![[0.5; 3]; count],
            spacing: 0.02,
        };
        let clip = Clip {
            name: String::new(),
            root: std::path::PathBuf::new(),
            cameras: vec![camera.clone()],
            times: vec![],
            frame_numbers: vec![],
            frames: vec![vec![]],
            foreground: vec![],
            imagined: vec![false],
            assumptions: vec![],
            flight: None,
            story: None,
            around: None,
        };
        let mut found = (clip, body, Unknowns { depth: [0.1, 0.0, 0.0, angle], ..Unknowns::default() });
        Sight::at(&camera, middle).unwrap().growing(growth).stand_upright(&mut found, ground);
        let (clip, body, unknowns) = found;
        assert_eq!(unknowns.depth, [0.1, 0.0, 0.0, 0.0]);
        let stands = &clip.cameras[0];
        // lengths that grow so with the pitch are those along a line of sight with this slope
        let below = (-growth).atan();
        let scale = (below + angle).cos() / below.cos();
        for (x, old) in body.positions.iter().zip(&points) {
            let ([u, v, depth], [u2, v2, before]) = (stands.project(*x).unwrap(), camera.project(*old).unwrap());
            approx::assert_relative_eq!(u, u2, epsilon = 1e-9);
            approx::assert_relative_eq!(v, v2, epsilon = 1e-9);
            approx::assert_relative_eq!(depth, scale * before, epsilon = 1e-9);
        }
        // it looks along −z of its own, 32° down
        approx::assert_relative_eq!(stands.c2w[1][2], 32f64.to_radians().sin(), epsilon = 1e-12);
        approx::assert_relative_eq!(body.positions[0][1] - ground, scale * (middle[1] - ground), epsilon = 1e-12);
        approx::assert_relative_eq!(body.spacing, scale * 0.02, epsilon = 1e-15);
    }
}
