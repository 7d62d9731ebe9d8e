//! Sizes of pictures that are read.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Maximum number of pixels of a picture in memory; a larger canvas is decoded at a lower resolution.
const MOST_OF_ONE: usize = 1 << 21;

/// Maximum number of pixels of a picture in its file.
const MOST_IN_FILE: u64 = 64 << 20;

/// Number of times the sides of a picture must be halved to fit the limit of one picture.
pub(super) fn halvings_of((width, height): (usize, usize)) -> u32 {
    (0..).find(|halvings| (width >> halvings) * (height >> halvings) <= MOST_OF_ONE).unwrap_or(0)
}

/// Checks the size given in a picture's header.
///
/// # Errors
/// [`ErrorKind::Input`] for a size that is zero or too large.
pub(super) fn check_size(path: &Path, (width, height): (usize, usize)) -> Result<()> {
    if width > 0 && height > 0 && (width as u64).saturating_mul(height as u64) <= MOST_IN_FILE {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the film is too large")
        .at(path.display())
        .found(format!("frames of {width} × {height} pixels"))
        .wanted(format!("frames of 1 to {} megapixels", MOST_IN_FILE >> 20))
        .fix("export the film smaller: 640 pixels along the longer side are plenty"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn huge_pictures_are_refused() {
        for size in [(9000, 9000), (0, 4), (usize::MAX, 2)] {
            assert!(check_size("film".as_ref(), size).unwrap_err().to_string().contains("too large"));
        }
        assert!(check_size("film".as_ref(), (7680, 4320)).is_ok());
        assert_eq!((halvings_of((1920, 1080)), halvings_of((4000, 3000))), (0, 2));
    }
}
