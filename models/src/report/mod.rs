//! Report: what a person opens after a run.

pub mod ply;
pub mod run_folder;
