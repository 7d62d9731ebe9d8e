//! Report: what a person opens after a run.

pub mod animation;
pub mod interrupt;
mod palette;
pub mod ply;
pub mod png_file;
pub mod progress;
pub mod quantity;
pub mod run_folder;
