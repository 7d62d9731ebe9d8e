//! Batches for upcoming steps, generated on another thread during training.

use std::ops::Range;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use gradreel::{Error, ErrorKind, Result};

/// Number of batches generated ahead.
const AHEAD: usize = 2;

/// Batches in the order of the steps, determined by seed and step alone.
pub(super) struct Feed<T> {
    receiver: Receiver<Result<T>>,
}

impl<T: Send + 'static> Feed<T> {
    /// Starts with the first of these steps; `make` generates the batch of a step.
    pub fn new(steps: Range<u64>, make: impl Fn(u64) -> Result<T> + Send + 'static) -> Result<Self> {
        let (sender, receiver) = sync_channel(AHEAD);
        let work = move || {
            for step in steps {
                if sender.send(make(step)).is_err() {
                    break; // the receiver is gone
                }
            }
        };
        let spawned = thread::Builder::new().name("objects".into()).spawn(work);
        spawned.map_err(|e| Error::new(ErrorKind::Io, "cannot start a thread that makes objects").found(e))?;
        Ok(Self { receiver })
    }

    /// The batch of the next step.
    pub fn next(&self) -> Result<T> {
        self.receiver.recv().map_err(|_| {
            Error::new(ErrorKind::Io, "the thread that makes objects has ended").fix("go on with `--resume`")
        })?
    }
}
