//! Decoded pictures of a film within a memory budget.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use rayon::prelude::*;

use super::Wanted;
use crate::video::image::Image;

/// Maximum number of pixels per stored picture; higher resolution adds no usable detail.
const MOST_OF_ONE: usize = 1 << 21;

/// Maximum number of pixels of all stored pictures. Segmentation needs some forty bytes per pixel.
const MOST_OF_ALL: usize = 1 << 25;

/// Maximum number of decoded pixels per film.
const MOST_DECODED: u64 = 1 << 33;

/// Maximum number of pixels of a picture in its file.
const MOST_IN_FILE: u64 = 64 << 20;

/// Minimum length of the longer side after shrinking \[pixels\].
const LEAST_SIDE: usize = 100;

/// The pictures of a film. If they become too many or too large, all are shrunk to half their sides.
#[derive(Default)]
pub(super) struct Pile {
    pub images: Vec<Image>,
    /// Width and height of the pictures in the file.
    pub size: (usize, usize),
    /// Number of times the sides were halved.
    pub halvings: u32,
    /// Number of times they were halved before being added.
    before: u32,
    decoded: u64,
}

/// Number of times the sides of a picture must be halved to fit the limit of one picture.
pub(super) fn halvings_of((width, height): (usize, usize)) -> u32 {
    (0..).find(|halvings| (width >> halvings) * (height >> halvings) <= MOST_OF_ONE).unwrap_or(0)
}

impl Pile {
    /// An empty pile for pictures of this size in the file that are halved this many times before being added.
    pub fn halved(size: (usize, usize), halvings: u32) -> Self {
        Self { size, halvings, before: halvings, ..Self::default() }
    }

    /// Adds a picture.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a picture whose size differs from the first, or if the pictures exceed the memory
    /// or time limit.
    pub fn add(&mut self, path: &Path, wanted: Wanted, image: Image) -> Result<()> {
        let size = (image.width, image.height);
        if self.images.is_empty() && self.before == 0 {
            self.size = size;
        }
        if (self.size.0 >> self.before, self.size.1 >> self.before) != size {
            return Err(Error::new(ErrorKind::Input, "the frames of the film differ in size")
                .at(path.display())
                .found(format!("{} × {} pixels in frame {}", size.0, size.1, wanted.first + self.images.len()))
                .wanted(format!("{} × {} pixels, like the first", self.size.0, self.size.1))
                .fix("export all frames at one size"));
        }
        check_size(path, size)?;
        self.count(path, size)?;
        let image = shrunk(image, self.halvings - self.before);
        self.images.push(image);
        while self.images[0].pixels.len() > MOST_OF_ONE || self.images[0].pixels.len() * self.images.len() > MOST_OF_ALL
        {
            if self.images[0].width.max(self.images[0].height) / 2 < LEAST_SIDE {
                return Err(too_large(path, size, self.images.len()));
            }
            self.images.par_iter_mut().for_each(|image| *image = halved(image));
            self.halvings += 1;
        }
        Ok(())
    }

    /// Counts a decoded picture, stored or not.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the decoding limit is exceeded.
    pub fn count(&mut self, path: &Path, (width, height): (usize, usize)) -> Result<()> {
        self.decoded += width as u64 * height as u64;
        let frames = (self.decoded / (width as u64 * height as u64).max(1)) as usize;
        if self.decoded > MOST_DECODED { Err(too_large(path, (width, height), frames)) } else { Ok(()) }
    }

    /// Messages about the sizes.
    pub fn said(&self) -> Option<String> {
        let (width, height) = self.images.first().map(|image| (image.width, image.height))?;
        let (whole_width, whole_height) = self.size;
        (self.halvings > 0).then(|| {
            format!("pictures of {whole_width} × {whole_height} pixels are shrunk to {width} × {height}, which fits into memory")
        })
    }
}

/// Checks the size given in a picture's header.
///
/// # Errors
/// [`ErrorKind::Input`] for a size that is zero or too large.
pub(super) fn check_size(path: &Path, (width, height): (usize, usize)) -> Result<()> {
    match width > 0 && height > 0 && (width as u64).saturating_mul(height as u64) <= MOST_IN_FILE {
        true => Ok(()),
        false => Err(too_large(path, (width, height), 1)),
    }
}

