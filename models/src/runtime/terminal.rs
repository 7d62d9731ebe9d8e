//! Status lines on stderr.

use std::fmt;
use std::io::{Write, stderr};

/// Writes a line to stderr.
///
/// Write errors are ignored: a closed pipe or a full disk must not end a long run.
pub fn tell(line: fmt::Arguments<'_>) {
    // a single write, so that lines of different threads do not mix
    let _ = stderr().lock().write_all(format!("{line}\n").as_bytes());
}
