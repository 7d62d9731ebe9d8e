//! Common parts of the mesh readers: files, text, and the Wavefront format, used for both solids and textured objects.

pub(crate) mod obj;
pub(crate) mod text;
pub(crate) mod wavefront;

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Largest size of a mesh, a particle file or a file that a mesh refers to \[bytes\].
pub(crate) const LARGEST: u64 = 256 << 20;

/// Reads a regular file of at most [`LARGEST`] bytes, whatever length the system reports. In errors, `what` names the
/// contents and `fix` is the advice on which file is meant.
///
/// # Errors
/// [`ErrorKind::Input`] for a file that does not exist, is a folder, a device or a pipe, or is too large.
pub(crate) fn read(path: &Path, what: &str, fix: &str) -> Result<Vec<u8>> {
    // Reading a pipe would block.
    if path.metadata().is_ok_and(|kind| !kind.is_file() && !kind.is_dir()) {
        return Err(Error::new(ErrorKind::Input, format!("cannot read {what}"))
            .at(path.display())
            .found("something that is no file, as a device or a pipe")
            .wanted("a file")
            .fix(fix));
    }
    crate::text::bytes(path, what, fix, LARGEST)
}

/// An [`ErrorKind::Input`] about the contents of a file.
fn damaged(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Input, what).fix("export the mesh again")
}
