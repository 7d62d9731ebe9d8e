//! The files of a run: nothing is lost, and independent readers see what was written.

mod exchange;
mod results_file;
mod run_folder;
#[cfg(unix)]
mod signals;
