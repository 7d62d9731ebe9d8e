//! What is printed as a result, and what is said besides.

use std::fmt;
use std::io::{ErrorKind, Write, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use gradreel::{Error, Result};

/// Prints a line as `println!` does, but neither a reader that has gone (`gradreel check clip | head`) nor a full disk is a
/// reason to stop.
macro_rules! say {
    () => { $crate::cli::output::print(format_args!("\n")) };
    ($text:literal $($more:tt)*) => { $crate::cli::output::print(format_args!("{}\n", format_args!($text $($more)*))) };
}

/// Says a line on stderr as `eprintln!` does, whether or not it can be written.
macro_rules! tell {
    ($($text:tt)*) => { $crate::report::terminal::tell(format_args!($($text)*)) };
}

pub(super) use say;
pub(super) use tell;

/// Whether something of the result could not be written although somebody wants it.
static LOST: AtomicBool = AtomicBool::new(false);

/// Prints, unless nobody reads it any more.
pub(super) fn print(text: fmt::Arguments<'_>) {
    let mut out = stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => LOST.store(true, Ordering::Relaxed),
        _ => {}
    }
}

/// For commands whose result is what they print: whether all of it was written.
///
/// # Errors
/// [`gradreel::ErrorKind::Io`] when it was not, as on a full disk.
pub(super) fn arrived() -> Result<()> {
    match LOST.load(Ordering::Relaxed) {
        false => Ok(()),
        true => Err(Error::new(gradreel::ErrorKind::Io, "cannot print the result")
            .at("stdout")
            .fix("make room on the disk that the output is redirected to")),
    }
}
