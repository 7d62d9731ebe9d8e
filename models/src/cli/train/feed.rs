//! Samples for the steps to come, made on another thread while the model is trained.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use gradreel::{Error, ErrorKind, Key, Result};

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
    receiver: Receiver<Vec<Sample>>,
}

impl Feed {
    /// From this step on.
    pub fn new(settings: &Settings, first: u64) -> Result<Self> {
        let (sender, receiver) = sync_channel(AHEAD);
        let settings = settings.clone();
        let work = move || {
            let key = Key::new(settings.seed).fold(SEEN);
            for step in first..settings.steps {
                let samples = drawn(&settings, key.fold(step), settings.optimiser.batch);
                if sender.send(samples).is_err() {
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
        })
    }
}

fn drawn(settings: &Settings, key: Key, count: usize) -> Vec<Sample> {
    let (ring, size) = (&settings.model.denoiser.ring, settings.model.image);
    (0..count).map(|i| Sample::draw(key.fold(i as u64), ring, size, &settings.data)).collect()
}

/// Objects that no step sees.
pub(super) fn unseen(settings: &Settings, count: usize) -> Vec<Sample> {
    drawn(settings, Key::new(settings.seed).fold(UNSEEN), count)
}

/// The key of what else chance decides at a step.
pub(super) fn chance(settings: &Settings, step: u64) -> Key {
    Key::new(settings.seed).fold(CHANCE).fold(step)
}
