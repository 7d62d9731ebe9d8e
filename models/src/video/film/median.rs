//! The median.

/// The median of some values, the larger one of the two in the middle; they are put into another order.
///
/// # Panics
/// If there are none.
pub(super) fn median<T: Ord + Copy>(values: &mut [T]) -> T {
    let middle = values.len() / 2;
    *values.select_nth_unstable(middle).1
}
