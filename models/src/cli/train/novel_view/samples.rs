//! Samples of a training and of its validation, determined by the seed.

use gradreel::{Key, Result};

use super::meshes::Objects;
use super::settings::Settings;
use crate::cli::train::feed::Feed;
use crate::views::objects::Sample;

/// Key folds that separate the uses of the seed; held-out objects have their own keys.
const SEEN: u64 = 100;
const UNSEEN: u64 = 101;
const CHANCE: u64 = 102;

/// The samples of all steps from this one.
pub(super) fn feed(settings: &Settings, objects: &Objects, first: u64) -> Result<Feed<Vec<Sample>>> {
    let (settings, objects) = (settings.clone(), objects.clone());
    let key = Key::new(settings.seed).fold(SEEN);
    Feed::new(first..settings.steps, move |step| {
        let key = key.fold(step);
        (0..settings.optimiser.batch).map(|i| objects.sample(key.fold(i as u64), &settings)).collect()
    })
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
