//! Limits of what is decoded.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Maximum number of pixels that one pass decodes: more than two hours of 1080p at 60 pictures a second. A file
/// that claims to be longer is not read to its end.
const MOST_DECODED: u64 = 1 << 40;

/// Maximum number of pixels of a picture in its file.
const MOST_IN_FILE: u64 = 64 << 20;

/// Maximum number of pixels of a canvas on which frames are composed.
const MOST_OF_CANVAS: usize = 1 << 21;

/// Counts decoded pixels up to [`MOST_DECODED`].
#[derive(Default)]
pub(super) struct Budget(u64);

impl Budget {
    /// Counts a picture of this size.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the film is too long.
    pub fn spend(&mut self, path: &Path, (width, height): (usize, usize)) -> Result<()> {
        self.0 = self.0.saturating_add(width as u64 * height as u64);
        if self.0 <= MOST_DECODED {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the film is too long")
            .at(path.display())
            .found(format!("more than {} megapixels in all frames", MOST_DECODED >> 20))
            .fix("cut it to the fall, or take fewer frames (--first-frame, --frames)"))
    }
}

/// Checks the size given in a picture's header.
///
/// # Errors
/// [`ErrorKind::Input`] for a size that is zero or too large.
pub(in crate::video::film) fn check_size(path: &Path, (width, height): (usize, usize)) -> Result<()> {
    if width > 0 && height > 0 && (width as u64).saturating_mul(height as u64) <= MOST_IN_FILE {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the film is too large")
        .at(path.display())
        .found(format!("frames of {width} × {height} pixels"))
        .wanted(format!("pictures of 1 to {} megapixels", MOST_IN_FILE >> 20))
        .fix("export the film smaller: 1920 pixels along the longer side are plenty"))
}

/// Number of times the sides of a canvas must be halved to fit its limit.
pub(super) fn halvings_of((width, height): (usize, usize)) -> u32 {
    (0..).find(|halvings| (width >> halvings) * (height >> halvings) <= MOST_OF_CANVAS).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_much_is_refused() {
        for size in [(9000, 9000), (0, 4), (usize::MAX, 2)] {
            assert!(check_size("film".as_ref(), size).unwrap_err().to_string().contains("too large"));
        }
        check_size("film".as_ref(), (7680, 4320)).unwrap();
        let mut budget = Budget(MOST_DECODED - 1);
        budget.spend("film".as_ref(), (1, 1)).unwrap();
        assert!(budget.spend("film".as_ref(), (1, 1)).unwrap_err().to_string().contains("too long"));
        assert_eq!([(1024, 768), (4000, 3000)].map(halvings_of), [0, 2]);
    }
}
