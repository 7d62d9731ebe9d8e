//! The folder of a run and its signals: nothing is lost.

mod run_folder;
#[cfg(unix)]
mod signals;
