//! A stable counting sort: positions of a list, gathered by the bin each belongs to.

use rayon::prelude::*;

use crate::backend::cpu::{Places, buffer};

/// Positions of a list ordered by bin, and by place in the list within a bin.
pub(crate) struct Bins {
    /// Where the positions of each bin start in `order`, with the end of the last one: `bins + 1` numbers.
    pub(crate) starts: Vec<u32>,
    /// The positions.
    pub(crate) order: Vec<u32>,
}

impl Bins {
    /// The positions in one bin, or in some neighbouring ones.
    pub(crate) fn positions(&self, first: usize, end: usize) -> &[u32] {
        &self.order[self.starts[first] as usize..self.starts[end] as usize]
    }
}

/// Sorts the positions of a list by their bins, each below `bins`.
///
/// Chunks of the list are counted and then placed in parallel; the result does not depend on how they are cut.
pub(crate) fn partition(list: &[u32], bins: usize) -> Bins {
    assert!(u32::try_from(list.len()).is_ok(), "a list of {} positions cannot be numbered by u32", list.len());
    let chunk = (1 << 15).max(4 * bins);
    // counts[i][b]: entries of chunk i in bin b; then the place where the first of them goes
    let mut counts: Vec<Vec<u32>> = list
        .par_chunks(chunk)
        .map(|part| {
            let mut count = vec![0u32; bins];
            part.iter().for_each(|&bin| count[bin as usize] += 1);
            count
        })
        .collect();
    let mut starts = vec![0u32; bins + 1];
    let mut next = 0;
    for bin in 0..bins {
        starts[bin] = next;
        for count in &mut counts {
            (count[bin], next) = (next, next + count[bin]);
        }
    }
    starts[bins] = next;
    let mut order: Vec<u32> = buffer(list.len());
    let places = Places::of(&mut order);
    list.par_chunks(chunk).zip(&mut counts).enumerate().for_each(|(i, (part, place))| {
        for (position, &bin) in ((i * chunk) as u32..).zip(part) {
            let at = &mut place[bin as usize];
            // SAFETY: the places of all chunks and bins are different and below the length of the list.
            unsafe { places.write(*at as usize, position) };
            *at += 1;
        }
    });
    Bins { starts, order }
}

#[cfg(test)]
mod tests {
    use super::partition;

    #[test]
    fn positions_are_gathered_by_bin_in_the_order_of_the_list() {
        let list: Vec<u32> = (0..100_000u32).map(|i| i.wrapping_mul(2_654_435_761) % 7).collect();
        let bins = partition(&list, 9);
        let mut wanted: Vec<u32> = (0..100_000).collect();
        wanted.sort_by_key(|&i| list[i as usize]);
        assert_eq!(bins.order, wanted);
        for bin in 0..9 {
            assert!(bins.positions(bin, bin + 1).iter().all(|&i| list[i as usize] as usize == bin));
        }
        assert_eq!((bins.starts[7], bins.starts[9]), (100_000, 100_000));
        assert!(partition(&[], 3).order.is_empty());
    }
}