fn too_large(path: &Path, (width, height): (usize, usize), count: usize) -> Error {
    Error::new(ErrorKind::Input, "the film is too large")
        .at(path.display())
        .found(format!("{count} frames of {width} × {height} pixels"))
        .wanted(format!(
            "pictures of 1 to {} megapixels, and {} megapixels of all frames at {LEAST_SIDE} pixels along the longer side",
            MOST_IN_FILE >> 20,
            MOST_OF_ALL >> 20
        ))
        .fix("take fewer frames (--first-frame, --frames), or export the film smaller: 480 pixels are plenty")
}

/// A picture at half the width and height, each pixel the mean of four; an odd last column or row is dropped.
fn halved(image: &Image) -> Image {
    let mean = |four: [[u8; 4]; 4]| {
        let alpha: u32 = four.iter().map(|p| u32::from(p[3])).sum();
        // colour is weighted by alpha
        let colour = |c: usize| {
            let sum: u32 = four.iter().map(|p| u32::from(p[c]) * u32::from(p[3])).sum();
            (sum + alpha / 2).checked_div(alpha).unwrap_or(0) as u8
        };
        [colour(0), colour(1), colour(2), ((alpha + 2) / 4) as u8]
    };
    let [width, height] = [image.width, image.height].map(|side| (side / 2).max(1));
    let pixels = halved_with(&image.pixels, (image.width, image.height), mean);
    Image { width, height, pixels, has_alpha: image.has_alpha }
}

/// Pixels at half the width and height, each made from four.
pub(super) fn halved_with<T: Copy>(pixels: &[T], (width, height): (usize, usize), of: impl Fn([T; 4]) -> T) -> Vec<T> {
    let (columns, rows) = ((width / 2).max(1), (height / 2).max(1));
    let places = (0..rows).flat_map(|y| (0..columns).map(move |x| (2 * x, 2 * y)));
    let at = |x: usize, y: usize| pixels[y.min(height - 1) * width + x.min(width - 1)];
    places.map(|(x, y)| of([at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)])).collect()
}

/// A picture shrunk like the other pictures of its film.
pub(super) fn shrunk(image: Image, halvings: u32) -> Image {
    (0..halvings).fold(image, |image, _| halved(&image))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(width: usize, height: usize, colour: [u8; 4]) -> Image {
        Image { width, height, pixels: vec![colour; width * height], has_alpha: true }
    }

    #[test]
    fn transparent_pixels_lend_no_colour() {
        let mut image = plain(5, 3, [0, 0, 0, 0]);
        image.pixels[0] = [200, 100, 50, 255];
        image.pixels[1] = [100, 100, 50, 255];
        let half = halved(&image);
        assert_eq!((half.width, half.height, half.pixels.len()), (2, 1, 2));
        assert_eq!(half.pixels, [[150, 100, 50, 128], [0; 4]]);
        let line = halved(&plain(9, 1, [7, 8, 9, 255]));
        assert_eq!((line.width, line.height, line.pixels[3]), (4, 1, [7, 8, 9, 255]));
    }

    #[test]
    fn large_pictures_are_shrunk_and_huge_films_refused() {
        let wanted = Wanted { first: 0, count: usize::MAX };
        let mut pile = Pile::default();
        pile.add("film".as_ref(), wanted, plain(4000, 3000, [9, 9, 9, 255])).unwrap();
        assert_eq!((pile.images[0].width, pile.images[0].height, pile.halvings), (1000, 750, 2));
        assert!(pile.said().unwrap().contains("4000 × 3000"));
        // all later ones shrink alike, and all shrink further when there are many
        for _ in 0..48 {
            pile.add("film".as_ref(), wanted, plain(4000, 3000, [9, 9, 9, 255])).unwrap();
        }
        assert!(pile.halvings == 3 && pile.images.iter().all(|image| image.width == 500), "{}", pile.halvings);
        let other = pile.add("film".as_ref(), wanted, plain(400, 300, [9; 4])).unwrap_err().to_string();
        assert!(other.contains("differ in size") && other.contains("frame 49"), "{other}");
        for size in [(9000, 9000), (0, 4), (usize::MAX, 2)] {
            assert!(check_size("film".as_ref(), size).unwrap_err().to_string().contains("too large"));
        }
        // too long: nothing would remain of its pictures
        let mut pile = Pile { decoded: MOST_DECODED, ..Pile::default() };
        assert!(
            pile.add("film".as_ref(), wanted, plain(200, 200, [9; 4])).unwrap_err().to_string().contains("too large")
        );
    }
}
