//! Printing of results to stdout and of status lines to stderr.

use std::fmt;
use std::io::{ErrorKind, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use gradreel::{Error, Result};

/// Prints a line like `println!`, but a closed pipe (`gradreel check clip | head`) or a full disk does not end the
/// program.
macro_rules! say {
    () => { $crate::cli::output::print(format_args!("\n")) };
    ($text:literal $($more:tt)*) => { $crate::cli::output::print(format_args!("{}\n", format_args!($text $($more)*))) };
}

/// Prints a line to stderr like `eprintln!`, ignoring write errors.
macro_rules! tell {
    ($($text:tt)*) => { $crate::runtime::terminal::tell(format_args!($($text)*)) };
}

pub(super) use say;
pub(super) use tell;

/// Whether some output could not be written for a reason other than a closed pipe.
static LOST: AtomicBool = AtomicBool::new(false);

/// Prints text, ignoring a closed pipe.
pub(super) fn print(text: fmt::Arguments<'_>) {
    let mut out = stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => LOST.store(true, Ordering::Relaxed),
        _ => {}
    }
}

/// Checks that all output was written, for commands whose result is their output.
///
/// # Errors
/// [`gradreel::ErrorKind::Io`] if it was not, as on a full disk.
pub(super) fn arrived() -> Result<()> {
    match LOST.load(Ordering::Relaxed) {
        false => Ok(()),
        true => Err(Error::new(gradreel::ErrorKind::Io, "cannot print the result")
            .at("stdout")
            .fix("make room on the disk that the output is redirected to")),
    }
}
