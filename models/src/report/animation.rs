//! Pictures and animations, for comparing input and reconstruction.

use gif::{Encoder, Frame, Repeat};
use gradreel::{Error, ErrorKind, Result};

use super::palette::Palette;

/// Fill value of empty areas in a composition.
const WHITE: u8 = 255;

/// Minimum delay that browsers honour, in hundredths of a second.
const SHORTEST_DELAY: f64 = 2.0;

/// An 8-bit sRGB picture; rows from the top, three bytes per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height · width · 3` bytes.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture from sRGB values `[height, width, 3]`; 0…1 is mapped to 0…255, and values outside are clipped.
    ///
    /// # Errors
    ///
    /// If a value is NaN or infinite; the error names the pixel.
    ///
    /// # Panics
    ///
    /// If `values` does not have the length `width · height · 3`.
    #[track_caller]
    pub fn from_unit(width: usize, height: usize, values: &[f32]) -> Result<Self> {
        assert_eq!(values.len(), width * height * 3, "Picture::from_unit: wrong length for {width} × {height} × 3");
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            let pixel = at / 3;
            return Err(Error::new(ErrorKind::NonFinite, "a picture has a pixel without a colour")
                .at(format!("row {}, column {}, channel {}", pixel / width, pixel % width, at % 3))
                .found(values[at])
                .wanted("a finite value"));
        }
        let rgb = values.iter().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        Ok(Self { width, height, rgb })
    }

    /// This picture with `other` to its right; the lower one is padded with white at the bottom.
    ///
    /// # Panics
    ///
    /// If `rgb` of a picture does not match its size.
    #[must_use]
    #[track_caller]
    pub fn beside(&self, other: &Self) -> Self {
        let mut both = Self::white(self.width + other.width, self.height.max(other.height));
        both.paste(self, 0, 0);
        both.paste(other, self.width, 0);
        both
    }

    /// Arranges pictures row by row in `columns` columns. Cells have the size of the largest picture and are padded
    /// with white.
    ///
    /// # Panics
    ///
    /// If `columns` is zero, or `rgb` of a picture does not match its size.
    #[must_use]
    #[track_caller]
    pub fn grid(columns: usize, pictures: &[Self]) -> Self {
        assert!(columns > 0, "Picture::grid: no columns");
        let width = pictures.iter().map(|picture| picture.width).max().unwrap_or(0);
        let height = pictures.iter().map(|picture| picture.height).max().unwrap_or(0);
        let columns = columns.min(pictures.len()).max(1);
        let mut whole = Self::white(columns * width, pictures.len().div_ceil(columns) * height);
        for (index, picture) in pictures.iter().enumerate() {
            whole.paste(picture, index % columns * width, index / columns * height);
        }
        whole
    }

    #[track_caller]
    pub(super) fn check(&self) {
        let Self { width, height, rgb } = self;
        assert_eq!(rgb.len(), width * height * 3, "Picture: {} bytes for {width} × {height} × 3", rgb.len());
    }

    fn white(width: usize, height: usize) -> Self {
        Self { width, height, rgb: vec![WHITE; width * height * 3] }
    }

    #[track_caller]
    fn paste(&mut self, picture: &Self, left: usize, top: usize) {
        picture.check();
        let bytes = picture.width * 3;
        for row in 0..picture.height {
            let start = ((top + row) * self.width + left) * 3;
            self.rgb[start..start + bytes].copy_from_slice(&picture.rgb[row * bytes..][..bytes]);
        }
    }

    fn pixels(&self) -> &[[u8; 3]] {
        self.rgb.as_chunks().0
    }
}

/// Encodes an endlessly looping GIF.
///
/// All frames share one palette of 256 colours, so that static areas do not flicker. GIF delays are in hundredths
/// of a second: they are rounded such that every frame is within half a hundredth of its time. Above 50 frames per
/// second the animation is slowed down, as browsers do not honour shorter delays.
///
/// # Errors
///
/// If there is no frame, a frame is empty, larger than 65535 pixels or of a different size than the first, or the
/// speed is not a positive number.
///
/// # Panics
///
/// If `rgb` of a frame does not match its size.
#[track_caller]
pub fn gif(frames: &[Picture], frames_per_second: f64) -> Result<Vec<u8>> {
    let refused = |found: String| Error::new(ErrorKind::Input, "cannot make an animation").found(found);
    let Some(first) = frames.first() else {
        return Err(refused("no frames".into()).wanted("at least one frame"));
    };
    let delays = delays(frames.len(), frames_per_second)?;
    for (index, frame) in frames.iter().enumerate() {
        frame.check();
        if (frame.width, frame.height) != (first.width, first.height) {
            return Err(refused(format!("{} × {} pixels", frame.width, frame.height))
                .at(format!("frame {index}"))
                .wanted(format!("{} × {} pixels, as in frame 0", first.width, first.height)));
        }
    }
    let (Ok(width @ 1..), Ok(height @ 1..)) = (u16::try_from(first.width), u16::try_from(first.height)) else {
        return Err(refused(format!("frames of {} × {} pixels", first.width, first.height))
            .wanted("sides of 1 to 65535 pixels"));
    };

    let mut palette = Palette::of(frames.iter().flat_map(Picture::pixels));
    let failed = |e: gif::EncodingError| refused(e.to_string());
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height, &palette.bytes()).map_err(failed)?;
    encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
    for (frame, delay) in frames.iter().zip(delays) {
        let indices: Vec<u8> = frame.pixels().iter().map(|&colour| palette.index(colour)).collect();
        let frame = Frame { width, height, delay, buffer: indices.into(), ..Frame::default() };
        encoder.write_frame(&frame).map_err(failed)?;
    }
    drop(encoder);
    Ok(bytes)
}

/// Delay of each frame, in hundredths of a second.
fn delays(count: usize, frames_per_second: f64) -> Result<Vec<u16>> {
    let step = (100.0 / frames_per_second).max(SHORTEST_DELAY);
    if !(frames_per_second > 0.0 && frames_per_second.is_finite() && step <= f64::from(u16::MAX)) {
        return Err(Error::new(ErrorKind::Input, "an animation has no usable speed")
            .found(format!("{frames_per_second} frames per second"))
            .wanted("a finite speed above 0.0016 frames per second"));
    }
    Ok((0..count).map(|i| ((i + 1) as f64 * step).round() - (i as f64 * step).round()).map(|d| d as u16).collect())
}
