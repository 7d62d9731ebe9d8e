//! GIF decoding and frame composition.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use gif::{ColorOutput, DecodeOptions, DecodingError, DisposalMethod, MemoryLimit};
use gradreel::{Error, ErrorKind, Result};

use super::pile::{Pile, check_size, halvings_of};
use super::{Clock, Decoded, Wanted};
use crate::video::image::Image;

/// Delays of a hundredth of a second or less are treated as a tenth, as browsers do.
const SHORTEST: u32 = 2;

/// Unit of delays \[s\].
const UNIT: f64 = 0.01;

/// Maximum size of a frame \[bytes\].
const MOST_BYTES: u64 = 1 << 29;

/// Decodes the wanted frames with their display times. A truncated file yields its complete frames.
pub(super) fn read(path: &Path, wanted: Wanted) -> Result<Decoded> {
    let broken = |e: DecodingError| {
        Error::new(ErrorKind::Input, "cannot decode the GIF")
            .at(path.display())
            .found(e)
            .wanted("a complete GIF file")
            .fix("copy or export the film again")
    };
    let file = File::open(path).map_err(|e| Error::io(path, "open the film", &e))?;
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    options.set_memory_limit(MemoryLimit::Bytes(std::num::NonZeroU64::new(MOST_BYTES).expect("not 0")));
    let mut decoder = options.read_info(BufReader::new(file)).map_err(broken)?;
    let size = (usize::from(decoder.width()), usize::from(decoder.height()));
    check_size(path, size)?;
    // an oversized canvas is decoded at a reduced resolution by skipping pixels
    let halvings = halvings_of(size);
    let (width, height) = (size.0 >> halvings, size.1 >> halvings);
    let mut canvas = vec![[0u8; 4]; width * height];
    let mut pile = Pile::halved(size, halvings);
    let (mut count, mut hundredths) = (0usize, 0u64);
    let mut shown = Vec::new();
    let mut said = Vec::new();
    while pile.images.len() < wanted.count {
        let frame = match decoder.read_next_frame() {
            Ok(Some(frame)) => frame,
            Ok(None) => break,
            Err(error) if count > 0 && is_end(&error) => {
                said.push(format!("the file is cut off, or lacks its last byte: it has {count} whole frames"));
                break;
            }
            Err(error) => return Err(broken(error)),
        };
        let before = (frame.dispose == DisposalMethod::Previous).then(|| canvas.clone());
        let (left, top) = (usize::from(frame.left), usize::from(frame.top));
        let (across, down) = (usize::from(frame.width), usize::from(frame.height));
        let step = (1 << halvings) - 1;
        let place = |x: usize, y: usize| {
            let (x, y) = (left + x, top + y);
            let painted = (x | y) & step == 0 && x >> halvings < width && y >> halvings < height;
            painted.then(|| (y >> halvings) * width + (x >> halvings))
        };
        for (i, pixel) in frame.buffer.chunks_exact(4).take(across * down).enumerate() {
            if let (Some(to), true) = (place(i % across, i / across), pixel[3] > 0) {
                canvas[to] = [pixel[0], pixel[1], pixel[2], pixel[3]];
            }
        }
        if count >= wanted.first {
            shown.push(UNIT * hundredths as f64);
            pile.add(path, wanted, Image { width, height, pixels: canvas.clone(), has_alpha: true })?;
        } else {
            pile.count(path, (width, height))?;
        }
        let delay = u32::from(frame.delay);
        hundredths += u64::from(if delay < SHORTEST { 10 } else { delay });
        match (frame.dispose, before) {
            (DisposalMethod::Background, _) => {
                (0..across * down).filter_map(|i| place(i % across, i / across)).for_each(|to| canvas[to] = [0; 4]);
            }
            (_, Some(before)) => canvas = before,
            _ => {}
        }
        count += 1;
    }
    // downscaling adds colours
    let few_colours = pile.halvings == halvings;
    let decoded = Decoded::of(pile);
    said.extend_from_slice(&decoded.said);
    Ok(Decoded {
        clock: Some(Clock { shown, until: Some(UNIT * hundredths as f64), unit: UNIT }),
        few_colours,
        said,
        ..decoded
    })
}

/// Whether the error is a premature end of file.
fn is_end(error: &DecodingError) -> bool {
    match error {
        DecodingError::UnexpectedEof => true,
        DecodingError::Io(error) => error.kind() == std::io::ErrorKind::UnexpectedEof,
        _ => false,
    }
}
