//! Ctrl-C: the first asks the run to save and stop, the second stops it at once.
//!
//! A loop calls [`check`] between two steps, where its state is whole. `SIGTERM`, which batch systems send, counts as
//! a Ctrl-C.

use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use gradreel::{Error, ErrorKind, Result};

/// Exit status of a process that Ctrl-C ended: 128 + `SIGINT`.
const STOPPED: i32 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);
static INSTALLED: Mutex<bool> = Mutex::new(false);

/// Listens for Ctrl-C from here on. Calling it again does nothing.
///
/// # Errors
///
/// The operating system refuses, or another part of the process already listens.
pub fn install() -> Result<()> {
    let mut installed = INSTALLED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if !*installed {
        ctrlc::set_handler(on_signal)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot listen for Ctrl-C").found(e).fix("start the run again"))?;
        *installed = true;
    }
    Ok(())
}

/// Whether the user asked to stop.
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Ends the caller's work with `?` once the user asked to stop.
///
/// # Errors
///
/// [`ErrorKind::Interrupted`] after a Ctrl-C.
pub fn check() -> Result<()> {
    if requested() {
        return Err(Error::new(ErrorKind::Interrupted, "stopped on request")
            .fix("continue with `--resume`; what was finished is saved in the folder of the run"));
    }
    Ok(())
}

fn on_signal() {
    // signals are handled one after another
    if requested() {
        std::process::exit(STOPPED);
    }
    // said before the run can end; a closed stderr must not turn a clean stop into a panic.
    let message = "\nstopping: finishing the current step and saving; press Ctrl-C again to stop at once";
    let _ = writeln!(std::io::stderr(), "{message}");
    REQUESTED.store(true, Ordering::Relaxed);
}
