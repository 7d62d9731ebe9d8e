//! Reading the input picture from a file.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result, Tensor};

use super::prepare;
use crate::video::{Image, from_white};

/// Minimum estimated alpha of object pixels in a picture without an alpha channel.
const SURE: f32 = 0.5;

/// Reads a PNG or JPEG file and prepares it as `prepare` does: `[1, 3, size, size]` in −1..1, the object on white.
///
/// The object is given by the alpha channel, or else is everything that is not white.
///
/// # Errors
/// [`ErrorKind::Input`] if the file cannot be decoded, has no foreground, or has neither an alpha channel nor a
/// white background.
pub fn open_picture(path: impl AsRef<Path>, size: usize, crop: Option<usize>) -> Result<Tensor> {
    let path = path.as_ref();
    let mut image = Image::read_any(path)?;
    if !image.is_transparent_somewhere() {
        mask_white(&mut image).map_err(|e| e.at(path.display()))?;
    }
    if image.pixels.iter().all(|pixel| pixel[3] == 0) {
        return Err(Error::new(ErrorKind::Input, "the picture shows nothing")
            .at(path.display())
            .found("no pixel that belongs to an object")
            .wanted("an object whose mask is the alpha channel, or that stands on white")
            .fix("remove the background and export as PNG with transparency"));
    }
    prepare(image.pixels.as_flattened(), image.height, size, crop).map_err(|e| e.at(path.display()))
}

/// Makes the white background transparent.
fn mask_white(image: &mut Image) -> Result<()> {
    let (_, alpha) = from_white(image);
    let (width, height) = (image.width, image.height);
    let at_border = |i: &usize| {
        let (x, y) = (i % width, i / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let border: Vec<usize> = (0..width * height).filter(at_border).collect();
    let white = border.iter().filter(|i| alpha[**i] < SURE).count();
    if 2 * white < border.len() {
        return Err(Error::new(ErrorKind::Input, "the picture has a background")
            .found(format!("no transparency, and {} % of the border are white", 100 * white / border.len().max(1)))
            .wanted("the object alone, on transparent or on white")
            .fix("remove the background and export as PNG with transparency"));
    }
    for (pixel, alpha) in image.pixels.iter_mut().zip(alpha) {
        pixel[3] = if alpha < SURE { 0 } else { 255 };
    }
    Ok(())
}
