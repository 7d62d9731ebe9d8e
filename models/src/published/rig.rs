//! The model's cameras in the film's world.

use crate::published::Path;
use crate::vector::{minus, plus, product, scaled, times, transposed};
use crate::video::Camera;
use crate::views::Ring;

/// Least distance of the object from the edge of a view, as a share of the picture.
const EDGE: f64 = 0.02;

/// Largest size of an object that the model is told to place anywhere, in units of the model.
const LARGEST: f64 = 0.55;

/// Steps by which the cameras are moved away until they see the whole path.
const STEP: f64 = 1.03;

/// A ring of cameras that stand still and see the object's whole path.
///
/// The model's world is turned about the vertical so that its first view is from the film's side, scaled and moved:
/// `x = origin + scale · turn · m` with its y axis up.
#[derive(Debug, Clone)]
pub(crate) struct Rig {
    ring: Ring,
    origin: [f64; 3],
    scale: f64,
    turn: [[f64; 3]; 3],
    /// Elevation of the film's camera as seen from the origin \[rad\].
    elevation: f64,
}

impl Rig {
    /// The smallest ring whose cameras, and one at the film's side, see the whole path within the model's cube; larger, where the object
    /// would look larger than models are told to place.
    pub fn around(ring: &Ring, film: &Camera, path: &Path) -> Self {
        let [low, high] = path.bounds();
        let origin = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        let away = minus(film.centre(), origin);
        let first = ring.camera(0, 1).centre();
        let (sine, cosine) = (away[0].atan2(away[2]) - first[0].atan2(first[2])).sin_cos();
        let turn = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
        let elevation = away[1].atan2(away[0].hypot(away[2]));
        let scale = 2.0 * path.largest() / LARGEST;
        let mut rig = Self { ring: ring.clone(), origin, scale, turn, elevation };
        while !rig.sees(path) {
            rig.scale *= STEP;
        }
        rig
    }

    /// Metres of a unit of the model.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Elevation of the film's camera as seen from the origin \[rad\].
    pub fn elevation(&self) -> f64 {
        self.elevation
    }

    /// Number of views.
    pub fn views(&self) -> usize {
        self.ring.views
    }

    /// The camera of a view with `size²` pixels \[m\].
    pub fn camera(&self, view: usize, size: usize) -> Camera {
        self.in_world(self.ring.camera(view, size))
    }

    /// The model's camera of the input picture, on the line from the origin to the film's camera.
    pub fn input(&self, size: usize) -> Camera {
        self.in_world(Ring { elevation: self.elevation, ..self.ring.clone() }.camera(0, size))
    }

    fn in_world(&self, camera: Camera) -> Camera {
        let axes = product(self.turn, camera.c2w.map(|row| [row[0], row[1], row[2]]));
        let to = plus(self.origin, scaled(times(&self.turn, camera.centre()), self.scale));
        Camera { c2w: [0, 1, 2].map(|i| [axes[i][0], axes[i][1], axes[i][2], to[i]]), ..camera }
    }

    /// Whether the cube around the object lies in the model's cube and in all pictures, in every frame.
    fn sees(&self, path: &Path) -> bool {
        let cameras: Vec<Camera> =
            (0..self.ring.views).map(|view| self.camera(view, 1)).chain([self.input(1)]).collect();
        let back = transposed(self.turn);
        path.places.iter().zip(&path.radii).all(|(place, radius)| {
            let corners = (0..8).map(|number: usize| {
                [0, 1, 2].map(|axis| place[axis] + if number >> axis & 1 == 1 { *radius } else { -radius })
            });
            let in_cube = times(&back, minus(*place, self.origin))
                .iter()
                .all(|x| x.abs() + radius <= self.ring.half * self.scale);
            in_cube
                && corners.into_iter().all(|corner| {
                    cameras.iter().all(|camera| {
                        camera
                            .project(corner)
                            .is_some_and(|[u, v, _]| [u, v].iter().all(|x| (EDGE..=1.0 - EDGE).contains(x)))
                    })
                })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::norm;

    fn path() -> Path {
        Path { places: vec![[0.1, 1.0, -0.2], [0.2, 0.6, -0.2], [0.25, 0.1, -0.25]], radii: vec![0.1, 0.1, 0.12] }
    }

    #[test]
    fn the_first_view_is_from_the_side_of_the_film() {
        let film = Camera::around(0, [200, 100], 0.6, [0.1, 0.5, -0.2], 4.0, [2.0, 0.3]);
        let rig = Rig::around(&Ring::published(16), &film, &path());
        let [from, to] = [rig.camera(0, 64), rig.input(64)].map(|camera| minus(camera.centre(), rig.origin));
        let real = minus(film.centre(), rig.origin);
        for away in [from, to] {
            let across = away[0] * real[2] - away[2] * real[0];
            assert!(across.abs() < 1e-9 && away[0] * real[0] + away[2] * real[2] > 0.0, "{away:?} for {real:?}");
        }
        // the input camera is on the line to the film's, 1.5 units away
        assert!((norm(to) / (1.5 * rig.scale()) - 1.0).abs() < 1e-9);
        assert!((to[1] / norm(to) - real[1] / norm(real)).abs() < 1e-9);
        // all look at the origin
        for view in 0..16 {
            let [u, v, _] = rig.camera(view, 64).project(rig.origin).unwrap();
            assert!((u - 32.0).abs() < 1e-6 && (v - 32.0).abs() < 1e-6);
        }
    }

    #[test]
    fn the_whole_path_is_seen_and_no_object_is_too_large() {
        let film = Camera::around(0, [200, 100], 0.6, [0.0, 0.5, 0.0], 3.0, [0.0, 0.1]);
        let rig = Rig::around(&Ring::published(16), &film, &path());
        assert!(rig.sees(&path()));
        let still = Path { places: vec![[0.0; 3]], radii: vec![0.3] };
        let rig = Rig::around(&Ring::published(16), &film, &still);
        assert!(0.6 / rig.scale() <= LARGEST + 1e-9, "{}", rig.scale());
    }
}
