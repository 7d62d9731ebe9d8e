//! What is printed as a result.

use std::fmt;
use std::io::{ErrorKind, Write, stdout};

/// Prints a line as `println!` does, but a reader that has gone (`gradreel check clip | head`) is no reason to stop.
macro_rules! say {
    () => { $crate::cli::output::print(format_args!("\n")) };
    ($text:literal $($more:tt)*) => { $crate::cli::output::print(format_args!("{}\n", format_args!($text $($more)*))) };
}

pub(super) use say;

/// Prints, unless nobody reads it any more. What cannot be written for another reason, such as a full disk, ends the program: what
/// was redirected into a file would be lost.
pub(super) fn print(text: fmt::Arguments<'_>) {
    match stdout().lock().write_fmt(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            eprintln!("error: cannot print the result: {error}");
            std::process::exit(1);
        }
        _ => {}
    }
}
