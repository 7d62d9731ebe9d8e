//! The blocks of a GIF, looked at before they are decoded: a decoder reserves memory for the frame that a header claims.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use gradreel::{Error, Result};

use super::limits::check_size;

/// Bits of the flags of a screen or a frame: whether a table of colours follows, and the logarithm of its length less one.
const HAS_TABLE: u8 = 0x80;
const LENGTH: u8 = 7;

/// Checks the sizes that the frames of a GIF claim. What is none, or ends early, is left to the decoder.
///
/// # Errors
/// [`ErrorKind::Input`](gradreel::ErrorKind::Input) for a frame that is too large.
pub(super) fn check_frames(path: &Path) -> Result<()> {
    let file = File::open(path).map_err(|e| Error::io(path, "open the film", &e))?;
    let mut sizes = Ok(());
    let frame = |size| {
        sizes = check_size(path, size);
        sizes.is_ok()
    };
    // the end of the file ends it as well
    let _ = walk(&mut BufReader::new(file), frame);
    sizes
}

/// Calls `frame` with the width and the height of each frame, as long as it returns true and blocks are those of a GIF.
fn walk(input: &mut impl Read, mut frame: impl FnMut((usize, usize)) -> bool) -> io::Result<()> {
    let [.., flags, _, _] = bytes::<13>(input)?;
    skip_table(input, flags)?;
    loop {
        match bytes::<1>(input)? {
            [b','] => {
                let [_, _, _, _, w0, w1, h0, h1, flags] = bytes(input)?;
                let [width, height] = [[w0, w1], [h0, h1]].map(|side| usize::from(u16::from_le_bytes(side)));
                if !frame((width, height)) {
                    return Ok(());
                }
                skip_table(input, flags)?;
                let [_least_code_size] = bytes(input)?;
                skip_data(input)?;
            }
            [b'!'] => {
                let [_label] = bytes(input)?;
                skip_data(input)?;
            }
            _ => return Ok(()),
        }
    }
}

fn bytes<const N: usize>(input: &mut impl Read) -> io::Result<[u8; N]> {
    let mut found = [0; N];
    input.read_exact(&mut found)?;
    Ok(found)
}

fn skip(input: &mut impl Read, count: u64) -> io::Result<()> {
    io::copy(&mut input.by_ref().take(count), &mut io::sink()).map(drop)
}

fn skip_table(input: &mut impl Read, flags: u8) -> io::Result<()> {
    if flags & HAS_TABLE == 0 { Ok(()) } else { skip(input, 3 << (1 + (flags & LENGTH))) }
}

/// Skips blocks, each of which begins with its length, up to an empty one.
fn skip_data(input: &mut impl Read) -> io::Result<()> {
    while let [length @ 1..=u8::MAX] = bytes::<1>(input)? {
        skip(input, u64::from(length))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use gif::{Encoder, Frame};

    use super::*;

    /// A GIF of these frames, each with a table of its own colours.
    fn gif(sizes: &[(u16, u16)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 9, 7, &[0, 0, 0, 9, 9, 9]).unwrap();
        for (width, height) in sizes {
            let mut pixels = [200, 30, 20].repeat(usize::from(*width) * usize::from(*height));
            pixels[0] = 10;
            encoder.write_frame(&Frame::from_rgb(*width, *height, &pixels)).unwrap();
        }
        drop(encoder);
        bytes
    }

    #[test]
    fn every_frame_is_seen() {
        let file = gif(&[(9, 7), (4, 5), (1, 1)]);
        let mut sizes = vec![];
        walk(&mut &file[..], |size| {
            sizes.push(size);
            true
        })
        .unwrap();
        assert_eq!(sizes, [(9, 7), (4, 5), (1, 1)]);
        assert!(walk(&mut &file[..file.len() - 5], |_| true).is_err());
    }

    #[test]
    fn a_claim_that_is_too_large_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.gif");
        let mut file = gif(&[(9, 7), (4, 5)]);
        std::fs::write(&path, &file).unwrap();
        check_frames(&path).unwrap();
        let at = file.windows(9).position(|part| part[..] == [b',', 0, 0, 0, 0, 4, 0, 5, 0]).unwrap();
        file[at + 5..at + 9].fill(0xff);
        std::fs::write(&path, &file).unwrap();
        let told = check_frames(&path).unwrap_err().to_string();
        assert!(told.contains("65535 × 65535") && told.contains("too large"), "{told}");
    }
}
