//! What the readers of meshes have in common: their files, their text, and Wavefront's files, in which both solids and textured
//! objects come.

pub(crate) mod obj;
pub(crate) mod text;
pub(crate) mod wavefront;

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Largest mesh, and largest file of particles or one that a mesh names \[bytes\].
pub(crate) const LARGEST: u64 = 256 << 20;

/// Reads a regular file of at most [`LARGEST`] bytes, whatever length the system tells; `what` says in an error what it was to
/// be, and `fix` which file is meant.
///
/// # Errors
/// [`ErrorKind::Input`] for a file that is missing, is a folder, a device or a pipe, or is longer.
pub(crate) fn read(path: &Path, what: &str, fix: &str) -> Result<Vec<u8>> {
    // A pipe would be waited for.
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
