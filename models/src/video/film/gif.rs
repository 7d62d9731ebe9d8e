//! GIF files, their frames put together.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use gif::{ColorOutput, DecodeOptions, DisposalMethod, MemoryLimit};
use gradreel::{Error, ErrorKind, Result};

use super::{Decoded, MOST_BYTES, Wanted, check_bytes};
use crate::video::image::Image;

/// A delay of a hundredth of a second or less is shown as a tenth, as browsers do.
const SHORTEST: u32 = 2;

/// Decodes the wanted frames; the rate is the mean over the whole file.
pub(super) fn read(path: &Path, wanted: Wanted) -> Result<Decoded> {
    let broken = |e: gif::DecodingError| {
        Error::new(ErrorKind::Input, "cannot decode the GIF")
            .at(path.display())
            .found(e)
            .wanted("a complete GIF file")
            .fix("copy or export the film again")
    };
    let file = File::open(path).map_err(|e| Error::io(path, "open the film", &e))?;
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    options.set_memory_limit(MemoryLimit::Bytes(std::num::NonZeroU64::new(MOST_BYTES as u64).expect("not 0")));
    let mut decoder = options.read_info(BufReader::new(file)).map_err(broken)?;
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    check_bytes(path, width, height, 1)?;
    let mut canvas = vec![[0u8; 4]; width * height];
    let mut images = Vec::new();
    let (mut count, mut hundredths) = (0usize, 0u64);
    while let Some(frame) = decoder.read_next_frame().map_err(broken)? {
        let delay = u32::from(frame.delay);
        hundredths += u64::from(if delay < SHORTEST { 10 } else { delay });
        let before = (frame.dispose == DisposalMethod::Previous).then(|| canvas.clone());
        let (left, top) = (usize::from(frame.left), usize::from(frame.top));
        let (across, down) = (usize::from(frame.width), usize::from(frame.height));
        let place = |x: usize, y: usize| (left + x < width && top + y < height).then(|| (top + y) * width + left + x);
        for (i, pixel) in frame.buffer.chunks_exact(4).take(across * down).enumerate() {
            if let (Some(to), true) = (place(i % across, i / across), pixel[3] > 0) {
                canvas[to] = [pixel[0], pixel[1], pixel[2], pixel[3]];
            }
        }
        if count >= wanted.first && images.len() < wanted.count {
            check_bytes(path, width, height, images.len() + 1)?;
            images.push(Image { width, height, pixels: canvas.clone(), has_alpha: true });
        }
        match (frame.dispose, before) {
            (DisposalMethod::Background, _) => {
                (0..across * down).filter_map(|i| place(i % across, i / across)).for_each(|to| canvas[to] = [0; 4]);
            }
            (_, Some(before)) => canvas = before,
            _ => {}
        }
        count += 1;
    }
    let frames_per_s = (count > 0).then(|| 100.0 * count as f64 / hundredths as f64);
    Ok(Decoded { images, frames_per_s, few_colours: true })
}
