//! Memory of a thread for packed factors, kept from one product to the next.

use std::cell::Cell;

use bytemuck::{Pod, Zeroable};

/// A cache line, so that packed strips begin at one.
#[derive(Clone, Copy, Zeroable, Pod)]
#[repr(C, align(64))]
struct Line([u8; 64]);

thread_local! {
    static SCRATCH: Cell<Vec<Line>> = const { Cell::new(Vec::new()) };
}

/// Runs a function with `N` areas of the given lengths, whose contents are unspecified. A product inside it gets memory
/// of its own.
pub(super) fn with<T: Pod, const N: usize, R>(lengths: [usize; N], work: impl FnOnce([&mut [T]; N]) -> R) -> R {
    let lines = lengths.map(|length| (length * size_of::<T>()).div_ceil(size_of::<Line>()));
    let mut memory = SCRATCH.take();
    if memory.len() < lines.iter().sum() {
        memory.resize(lines.iter().sum(), Line::zeroed());
    }
    let mut rest = &mut memory[..];
    let areas = std::array::from_fn(|i| {
        let (area, after) = std::mem::take(&mut rest).split_at_mut(lines[i]);
        rest = after;
        &mut bytemuck::cast_slice_mut(area)[..lengths[i]]
    });
    let result = work(areas);
    SCRATCH.set(memory);
    result
}
