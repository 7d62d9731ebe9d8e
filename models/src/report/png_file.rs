//! PNG: one picture as it is, without loss.

use gradreel::{Error, ErrorKind, Result};

use super::animation::Picture;

/// The bytes of a picture as an 8-bit sRGB PNG.
///
/// # Errors
///
/// The picture has no pixels, or more than PNG allows.
///
/// # Panics
///
/// `rgb` is not `width · height · 3` long.
#[track_caller]
pub fn png(picture: &Picture) -> Result<Vec<u8>> {
    picture.check();
    let refused = |found: String| {
        Error::new(ErrorKind::Input, "cannot write a picture as PNG")
            .at(format!("a picture of {} × {} pixels", picture.width, picture.height))
            .found(found)
    };
    let side = |length: usize| u32::try_from(length).map_err(|_| refused("a side of more than 2³² pixels".into()));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side(picture.width)?, side(picture.height)?);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|e| refused(e.to_string()))?;
    writer.write_image_data(&picture.rgb).map_err(|e| refused(e.to_string()))?;
    writer.finish().map_err(|e| refused(e.to_string()))?;
    Ok(bytes)
}
