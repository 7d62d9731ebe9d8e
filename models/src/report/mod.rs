//! Report: output files and the page of a run.

pub mod animation;
pub mod base64;
mod markup;
pub mod page;
mod palette;
pub mod plot;
pub mod ply;
pub mod png_file;
pub mod quantity;
pub mod reconstruction;
pub mod results_file;
pub mod simulation;
pub mod synthesis;
