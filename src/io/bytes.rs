//! The bytes of a file, mapped from the disk or held in memory; and writing a file whole or not at all.

use std::fs::{self, File};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use memmap2::Mmap;

use crate::{Error, Result};

/// The bytes of a whole file. A mapped file is read from the disk page by page, where it is looked at; whoever mapped it
/// promised that nobody changes it meanwhile (`Source::map`).
#[derive(Debug)]
pub(crate) enum Bytes {
    Mapped(Mmap),
    Owned(Vec<u8>),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Mapped(map) => map,
            Self::Owned(bytes) => bytes,
        }
    }
}

/// Lets `write` fill a new file beside `path`, flushes it to the disk and renames it to `path`: whoever opens `path`, even
/// after a crash, sees the old content or the new one, never a part.
pub(super) fn write_whole(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let partial = partial_name(path);
    let written = write(&partial).and_then(|()| {
        let flushed = File::open(&partial).and_then(|file| file.sync_all());
        flushed.and_then(|()| fs::rename(&partial, path)).map_err(|e| Error::io(path, "write the tensor file", &e))
    });
    if written.is_err() {
        // the first fault is the one to report
        let _ = fs::remove_file(&partial);
    }
    written
}

/// A name in the same folder that no other writer uses.
fn partial_name(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    path.with_file_name(format!(".{name}.{}-{count}.partial", std::process::id()))
}
