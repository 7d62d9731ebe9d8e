//! The object's path: its boxes lifted into space.

use gradreel::{Error, ErrorKind, Result};

use crate::field::bounding_sphere;
use crate::vector::{dot, minus, norm, plus, scaled, unit};
use crate::video::{Camera, Clip};
use crate::views::ImageBox;

/// Where the object is in every frame, and how large it looks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Path {
    /// The middle of its box, at its distance \[m\].
    pub places: Vec<[f64; 3]>,
    /// Half the longer side of its box \[m\].
    pub radii: Vec<f64>,
}

impl Path {
    /// That of boxes in the pictures of a film's camera.
    ///
    /// A box gives the direction. The distance is that of the free fall; after it the object is taken to stay in the vertical plane
    /// that faces the camera, in which the fall left it. Without a fall that plane goes through where the first frame has it.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] where a box lies behind the camera or its ray meets no such plane.
    pub fn of_boxes(film: &Clip, boxes: &[ImageBox]) -> Result<Self> {
        let camera = &film.cameras[0];
        let ahead = ahead(camera);
        let first = bounding_sphere(film, 0)?.centre;
        let depth_of = |frame: usize| match &film.flight {
            Some(flight) => {
                let last = frame.min(flight.frames.saturating_sub(1));
                dot(ahead, flight.at(film.times[last] - film.times[0]))
            }
            None => dot(ahead, first),
        };
        let mut path = Self { places: Vec::new(), radii: Vec::new() };
        for (frame, bounds) in boxes.iter().enumerate() {
            let sides = [camera.width as f64, camera.height as f64];
            let middle = bounds.centre();
            let (from, along) = camera.ray(middle[0] * sides[0], middle[1] * sides[1]);
            let t = (depth_of(frame) - dot(ahead, from)) / dot(ahead, along);
            let place = plus(from, scaled(along, t));
            let Some([_, _, depth]) = camera.project(place).filter(|_| t.is_finite() && t > 0.0) else {
                return Err(Error::new(ErrorKind::Input, "the box of a frame is nowhere in front of the camera")
                    .at(format!("frame {}", film.frame_numbers[frame]))
                    .found(format!("{bounds:?}"))
                    .wanted("a box around the object that the film shows")
                    .fix("correct the file of --boxes, or leave it out to take those of the masks"));
            };
            let half =
                |axis: usize, focal: f64| 0.5 * (bounds.high[axis] - bounds.low[axis]) * sides[axis] * depth / focal;
            path.places.push(place);
            path.radii.push(half(0, camera.fx).max(half(1, camera.fy)));
        }
        Ok(path)
    }

    /// That of a clip of several filmed cameras: their rays meet.
    ///
    /// # Errors
    /// As [`bounding_sphere`].
    pub fn of_views(clip: &Clip) -> Result<Self> {
        let mut path = Self { places: Vec::new(), radii: Vec::new() };
        for frame in 0..clip.frame_count() {
            let sphere = bounding_sphere(clip, frame)?;
            path.places.push(sphere.centre);
            path.radii.push(sphere.radius / 1.1);
        }
        Ok(path)
    }

    /// How far each frame has the object from where the first has it \[m\].
    pub fn offsets(&self) -> Vec<[f64; 3]> {
        self.places.iter().map(|place| minus(*place, self.places[0])).collect()
    }

    /// The largest radius.
    pub fn largest(&self) -> f64 {
        self.radii.iter().copied().fold(0.0, f64::max)
    }

    /// Lowest and highest corner of a box around the object in all frames \[m\].
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let ends = |sign: f64| {
            let of = move |axis: usize| {
                self.places.iter().zip(&self.radii).map(move |(place, radius)| place[axis] + sign * radius)
            };
            [0, 1, 2]
                .map(|axis| of(axis).reduce(|a, b| if sign < 0.0 { a.min(b) } else { a.max(b) }).unwrap_or_default())
        };
        [ends(-1.0), ends(1.0)]
    }
}

/// The horizontal direction in which a camera looks; straight down it is its own axis.
fn ahead(camera: &Camera) -> [f64; 3] {
    let axis = camera.c2w.map(|row| -row[2]);
    let level = [axis[0], 0.0, axis[2]];
    if norm(level) > 0.2 { unit(level) } else { unit(axis) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::tests::scene::{falling, film};

    /// Boxes of a ball that falls and stays where it lands are lifted to where the ball is.
    #[test]
    fn boxes_of_a_falling_ball_are_where_it_is() {
        let film = film(8);
        let boxes = crate::published::boxes::of_masks(&film).unwrap();
        let path = Path::of_boxes(&film, &boxes).unwrap();
        for frame in 0..8 {
            let (place, radius) = falling(frame);
            let off = norm(minus(path.places[frame], place));
            assert!(off < 0.15 * radius, "frame {frame}: {:?} for {place:?}", path.places[frame]);
            assert!((path.radii[frame] / radius - 1.0).abs() < 0.1, "{} for {radius}", path.radii[frame]);
        }
        let [low, high] = path.bounds();
        assert!((0..3).all(|axis| low[axis] < high[axis]));
        assert_eq!(path.offsets()[0], [0.0; 3]);
    }

    #[test]
    fn a_box_behind_a_camera_that_looks_down_is_nowhere() {
        let mut film = film(3);
        // a camera that looks 60° down, and a box so far below its picture that it is behind
        film.cameras[0] = Camera::around(0, [64, 64], 2.6, [0.0; 3], 2.0, [0.0, 1.05]);
        film.flight = None;
        let boxes = [ImageBox { low: [0.4, 40.0], high: [0.6, 41.0] }; 3];
        let error = Path::of_boxes(&film, &boxes).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
    }
}
