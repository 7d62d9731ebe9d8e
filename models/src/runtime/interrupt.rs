//! Ctrl-C: the first asks the run to save and stop, the second stops it immediately.
//!
//! Loops call [`check`] between two steps, where their state is consistent. `SIGTERM`, which batch systems send,
//! counts as Ctrl-C.

use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use gradreel::{Error, ErrorKind, Result};

/// Exit status of a process ended by Ctrl-C: 128 + `SIGINT`.
const STOPPED: i32 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);
static INSTALLED: Mutex<bool> = Mutex::new(false);

/// Installs the signal handler. Further calls have no effect.
///
/// # Errors
///
/// If the operating system refuses, or another part of the process has installed a handler.
pub fn install() -> Result<()> {
    let mut installed = INSTALLED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if !*installed {
        ctrlc::set_handler(on_signal)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot listen for Ctrl-C").found(e).fix("start the run again"))?;
        *installed = true;
    }
    Ok(())
}

/// Whether a stop was requested.
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// For use with `?` in loops: returns an error once a stop was requested.
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
    // signals are handled sequentially
    if requested() {
        std::process::exit(STOPPED);
    }
    // printed before the run can end; a closed stderr must not turn a clean stop into a panic
    let message = "\nstopping: finishing the current step and saving; press Ctrl-C again to stop at once";
    let _ = writeln!(std::io::stderr(), "{message}");
    REQUESTED.store(true, Ordering::Relaxed);
}
