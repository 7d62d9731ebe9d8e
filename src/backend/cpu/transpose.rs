//! Matrices turned over, a tile that fits the nearest cache at a time.

use rayon::prelude::*;

use crate::backend::cpu::buffer;

/// Rows of the result per work item, and columns per tile: a tile touches this many cache lines on either side.
const TILE: usize = 16;

/// A batch of row-major matrices `[rows, columns]` turned over to `[columns, rows]`.
pub(crate) fn transposed<T>(values: &[T], rows: usize, columns: usize) -> Vec<T>
where
    T: bytemuck::Zeroable + Copy + Send + Sync,
{
    if rows <= 1 || columns <= 1 {
        return values.to_vec();
    }
    let mut result = buffer(values.len());
    result.par_chunks_mut(rows * columns).zip(values.par_chunks(rows * columns)).for_each(|(to, from)| {
        to.par_chunks_mut(TILE * rows).enumerate().for_each(|(i, to)| tile_rows(to, &from[i * TILE..], rows, columns));
    });
    result
}

/// Some rows of the result, which are columns of `from`.
fn tile_rows<T: Copy>(to: &mut [T], from: &[T], rows: usize, columns: usize) {
    for first in (0..rows).step_by(TILE) {
        let end = rows.min(first + TILE);
        for (column, row) in to.chunks_mut(rows).enumerate() {
            for (r, out) in row[first..end].iter_mut().enumerate() {
                *out = from[(first + r) * columns + column];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::transposed;

    #[test]
    fn every_element_changes_its_indices() {
        for (batch, rows, columns) in [(1, 1, 5), (2, 5, 1), (3, 17, 33), (1, 16, 64), (0, 3, 3)] {
            let values: Vec<f32> = (0..batch * rows * columns).map(|i| i as f32).collect();
            let turned = transposed(&values, rows, columns);
            for (b, r, c) in (0..batch).flat_map(|b| (0..rows).flat_map(move |r| (0..columns).map(move |c| (b, r, c))))
            {
                assert_eq!(turned[(b * columns + c) * rows + r], values[(b * rows + r) * columns + c]);
            }
        }
    }
}
