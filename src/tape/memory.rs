//! What a tape holds in memory, now and at most.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::{BuildHasherDefault, Hasher};

use crate::Tensor;

/// Bytes that a tape holds for its backward pass.
///
/// Counted are the distinct tensors among the operands and results that some derivative will read, what forward passes
/// declared with [`Forward::holding`](crate::Forward::holding), and, while a backward pass runs, the cotangents that wait
/// for their turn. Not counted are single numbers, tensors that only the program's own variables keep, and what one op needs
/// while it runs.
///
/// ```
/// # use gradreel::{Tape, Tensor};
/// # let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
/// let loss = x.square().sum_all();
/// println!("{} bytes are held", tape.memory().held);
/// # let _ = loss;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Memory {
    /// Bytes held now.
    pub held: usize,
    /// The most bytes held at any time so far.
    pub peak: usize,
}

/// The account behind [`Memory`]: how many times each storage is held.
#[derive(Default)]
pub(super) struct Ledger {
    memory: Memory,
    holds: AddressMap<usize, u32>,
}

impl Ledger {
    pub(super) fn memory(&self) -> Memory {
        self.memory
    }

    /// A tensor is held once more.
    pub(super) fn hold(&mut self, tensor: &Tensor) {
        let Some(storage) = tensor.storage_address() else { return };
        let holds = self.holds.entry(storage).or_insert(0);
        *holds += 1;
        if *holds == 1 {
            self.add(tensor.bytes());
        }
    }

    /// A tensor is held once less.
    pub(super) fn release(&mut self, tensor: &Tensor) {
        let Some(storage) = tensor.storage_address() else { return };
        let Entry::Occupied(mut holds) = self.holds.entry(storage) else { return };
        *holds.get_mut() -= 1;
        if *holds.get() == 0 {
            holds.remove();
            self.subtract(tensor.bytes());
        }
    }

    pub(super) fn add(&mut self, bytes: usize) {
        self.memory.held += bytes;
        self.memory.peak = self.memory.peak.max(self.memory.held);
    }

    pub(super) fn subtract(&mut self, bytes: usize) {
        self.memory.held -= bytes;
    }
}

/// A map whose keys are addresses.
pub(crate) type AddressMap<K, V> = HashMap<K, V, BuildHasherDefault<Mixer>>;

/// A hash of addresses by a multiplication each: nobody chooses addresses to collide.
#[derive(Default)]
pub(crate) struct Mixer(u64);

impl Hasher for Mixer {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, _bytes: &[u8]) {
        unreachable!("addresses are hashed as words");
    }

    fn write_usize(&mut self, address: usize) {
        // the upper half of a product depends on all of its factors; the map uses both ends of the hash
        self.0 = (self.0 ^ address as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(32);
    }
}
