//! Opening the weights of a model.

use std::path::Path;

use gradreel::{Device, Result};

use crate::views::FileWeights;

/// Maximum size of a file that is read into memory \[bytes\]; larger files are mapped.
const LARGEST_COPY: u64 = 1 << 30;

/// Opens weights for inference.
pub(super) fn open(path: impl AsRef<Path>, device: &Device) -> Result<FileWeights> {
    let path = path.as_ref();
    let large = std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() > LARGEST_COPY);
    match (device, large) {
        // SAFETY: this process never writes weights in place: it renames complete files to their final names. That
        // other programs must not change the file during a run is stated in the help of the commands; a private
        // copy would take the model's full size on disk and in memory.
        (Device::Cpu, true) => unsafe { FileWeights::open_mapped(path, device) },
        _ => FileWeights::open(path, device),
    }
}
