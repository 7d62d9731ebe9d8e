//! PNG encoding of pictures.

use gradreel::{Error, ErrorKind, Result};

use super::animation::Picture;

/// Encodes a picture as 8-bit sRGB PNG.
///
/// # Errors
///
/// If the picture has no pixels, or more than PNG allows.
///
/// # Panics
///
/// If `rgb` does not have the length `width · height · 3`.
#[track_caller]
pub fn png(picture: &Picture) -> Result<Vec<u8>> {
    picture.check();
    encoded(picture.width, picture.height, png::ColorType::Rgb, &picture.rgb)
}

/// Encodes a PNG with alpha from `width · height · 4` bytes of sRGB and coverage (straight alpha).
///
/// # Errors
///
/// As [`png()`], and for a wrong number of bytes.
pub fn png_with_alpha(width: usize, height: usize, rgba: &[u8]) -> Result<Vec<u8>> {
    encoded(width, height, png::ColorType::Rgba, rgba)
}

fn encoded(width: usize, height: usize, kind: png::ColorType, pixels: &[u8]) -> Result<Vec<u8>> {
    let refused = |found: String| {
        Error::new(ErrorKind::Input, "cannot write a picture as PNG")
            .at(format!("a picture of {width} × {height} pixels"))
            .found(found)
    };
    let side = |length: usize| u32::try_from(length).map_err(|_| refused("a side of more than 2³² pixels".into()));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side(width)?, side(height)?);
    encoder.set_color(kind);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|e| refused(e.to_string()))?;
    writer.write_image_data(pixels).map_err(|e| refused(e.to_string()))?;
    writer.finish().map_err(|e| refused(e.to_string()))?;
    Ok(bytes)
}
