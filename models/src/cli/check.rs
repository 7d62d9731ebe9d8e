//! `gradreel check`: looks at a clip without computing anything.

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};

use crate::video::inspect;

/// Arguments of `gradreel check`.
#[derive(clap::Args)]
#[command(after_long_help = LAYOUTS)]
pub(super) struct Arguments {
    /// Folder of the clip, in one of the layouts below
    clip: PathBuf,
}

/// The layouts of clips, for the help of commands that open one.
pub(super) const LAYOUTS: &str = "\
Layouts of clips, recognised by the files in the folder:
  PAC-NeRF      all_data.json and data/r_{camera}_{frame}.png
  NeRF, D-NeRF  transforms.json, or transforms_train.json, …_val.json and …_test.json
  COLMAP        sparse/0/cameras.txt and images.txt, and frames/{camera}/{number}.png
  Spring-Gaus   camera.json and {camera}/{number}.png; of a real capture give …/dynamic/sequences/{object}/{number}.json
All but PAC-NeRF's need transparent images, or masks under masks/ (white on the object). A file clip.toml in the folder says what
a layout leaves open: up, metres_per_unit, origin, frames_per_s or duration_s, layout, and which cameras are imagined (synthesized
views that nobody filmed), as in imagined = [1, 2]. What is assumed, `gradreel check` prints.";

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
