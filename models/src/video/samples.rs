//! Samples of a PNG or JPEG file at their stored depth: 16 bits stay 16 bits.

use std::io::{BufRead, Cursor, Seek};
use std::path::Path;

use gradreel::Result;

use super::image::{self, Image};
use super::orientation::Orientation;
use crate::text;

/// A pixel of any image type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// Red, green and blue; grey is repeated in all three.
    pub colour: [u16; 3],
    /// Coverage, 0 to 255.
    pub alpha: u8,
}

/// An image, row by row, in display orientation.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<Sample>,
    /// Maximum sample value of the file: 255 or 65535.
    pub most: u16,
    /// Whether the colours come from a non-grey palette and hence are labels, not brightness.
    pub labels: bool,
}

impl Samples {
    /// Decodes a PNG or JPEG file.
    ///
    /// # Errors
    /// As [`Image::read_any`].
    pub fn read(path: &Path) -> Result<Self> {
        match image::starts_as_jpeg(path)? {
            true => Ok(Self::of(&Image::read_any(path)?)),
            false => Self::decode(&text::bytes(path, "the mask", "copy or export it again", image::MAX_BYTES)?, path),
        }
    }

    /// Decodes a PNG or JPEG file in memory; `name` identifies it in errors.
    pub fn decode(bytes: &[u8], name: &Path) -> Result<Self> {
        if !bytes.starts_with(b"\x89PNG") {
            return Ok(Self::of(&Image::decode(bytes, name)?));
        }
        let reader = image::opened_as(png::Transformations::EXPAND, Cursor::new(bytes), name)?;
        Self::of_png(reader, name)
    }

    fn of(image: &Image) -> Self {
        let sample = |&[r, g, b, alpha]: &[u8; 4]| Sample { colour: [r, g, b].map(u16::from), alpha };
        let pixels = image.pixels.iter().map(sample).collect();
        Self { width: image.width, height: image.height, pixels, most: 255, labels: false }
    }

    fn of_png<R: BufRead + Seek>(mut reader: png::Reader<R>, name: &Path) -> Result<Self> {
        let size = reader.output_buffer_size().ok_or_else(|| image::too_large(name, reader.info().size()))?;
        let palette = reader.info().palette.as_deref().filter(|_| reader.info().color_type == png::ColorType::Indexed);
        let labels = palette.is_some_and(|palette| palette.chunks_exact(3).any(|c| c[0] != c[1] || c[1] != c[2]));
        let mut bytes = vec![0; size];
        let info = reader.next_frame(&mut bytes).map_err(|e| image::broken(name, &e))?;
        let bytes = &bytes[..info.buffer_size()];
        let wide = info.bit_depth == png::BitDepth::Sixteen;
        let value = |k: usize| match wide {
            true => u16::from_be_bytes([bytes[2 * k], bytes[2 * k + 1]]),
            false => u16::from(bytes[k]),
        };
        let alpha = |k: usize| if wide { bytes[2 * k] } else { bytes[k] };
        let channels = info.color_type.samples();
        let sample = |i: usize| {
            let k = i * channels;
            match channels {
                1 => Sample { colour: [value(k); 3], alpha: 255 },
                2 => Sample { colour: [value(k); 3], alpha: alpha(k + 1) },
                3 => Sample { colour: [value(k), value(k + 1), value(k + 2)], alpha: 255 },
                _ => Sample { colour: [value(k), value(k + 1), value(k + 2)], alpha: alpha(k + 3) },
            }
        };
        let (width, height) = (info.width as usize, info.height as usize);
        let pixels = (0..width * height).map(sample).collect();
        let orientation = Orientation::of(reader.info().exif_metadata.as_deref());
        let (width, height, pixels) = orientation.turned_pixels((width, height), pixels);
        Ok(Self { width, height, pixels, most: if wide { u16::MAX } else { 255 }, labels })
    }
}
