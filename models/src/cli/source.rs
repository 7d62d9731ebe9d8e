//! Inputs of a run: files that are identified on resuming, and devices.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use gradreel::{Device, Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::fnv1a::fnv1a;
use crate::views::FileWeights;

/// Where the model runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Place {
    /// The processor
    Cpu,
    /// The graphics card, through Vulkan, Metal or DirectX 12
    Gpu,
}

impl Place {
    /// The device.
    pub fn device(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            Self::Gpu => Device::gpu(),
        }
    }

    /// Maximum number of concurrent views unless memory limits it further; more views than threads would only wait
    /// for each other.
    pub fn at_once(self, views: usize) -> usize {
        match self {
            Self::Cpu => rayon::current_num_threads().min(views),
            Self::Gpu => views,
        }
    }
}

/// Absolute path, independent of the working directory; unchanged if the file does not exist.
pub(super) fn whole(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// Maximum seed representable in the settings file.
pub(super) const LARGEST_SEED: u64 = i64::MAX as u64;

/// An input file of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Source {
    /// Path at the start of the run, for display.
    pub path: String,
    /// Fingerprint.
    mark: String,
}

impl Source {
    /// The file in its present state; `what` describes its purpose in errors.
    pub fn of(path: &Path, what: &str) -> Result<Self> {
        let fix = format!("give the path of the file with {what}");
        // devices may be endless, and pipes may block
        if path.exists() && !path.is_file() {
            let error = Error::new(ErrorKind::Input, format!("cannot read {what}"));
            let found = if path.is_dir() { "a folder" } else { "a device, a pipe or a socket" };
            return Err(error.at(path.display()).found(found).wanted("a file").fix(fix));
        }
        let mark = match path == FileWeights::BUILT_IN {
            true => {
                let bytes = FileWeights::built_in()?;
                Ok(mark_of(bytes.len() as u64, bytes))
            }
            false => mark(path),
        };
        let mark = mark.map_err(|e| Error::io(path, &format!("read {what}"), &e).fix(fix))?;
        Ok(Self { path: path.display().to_string(), mark })
    }

    /// The fingerprint.
    pub fn mark(&self) -> &str {
        &self.mark
    }

    /// Bytes that are part of the program, under the name that stands for them.
    pub fn of_bytes(name: &str, bytes: &[u8]) -> Self {
        Self { path: name.to_owned(), mark: mark_of(bytes.len() as u64, bytes) }
    }

    /// Identifies the same file at its present location.
    pub fn found_again(&self, path: &Path, what: &str) -> Result<Self> {
        let found = Self::of(path, what)?;
        if found.mark == self.mark {
            return Ok(found);
        }
        Err(Error::new(ErrorKind::Input, format!("{what} changed since the run was begun"))
            .at(path.display())
            .found("another content")
            .wanted(format!("the file that was {}", self.path))
            .fix("go on with that file, or begin again with another --out"))
    }
}

/// Fingerprint: the size and FNV-1a of a file; large files are sampled.
fn mark(path: &Path) -> std::io::Result<String> {
    const PART: u64 = 1 << 16;
    const PARTS: u64 = 64;
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut bytes = Vec::new();
    if length <= PART * PARTS {
        file.read_to_end(&mut bytes)?;
    } else {
        for part in 0..PARTS {
            file.seek(SeekFrom::Start((length - PART) / (PARTS - 1) * part))?;
            (&mut file).take(PART).read_to_end(&mut bytes)?;
        }
    }
    Ok(mark_of(length, &bytes))
}

fn mark_of(length: u64, bytes: &[u8]) -> String {
    format!("{length}-{:016x}", fnv1a(bytes))
}
