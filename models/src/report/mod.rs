//! Report: what a person opens after a run.

pub mod run_folder;
