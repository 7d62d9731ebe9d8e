//! Report: output files and the page of a run.

pub mod animation;
pub(crate) mod base64;
pub(crate) mod film;
mod markup;
pub(crate) mod page;
mod palette;
pub(crate) mod plot;
pub(crate) mod ply;
pub mod png_file;
pub(crate) mod quantity;
pub(crate) mod reconstruction;
pub mod results_file;
pub(crate) mod simulation;
pub(crate) mod synthesis;
#[cfg(test)]
mod tests;
