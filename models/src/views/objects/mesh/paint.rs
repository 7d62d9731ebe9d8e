//! Textures of surfaces.

use std::sync::Arc;

use gradreel::Result;

use crate::video::Image;

/// Maximum side of a stored picture \[pixels\]. Objects cover at most a few hundred pixels: a finer picture would
/// only cause aliasing.
const SIDE: usize = 1024;

/// Surface appearance besides the vertex colours.
#[derive(Default)]
pub(super) struct Paint {
    pub picture: Option<Arc<Picture>>,
    /// Minimum opacity of visible points; 0 makes all of them visible.
    pub cutoff: f32,
    /// Wrapping of the picture, horizontally and vertically.
    pub ends: [Ends; 2],
}

/// Wrapping mode beyond the edge of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum Ends {
    /// Repeat.
    #[default]
    Repeat,
    /// Repeat, every other time mirrored.
    Mirror,
    /// Clamp to the edge pixels.
    Clamp,
}

/// An image with alpha, row by row from the upper left corner.
pub(super) struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 4]>,
}

impl Paint {
    pub fn bytes(&self) -> usize {
        self.picture.as_ref().map_or(0, |picture| size_of_val(&*picture.pixels))
    }

    /// Whether the surface is visible at this point.
    pub fn covers(&self, uv: [f64; 2]) -> bool {
        self.cutoff <= 0.0 || self.at(uv)[3] >= f64::from(self.cutoff)
    }

    /// Red, green and blue of the picture, 0 to 1; white without one.
    pub fn colour(&self, uv: [f64; 2]) -> [f64; 3] {
        let [red, green, blue, _] = self.at(uv);
        [red, green, blue]
    }

    /// Bilinear interpolation between pixel centres.
    fn at(&self, uv: [f64; 2]) -> [f64; 4] {
        let Some(picture) = &self.picture else { return [1.0; 4] };
        let sizes = [picture.width, picture.height];
        let places: [f64; 2] = std::array::from_fn(|axis| uv[axis] * sizes[axis] as f64 - 0.5);
        let pixel = |x: f64, y: f64| {
            let (column, row) = (self.ends[0].pixel(x, sizes[0]), self.ends[1].pixel(y, sizes[1]));
            picture.pixels[row * picture.width + column].map(|byte| f64::from(byte) / 255.0)
        };
        let [x, y] = places.map(f64::floor);
        let [right, down] = [places[0] - x, places[1] - y];
        let [upper, lower] = [y, y + 1.0].map(|y| mixed(pixel(x, y), pixel(x + 1.0, y), right));
        mixed(upper, lower, down)
    }
}

impl Ends {
    /// The pixel at any integer coordinate.
    fn pixel(self, place: f64, size: usize) -> usize {
        let last = (size - 1) as f64;
        let inside = match self {
            Self::Repeat => place.rem_euclid(size as f64),
            Self::Clamp => place,
            Self::Mirror => {
                let place = place.rem_euclid(2.0 * size as f64);
                if place > last { 2.0 * size as f64 - 1.0 - place } else { place }
            }
        };
        inside.clamp(0.0, last) as usize
    }
}

impl Picture {
    /// Decodes a PNG or JPEG file; `name` identifies it in errors.
    pub fn decode(bytes: &[u8], name: &str) -> Result<Self> {
        let Image { width, height, pixels, .. } = Image::decode(bytes, name.as_ref())?;
        let mut picture = Self { width, height, pixels };
        while picture.width.max(picture.height) > SIDE {
            picture = picture.halved();
        }
        Ok(picture)
    }

    /// At half the width and height, each pixel the mean of four.
    fn halved(&self) -> Self {
        let [width, height] = [self.width, self.height].map(|side| side.div_ceil(2));
        let at =
            |column: usize, row: usize| self.pixels[row.min(self.height - 1) * self.width + column.min(self.width - 1)];
        let mean = |i: usize| {
            let (column, row) = (2 * (i % width), 2 * (i / width));
            let four = [at(column, row), at(column + 1, row), at(column, row + 1), at(column + 1, row + 1)];
            std::array::from_fn(|c| (four.iter().map(|pixel| u32::from(pixel[c])).sum::<u32>() / 4) as u8)
        };
        Self { width, height, pixels: (0..width * height).map(mean).collect() }
    }
}

fn mixed(a: [f64; 4], b: [f64; 4], share: f64) -> [f64; 4] {
    std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
}
