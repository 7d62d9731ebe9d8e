//! The weights that a command runs a model with.

use std::path::Path;

use gradreel::{Device, Result};

use crate::views::FileWeights;

/// A file up to this size is read into memory, a larger one is mapped \[bytes\].
const LARGEST_COPY: u64 = 1 << 30;

/// Opens weights to run a model with.
pub(super) fn open(path: impl AsRef<Path>, device: &Device) -> Result<FileWeights> {
    let path = path.as_ref();
    let large = std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() > LARGEST_COPY);
    match (device, large) {
        // SAFETY: this process writes no file of weights in place: its own are renamed to their names when they are whole.
        // That other programs leave the file alone while a run uses it is a condition that the help of the commands states;
        // a private copy would take the disk and the memory of the whole model.
        (Device::Cpu, true) => unsafe { FileWeights::open_mapped(path, device) },
        _ => FileWeights::open(path, device),
    }
}
