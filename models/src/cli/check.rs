//! `gradreel check`: looks at a clip without computing anything.

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};

use crate::video::inspect;

/// Arguments of `gradreel check`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of the clip: all_data.json and data/r_{camera}_{frame}.png
    clip: PathBuf,
}

/// Prints what is there, what is missing and what will be assumed.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let inventory = inspect(&arguments.clip)?;
    println!("{inventory}");
    if inventory.is_complete() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the clip is not complete")
        .at(arguments.clip.display())
        .found(format!("{} problems, listed above", inventory.problems.len()))
        .fix("correct the problems listed above, or choose complete cameras and frames with --cameras and --frames"))
}
