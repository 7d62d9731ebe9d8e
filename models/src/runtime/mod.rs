//! Runtime services of long runs: the folder that their results lie in, their progress, and Ctrl-C.

pub mod interrupt;
pub(crate) mod memory;
pub mod progress;
pub mod run_folder;
pub(crate) mod terminal;
