//! `gradreel bench calibrate`: the error budget from clips that `bench coverage` has fitted.

use std::path::PathBuf;

use gradreel::{Error, Result};

use super::coverage;
use crate::cli::output::say;
use crate::coverage::{Calibrated, calibrate};
use crate::report::results_file::Measured;

/// Arguments of `gradreel bench calibrate`.
#[derive(clap::Args, Clone)]
#[command(after_long_help = AFTER)]
pub(super) struct Arguments {
    /// Folders of `gradreel bench coverage`, of the development split
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Write the budget into this file
    #[arg(long, value_name = "FILE", default_value = "error_budget.toml")]
    out: PathBuf,
}

const AFTER: &str = "\
The error budget holds the scales of what errs together: grid, shape, silhouettes. They are chosen so that the truths of the clips are
most probable; nothing is fitted again. Clips of the report split are refused.

The budget that the program has is models/src/identify/uncertainty/error_budget.toml.

Examples:
  gradreel bench coverage --clips 60 --out runs/c
  gradreel bench calibrate runs/c                   a few seconds";

/// Reads the lines of the folders and writes the budget.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let mut lines = Vec::new();
    for folder in &arguments.folders {
        lines.extend(coverage::lines(folder)?);
    }
    let Calibrated { budget, clips, log_scores: [before, after] } = calibrate(&lines)?;
    let date = Measured::here("gradreel").date;
    let text = budget.written(&format!("Development split, {clips} clips, {date}."));
    std::fs::write(&arguments.out, &text)
        .map_err(|e| Error::io(&arguments.out, "write the budget", &e).fix("name another file with --out"))?;
    say!("{text}");
    say!(
        "{clips} clips: mean log score {before:.3} nats with the budget that the program has, {after:.3} with this one"
    );
    say!("  wrote {}", arguments.out.display());
    Ok(())
}
