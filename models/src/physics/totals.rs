//! Accumulators of the cotangents of densities and parameters over a backward pass.
//!
//! A value shared by all particles has one `f64` sum per block of particles; a per-particle value has an array. The
//! order of every sum is fixed, whatever the number of threads.

use std::ops::Range;

use super::grid::OnWorld;
use super::row::Number;
use super::state::BLOCK;
use super::values::Values;

/// The location of a value's accumulator.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Place {
    /// The n-th sum of a block.
    Shared(usize),
    /// The n-th array of a block.
    Array(usize),
}

/// The accumulators of all values, by block.
#[derive(Debug)]
pub(crate) struct Totals<T> {
    /// The location of each value's accumulator, in order.
    pub places: Vec<Place>,
    /// Values per block in `sums` and in `each`; never 0.
    pub widths: [usize; 2],
    /// Per block, one sum for each shared value.
    pub sums: Vec<f64>,
    /// Per block, one array for each per-particle value.
    pub each: Vec<T>,
    /// The cotangents of gravity and friction.
    pub world: OnWorld,
}

impl<T: Number> Totals<T> {
    /// Zero accumulators for these values and this many blocks.
    pub fn new<'a>(values: impl Iterator<Item = &'a Values<T>>, blocks: usize) -> Self {
        let (mut shared, mut arrays) = (0, 0);
        let place = |values: &Values<T>| match values {
            Values::Same(_) => {
                shared += 1;
                Place::Shared(shared - 1)
            }
            Values::Each(_) => {
                arrays += 1;
                Place::Array(arrays - 1)
            }
        };
        let places = values.map(place).collect();
        let widths = [shared.max(1), arrays.max(1) * BLOCK];
        let (sums, each) = (vec![0.0; blocks * widths[0]], vec![T::ZERO; blocks * widths[1]]);
        Self { places, widths, sums, each, world: OnWorld::default() }
    }

    /// The total of a value: one number, or one per particle.
    pub fn of(&self, place: Place, particles: usize) -> Vec<T> {
        let [sums, each] = self.widths;
        match place {
            Place::Shared(n) => vec![T::from_f64(self.sums.iter().skip(n).step_by(sums).sum())],
            Place::Array(n) => (0..particles).map(|p| self.each[p / BLOCK * each + n * BLOCK + p % BLOCK]).collect(),
        }
    }
}

/// The accumulators of one block.
pub(crate) struct Sink<'a, T> {
    /// Sums of shared values.
    pub sums: &'a mut [f64],
    /// Arrays of per-particle values.
    pub each: &'a mut [T],
}

impl<T: Number> Sink<'_, T> {
    /// Adds the cotangents of a value, from some particles of the block.
    pub fn add(&mut self, place: Place, lanes: Range<usize>, cotangents: &[T]) {
        match place {
            Place::Shared(n) => self.sums[n] += cotangents.iter().map(|&g| g.to_f64()).sum::<f64>(),
            Place::Array(n) => {
                let array = &mut self.each[n * BLOCK..][lanes];
                array.iter_mut().zip(cotangents).for_each(|(sum, &g)| *sum += g);
            }
        }
    }
}
