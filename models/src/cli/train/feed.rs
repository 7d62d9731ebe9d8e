//! Samples for the steps to come, made on another thread while the model is trained.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use gradreel::{Error, ErrorKind, Key, Result};

use super::meshes::Objects;
use super::settings::Settings;
use crate::views::objects::Sample;

/// What the numbers drawn from the seed are for. Unseen objects have keys of their own.
const SEEN: u64 = 100;
const UNSEEN: u64 = 101;
const CHANCE: u64 = 102;

/// Batches that wait.
const AHEAD: usize = 2;

/// Batches of samples in the order of the steps. Which they are follows from seed and step alone.
pub(super) struct Feed {
    receiver: Receiver<Result<Vec<Sample>>>,
}

impl Feed {
    /// From this step on.
    pub fn new(settings: &Settings, objects: &Objects, first: u64) -> Result<Self> {
        let (sender, receiver) = sync_channel(AHEAD);
        let (settings, objects) = (settings.clone(), objects.clone());
        let work = move || {
            let key = Key::new(settings.seed).fold(SEEN);
            for step in first..settings.steps {
                let key = key.fold(step);
                let each = (0..settings.optimiser.batch).map(|i| objects.sample(key.fold(i as u64), &settings));
                if sender.send(each.collect()).is_err() {
                    break; // nobody waits any more
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

/// Objects that no step sees.
pub(super) fn unseen(settings: &Settings, objects: &Objects, count: usize) -> Result<Vec<Sample>> {
    let key = Key::new(settings.seed).fold(UNSEEN);
    (0..count).map(|i| objects.unseen(i, key.fold(i as u64), settings)).collect()
}

/// The key of what else chance decides at a step.
pub(super) fn chance(settings: &Settings, step: u64) -> Key {
    Key::new(settings.seed).fold(CHANCE).fold(step)
}
