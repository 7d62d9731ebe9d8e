//! Sorting on a GPU.

use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::{DType, Result, Spec, Tensor};

const TEXT: &str = include_str!("../../../kernels/sort_pairs.wgsl");

/// Sorts blocks that fit workgroup memory.
pub(crate) static SORT_BLOCKS: Kernel = Kernel::new("sort_pairs", "blocks", TEXT, &["y", "x"]);
/// One comparison per pair at a distance beyond a block.
pub(crate) static SORT_STEPS: Kernel = Kernel::new("sort_pairs", "steps", TEXT, &["y", "x"]);
/// The comparisons of a run within blocks.
pub(crate) static SORT_TAILS: Kernel = Kernel::new("sort_pairs", "tails", TEXT, &["y", "x"]);

/// Pairs of `u32` `[2 · count]`, sorted by the first and then by the second word, with pairs of the largest words after
/// them up to a power of two.
///
/// # Errors
/// Those of the device.
pub(crate) fn sorted_pairs(gpu: &Gpu, pairs: &Tensor) -> Result<Tensor> {
    let (count, block) = (pairs.len() / 2, SORT_BLOCKS.reflect()?.constant("BLOCK"));
    let padded = count.next_power_of_two().max(block);
    let launch = |kernel, x: &Tensor, given, run, distance, work| {
        let sizes = words([given, padded, run, distance]);
        gpu.launch(kernel, &[x], &sizes, Spec::new([2 * padded], DType::U32), work)
    };
    let blocks = Work::Groups(padded / block);
    let mut sorted = launch(&SORT_BLOCKS, pairs, count, block, 0, blocks)?;
    let mut run = 2 * block;
    while run <= padded {
        let mut distance = run / 2;
        while distance >= block {
            sorted = launch(&SORT_STEPS, &sorted, padded, run, distance, Work::Invocations(padded))?;
            distance /= 2;
        }
        sorted = launch(&SORT_TAILS, &sorted, padded, run, 0, blocks)?;
        run *= 2;
    }
    Ok(sorted)
}
