//! Passes over GIFs: their frames are composed on a canvas, and held for a time of their own each.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use gif::{ColorOutput, DecodeOptions, Decoder, DecodingError, DisposalMethod, MemoryLimit};
use gradreel::{Error, ErrorKind, Result};

use super::area::{shrunk, within};
use super::blocks::check_frames;
use super::limits::{Budget, check_size, halvings_of};
use super::pictures::{Decoded, Undated};
use super::{Info, Kind, Pass, absent};
use crate::video::image::Image;

/// Delays of a hundredth of a second or less are treated as a tenth, as browsers do.
const SHORTEST: u16 = 2;

/// Unit of delays \[s\].
const UNIT: f64 = 0.01;

/// Maximum size of a frame \[bytes\].
const MOST_BYTES: u64 = 1 << 27;

/// Start times of the frames of a GIF in hundredths of a second, and the end of the last.
#[derive(Debug, Clone)]
pub(super) struct Delays {
    hundredths: Vec<u64>,
}

impl Delays {
    fn count(&self) -> usize {
        self.hundredths.len() - 1
    }
}

/// Reads the delays of a GIF. Of a truncated file, the complete frames count.
pub(super) fn open(path: &Path) -> Result<(Info, Kind)> {
    check_frames(path)?;
    let mut decoder = decoder(path, true)?;
    let size = (usize::from(decoder.width()), usize::from(decoder.height()));
    check_size(path, size)?;
    let mut hundredths = vec![0u64];
    let mut said = Vec::new();
    let mut budget = Budget::default();
    loop {
        // a frame counts if its data are complete
        match decoder.read_next_frame() {
            Ok(Some(frame)) => {
                let delay = if frame.delay < SHORTEST { 10 } else { frame.delay };
                budget.spend(path, size)?;
                hundredths.push(hundredths[hundredths.len() - 1] + u64::from(delay));
            }
            Ok(None) => break,
            Err(error) if hundredths.len() > 1 && is_end(&error) => {
                let count = hundredths.len() - 1;
                said.push(format!("the file is cut off, or lacks its last byte: it has {count} whole frames"));
                break;
            }
            Err(error) => return Err(broken(path, error)),
        }
    }
    let count = hundredths.len() - 1;
    if count == 0 {
        return Err(absent(path, 0, Some(0)));
    }
    // the first and the last frame may be held before and after the action
    let inner = if count > 2 { 1..count - 1 } else { 0..count - 1 };
    let span = UNIT * (hundredths[inner.end] - hundredths[inner.start]) as f64;
    let info = Info {
        size,
        stored: size,
        count: Some(count),
        rate: (span > 0.0).then(|| inner.len() as f64 / span),
        capture_rate: None,
        unit: UNIT,
        few_colours: true,
        focal: None,
        said,
    };
    Ok((info, Kind::Drawn(Delays { hundredths })))
}

/// The frames of a pass.
pub(super) fn pass(path: &Path, delays: &Delays, pass: Pass) -> Result<Decoded> {
    let decoder = decoder(path, false)?;
    let size = (usize::from(decoder.width()), usize::from(decoder.height()));
    check_size(path, size)?;
    // an oversized canvas is composed at a reduced resolution by skipping pixels
    let halvings = halvings_of(size);
    let (width, height) = ((size.0 >> halvings).max(1), (size.1 >> halvings).max(1));
    let canvas = Image { width, height, pixels: vec![[0; 4]; width * height], has_alpha: true };
    let canvas = Canvas { decoder, path: path.to_path_buf(), canvas, halvings, number: 0, budget: Budget::default() };
    let (delays, to) = (delays.clone(), within(size, pass.longer));
    let to = (to.0.min(width), to.1.min(height));
    let frames = (0..delays.count().min(pass.decoded())).scan(canvas, move |canvas, number| {
        let drawn = canvas.next(pass.wants(number));
        Some(drawn.map(|image| {
            image.map(|image| Undated {
                number,
                seconds: Some(UNIT * delays.hundredths[number] as f64),
                image: shrunk(image, to),
            })
        }))
    });
    Ok(Box::new(frames.filter_map(Result::transpose)))
}

/// A canvas on which frames are drawn one after the other.
struct Canvas {
    decoder: Decoder<BufReader<File>>,
    path: PathBuf,
    canvas: Image,
    halvings: u32,
    number: usize,
    budget: Budget,
}

impl Canvas {
    /// Draws the next frame; returns the canvas if it is wanted.
    fn next(&mut self, wanted: bool) -> Result<Option<Image>> {
        let number = self.number;
        self.number += 1;
        let size = (usize::from(self.decoder.width()), usize::from(self.decoder.height()));
        self.budget.spend(&self.path, size)?;
        let frame = match self.decoder.read_next_frame() {
            Ok(Some(frame)) => frame,
            // the delays of all complete frames are known
            Ok(None) => return Ok(None),
            Err(error) if number > 0 && is_end(&error) => return Ok(None),
            Err(error) => return Err(broken(&self.path, error)),
        };
        let Image { width, height, pixels, .. } = &mut self.canvas;
        let before = (frame.dispose == DisposalMethod::Previous).then(|| pixels.clone());
        let (left, top) = (usize::from(frame.left), usize::from(frame.top));
        let (across, down) = (usize::from(frame.width), usize::from(frame.height));
        let (halvings, step) = (self.halvings, (1 << self.halvings) - 1);
        let (width, height) = (*width, *height);
        let place = |x: usize, y: usize| {
            let (x, y) = (left + x, top + y);
            let painted = (x | y) & step == 0 && x >> halvings < width && y >> halvings < height;
            painted.then(|| (y >> halvings) * width + (x >> halvings))
        };
        for (i, pixel) in frame.buffer.chunks_exact(4).take(across * down).enumerate() {
            if let (Some(to), true) = (place(i % across, i / across), pixel[3] > 0) {
                pixels[to] = [pixel[0], pixel[1], pixel[2], pixel[3]];
            }
        }
        let dispose = frame.dispose;
        let drawn = wanted.then(|| self.canvas.clone());
        let pixels = &mut self.canvas.pixels;
        match (dispose, before) {
            (DisposalMethod::Background, _) => {
                (0..across * down).filter_map(|i| place(i % across, i / across)).for_each(|to| pixels[to] = [0; 4]);
            }
            (_, Some(before)) => *pixels = before,
            _ => {}
        }
        Ok(drawn)
    }
}

fn decoder(path: &Path, delays_only: bool) -> Result<Decoder<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io(path, "open the film", &e))?;
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    options.skip_frame_decoding(delays_only);
    options.set_memory_limit(MemoryLimit::Bytes(std::num::NonZeroU64::new(MOST_BYTES).expect("not 0")));
    options.read_info(BufReader::new(file)).map_err(|error| broken(path, error))
}

/// Whether the error is a premature end of file.
fn is_end(error: &DecodingError) -> bool {
    match error {
        DecodingError::UnexpectedEof => true,
        DecodingError::Io(error) => error.kind() == std::io::ErrorKind::UnexpectedEof,
        _ => false,
    }
}

fn broken(path: &Path, error: DecodingError) -> Error {
    Error::new(ErrorKind::Input, "cannot decode the GIF")
        .at(path.display())
        .found(error)
        .wanted("a complete GIF file")
        .fix("copy or export the film again")
}
