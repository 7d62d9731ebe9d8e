//! Batches for upcoming steps, generated on another thread during training.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use gradreel::{Error, ErrorKind, Key, Result};

use super::meshes::Objects;
use super::settings::Settings;
use crate::views::objects::Sample;

/// Key folds that separate the uses of the seed; held-out objects have their own keys.
const SEEN: u64 = 100;
const UNSEEN: u64 = 101;
const CHANCE: u64 = 102;

/// Number of batches generated ahead.
const AHEAD: usize = 2;

/// Batches of samples in the order of the steps, determined by seed and step alone.
pub(super) struct Feed {
    receiver: Receiver<Result<Vec<Sample>>>,
}

impl Feed {
    /// Starts from this step.
    pub fn new(settings: &Settings, objects: &Objects, first: u64) -> Result<Self> {
        let (sender, receiver) = sync_channel(AHEAD);
        let (settings, objects) = (settings.clone(), objects.clone());
        let work = move || {
            let key = Key::new(settings.seed).fold(SEEN);
            for step in first..settings.steps {
                let key = key.fold(step);
                let each = (0..settings.optimiser.batch).map(|i| objects.sample(key.fold(i as u64), &settings));
                if sender.send(each.collect()).is_err() {
                    break; // the receiver is gone
                }
            }
        };
        let spawned = thread::Builder::new().name("objects".into()).spawn(work);
        spawned.map_err(|e| Error::new(ErrorKind::Io, "cannot start a thread that makes objects").found(e))?;
        Ok(Self { receiver })
    }

    /// The samples of the next step.
    pub fn next(&self) -> Result<Vec<Sample>> {
        self.receiver.recv().map_err(|_| {
            Error::new(ErrorKind::Io, "the thread that makes objects has ended").fix("go on with `--resume`")
        })?
    }
}

/// Held-out objects, never used in training steps.
pub(super) fn unseen(settings: &Settings, objects: &Objects, count: usize) -> Result<Vec<Sample>> {
    let key = Key::new(settings.seed).fold(UNSEEN);
    (0..count).map(|i| objects.unseen(i, key.fold(i as u64), settings)).collect()
}

/// Key of a step's other random numbers.
pub(super) fn chance(settings: &Settings, step: u64) -> Key {
    Key::new(settings.seed).fold(CHANCE).fold(step)
}
