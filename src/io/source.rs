//! Where the bytes of a file are: in memory, on the disk, or mapped.

use std::borrow::Cow;
use std::fs::{self, File};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;

use crate::io::bytes::Bytes;
use crate::{Error, ErrorKind, Result};

/// A file up to this size is read when it is opened \[bytes\].
const READ_AT_ONCE: usize = 64 << 20;

const TENSORS: &str = "read the tensor file";

/// A file of which parts are read.
pub(super) enum Source {
    /// All of it, in memory or mapped.
    Held(Arc<Bytes>),
    /// Read from the disk where it is asked for. A file that is changed meanwhile gives other numbers or an error.
    Disk { file: File, len: usize, path: PathBuf },
}

impl Source {
    /// Opens a file. A small one is read, a large one is read in parts.
    pub fn open(path: &Path) -> Result<Self> {
        let (file, len) = regular(path)?;
        let source = Self::Disk { file, len, path: path.to_owned() };
        match len <= READ_AT_ONCE {
            true => Ok(source.read(0..len)?.into_owned().into()),
            false => Ok(source),
        }
    }

    /// Maps a file.
    ///
    /// # Safety
    /// Nobody changes or shortens the file as long as the source, or a tensor that lies in it, lives: the bytes are handed out
    /// as `&[u8]`, and a page that is gone ends the process.
    pub unsafe fn map(path: &Path) -> Result<Self> {
        let (file, len) = regular(path)?;
        if len == 0 {
            return Ok(Vec::new().into());
        }
        // SAFETY: the caller's promise. The map is read as plain bytes, which have no invalid values.
        let map = unsafe { Mmap::map(&file) }.map_err(|e| Error::io(path, TENSORS, &e))?;
        Ok(Self::Held(Arc::new(Bytes::Mapped(map))))
    }

    /// Bytes of the whole file.
    pub fn len(&self) -> usize {
        match self {
            Self::Held(bytes) => bytes.len(),
            Self::Disk { len, .. } => *len,
        }
    }

    /// The bytes at `range`, which lies within the file.
    pub fn read(&self, range: Range<usize>) -> Result<Cow<'_, [u8]>> {
        match self {
            Self::Held(bytes) => Ok(Cow::Borrowed(&bytes[range])),
            Self::Disk { file, path, .. } => {
                let mut bytes = vec![0; range.len()];
                read_at(file, &mut bytes, range.start as u64).map_err(|e| match e.kind() {
                    std::io::ErrorKind::UnexpectedEof => {
                        Error::new(ErrorKind::Input, "the file became shorter while it was read")
                            .at(path.display())
                            .found(format!("an end before byte {}", range.end))
                            .fix("let the program that writes it finish, and start again")
                    }
                    _ => Error::io(path, TENSORS, &e),
                })?;
                Ok(Cow::Owned(bytes))
            }
        }
    }

    /// As [`Source::read`]; `None` where the file has no such bytes.
    pub fn get(&self, range: Range<usize>) -> Result<Option<Cow<'_, [u8]>>> {
        match range.start <= range.end && range.end <= self.len() {
            true => self.read(range).map(Some),
            false => Ok(None),
        }
    }

    /// The first bytes of the file, at most `count`.
    pub fn head(&self, count: usize) -> Result<Cow<'_, [u8]>> {
        self.read(0..count.min(self.len()))
    }
}

impl From<Vec<u8>> for Source {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Held(Arc::new(Bytes::Owned(bytes)))
    }
}

/// Opens what is a file: a device may have no end, and a pipe may never be written.
fn regular(path: &Path) -> Result<(File, usize)> {
    let fault = |e: std::io::Error| Error::io(path, TENSORS, &e).fix("give the path of a file that can be read");
    let about = fs::metadata(path).map_err(fault)?;
    if !about.is_file() {
        return Err(Error::new(ErrorKind::Input, format!("cannot {TENSORS}"))
            .at(path.display())
            .found(if about.is_dir() { "a folder" } else { "a device, a pipe or a socket" })
            .wanted("a regular file")
            .fix(match about.is_dir() {
                true => "give the path of a file in it",
                false => "save the data as a file first, and give its path",
            }));
    }
    let file = File::open(path).map_err(fault)?;
    let len = file.metadata().map_err(fault)?.len();
    let len = usize::try_from(len).map_err(|_| fault(std::io::ErrorKind::FileTooLarge.into()))?;
    Ok((file, len))
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, at)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            read => (bytes, at) = (&mut bytes[read..], at + read as u64),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file that was opened and then cut is an error of what is read, not a crash.
    #[test]
    fn a_file_that_became_shorter_is_an_error() {
        let path = std::env::temp_dir().join(format!("gradreel-{}-shorter", std::process::id()));
        fs::write(&path, vec![7; 100_000]).unwrap();
        let (file, len) = regular(&path).unwrap();
        let source = Source::Disk { file, len, path: path.clone() };
        assert_eq!(source.read(99_998..100_000).unwrap()[..], [7, 7]);
        File::options().write(true).open(&path).unwrap().set_len(10).unwrap();
        let error = source.read(99_998..100_000).unwrap_err();
        fs::remove_file(&path).unwrap();
        assert!(error.to_string().contains("became shorter"), "{error}");
        assert_eq!(error.kind(), ErrorKind::Input);
    }
}
