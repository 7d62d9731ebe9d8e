//! Lines on stderr, which nobody has to read.

use std::fmt;
use std::io::{Write, stderr};

/// Writes a line to stderr.
///
/// A reader that has gone and a full disk are no reason to end a run of an hour: what cannot be written is dropped.
///
/// ```
/// use gradreel_models::report::terminal::tell;
///
/// tell(format_args!("frame {}", 3));
/// ```
pub fn tell(line: fmt::Arguments<'_>) {
    // one write, so that the lines of two threads do not mix
    let _ = stderr().lock().write_all(format!("{line}\n").as_bytes());
}
