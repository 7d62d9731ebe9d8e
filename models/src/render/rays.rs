//! Rays: one per pixel, through the pixel's centre.

use rayon::prelude::*;

use crate::vector::unit;
use crate::video::Camera;

/// Rays with unit directions, in metres.
#[derive(Debug, Clone, Default)]
pub struct Rays {
    /// Origin of each ray.
    pub origins: Vec<[f64; 3]>,
    /// Direction of each ray; of unit length, except for `Samples`, which accept any length.
    pub directions: Vec<[f64; 3]>,
}

impl Rays {
    /// One ray for every pixel of a camera, row by row.
    pub fn of_camera(camera: &Camera) -> Self {
        let pixels = camera.width * camera.height;
        let ray = |i: usize| {
            let (u, v) = ((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
            let (origin, direction) = camera.ray(u, v);
            (origin, unit(direction))
        };
        let (origins, directions) = (0..pixels).into_par_iter().map(ray).unzip();
        Self { origins, directions }
    }

    /// The rays of several cameras, concatenated.
    pub fn of_cameras<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Self {
        let mut rays = Self::default();
        for camera in cameras {
            let more = Self::of_camera(camera);
            rays.origins.extend(more.origins);
            rays.directions.extend(more.directions);
        }
        rays
    }

    /// The directions, normalised.
    pub fn unit_directions(&self) -> Vec<[f64; 3]> {
        self.directions.iter().copied().map(unit).collect()
    }

    /// A selection of the rays, in this order.
    ///
    /// # Panics
    /// When an index is out of range.
    #[must_use]
    pub fn picked(&self, numbers: &[usize]) -> Self {
        Self {
            origins: numbers.iter().map(|&i| self.origins[i]).collect(),
            directions: numbers.iter().map(|&i| self.directions[i]).collect(),
        }
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }
}
