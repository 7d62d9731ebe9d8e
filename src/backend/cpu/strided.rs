//! Copies of elements that lie at regular steps: broadcasts, permutations, slices, flips.

use rayon::prelude::*;

use super::{CHUNK, Work, buffer, filled, widest};
use crate::backend::gpu::Strides;

/// A transposition goes through tiles of this many columns and rows: some lines of the cache each way.
const TILE: usize = 64;
const ROWS: usize = 16;

/// The elements at `start` plus all combinations of these steps, in row-major order of the axes.
pub(crate) fn gather<T: bytemuck::Pod + Send + Sync>(values: &[T], start: usize, axes: &Strides) -> Vec<T> {
    match transposed(axes.axes()) {
        Some(axis) => transpose(values, start, axes.axes(), axis),
        None => filled(axes.len(), CHUNK, |first, part| read(values, start, axes.axes(), first, part)),
    }
}

/// Writes the elements of a walk from number `first` on; as [`gather`], for a part of it.
pub(crate) fn read<T: Copy>(values: &[T], start: usize, axes: &[(usize, usize)], first: usize, out: &mut [T]) {
    if out.is_empty() {
        return;
    }
    let (&(inner, step), outer) = axes.split_last().unwrap_or((&(1, 0), &[]));
    let mut index = vec![0; outer.len()];
    let mut rest = first / inner;
    let mut place = start;
    for (i, (size, step)) in index.iter_mut().zip(outer).rev() {
        (*i, rest) = (rest % size, rest / size);
        place = place.wrapping_add(i.wrapping_mul(*step));
    }
    let (mut column, mut done) = (first % inner, 0);
    loop {
        let run = (inner - column).min(out.len() - done);
        let part = &mut out[done..done + run];
        let from = place.wrapping_add(column.wrapping_mul(step));
        match step {
            0 => part.fill(values[from]),
            1 if run >= 8 => part.copy_from_slice(&values[from..from + run]),
            1 => part.iter_mut().zip(&values[from..from + run]).for_each(|(to, from)| *to = *from),
            _ => {
                let mut at = from;
                for to in part {
                    *to = values[at];
                    at = at.wrapping_add(step);
                }
            }
        }
        done += run;
        if done == out.len() {
            return;
        }
        column = 0;
        for (i, (size, step)) in index.iter_mut().zip(outer).rev() {
            *i += 1;
            place = place.wrapping_add(*step);
            if *i < *size {
                break;
            }
            place = place.wrapping_sub(size.wrapping_mul(*step));
            *i = 0;
        }
    }
}

/// The axis along which neighbours lie side by side, when it is not the last one and long enough to work in tiles.
fn transposed(axes: &[(usize, usize)]) -> Option<usize> {
    let (last, outer) = axes.split_last()?;
    if last.1 <= 1 || last.0 < 4 || axes.iter().any(|(size, _)| *size == 0) {
        return None;
    }
    outer.iter().position(|&(size, step)| step == 1 && size >= 4)
}

/// A pointer that threads share; each writes places of its own.
#[derive(Clone, Copy)]
pub(crate) struct Places<T>(*mut T);

// SAFETY: whoever writes through it promises that no place is written by two threads.
unsafe impl<T: Send> Send for Places<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Places<T> {}

impl<T> Places<T> {
    /// The places of a slice, which must outlive the use of them.
    pub(crate) fn of(values: &mut [T]) -> Self {
        Self(values.as_mut_ptr())
    }

    /// Writes one place.
    ///
    /// # Safety
    /// It lies within the slice, and no other thread reads or writes it meanwhile.
    #[inline(always)]
    pub(crate) unsafe fn write(self, at: usize, value: T) {
        // SAFETY: the caller's promise.
        unsafe { self.0.add(at).write(value) }
    }

    /// The address of one place.
    ///
    /// # Safety
    /// It lies within the slice; what is written through it, no other thread reads or writes meanwhile.
    #[inline(always)]
    pub(crate) unsafe fn at(self, at: usize) -> *mut T {
        // SAFETY: the caller's promise.
        unsafe { self.0.add(at) }
    }

    /// Some neighbouring places.
    ///
    /// # Safety
    /// They lie within the slice, which is in use for as long as they are, and no other thread reads or writes them
    /// meanwhile.
    #[inline(always)]
    pub(crate) unsafe fn part<'a>(self, start: usize, len: usize) -> &'a mut [T] {
        // SAFETY: the caller's promise.
        unsafe { std::slice::from_raw_parts_mut(self.0.add(start), len) }
    }
}

/// Goes along the axis whose neighbours are side by side in the source and along the last one, whose neighbours are side
/// by side in the result, in tiles: each line of the cache is read and written while it is there.
fn transpose<T: bytemuck::Pod + Send + Sync>(
    values: &[T],
    start: usize,
    axes: &[(usize, usize)],
    axis: usize,
) -> Vec<T> {
    let mut result = buffer(axes.iter().map(|(size, _)| size).product());
    let places = Places::of(&mut result);
    let mut to_steps = vec![1; axes.len()];
    for i in (1..axes.len()).rev() {
        to_steps[i - 1] = to_steps[i] * axes[i].0;
    }
    let last = axes.len() - 1;
    // tiles: every place of the other axes, then pieces of these two
    let mut tiles: Vec<(usize, usize, usize)> =
        (0..axes.len()).filter(|i| *i != axis && *i != last).map(|i| (axes[i].0, axes[i].1, to_steps[i])).collect();
    let (across, (down, step)) = (axes[axis].0, axes[last]);
    let height = down.min(CHUNK / TILE * 4);
    // as many columns as make a chunk, in whole lines of the cache
    let width = (CHUNK / height).next_multiple_of(TILE).min(across.next_multiple_of(TILE));
    let pieces = [down.div_ceil(height), across.div_ceil(width)];
    tiles.push((pieces[0], height.wrapping_mul(step), height));
    tiles.push((pieces[1], width, width * to_steps[axis]));
    let count: usize = tiles.iter().map(|(size, ..)| size).product();
    let tile = |number: usize| {
        let (mut from, mut to, mut rest) = (start, 0, number);
        for (size, from_step, to_step) in tiles.iter().rev() {
            let i = rest % size;
            rest /= size;
            from = from.wrapping_add(i.wrapping_mul(*from_step));
            to += i * to_step;
        }
        let columns = width.min(across - number % pieces[1] * width);
        let down = height.min(down - number / pieces[1] % pieces[0] * height);
        widest(Tile { values, from, step, down, columns, places, to, to_step: to_steps[axis] });
    };
    if count == 1 {
        tile(0)
    } else {
        (0..count).into_par_iter().for_each(tile)
    }
    result
}

/// `columns` neighbours of the source, each the head of `down` elements at `step`, become rows of the result.
struct Tile<'a, T> {
    values: &'a [T],
    from: usize,
    step: usize,
    down: usize,
    columns: usize,
    places: Places<T>,
    to: usize,
    to_step: usize,
}

impl<T: bytemuck::Pod> Work for Tile<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { values, from, step, down, columns, places, to, to_step } = self;
        let mut tile = [T::zeroed(); TILE * ROWS];
        let mut column = 0;
        while column < columns {
            let width = TILE.min(columns - column);
            let mut row = 0;
            while row < down {
                let height = ROWS.min(down - row);
                // through a tile that stays in the first-level cache: lines of the result may all want one place of it
                let mut r = 0;
                while r < height {
                    let at = from.wrapping_add(column).wrapping_add((row + r).wrapping_mul(step));
                    let line = &values[at..at + width];
                    let mut i = 0;
                    while i < width {
                        tile[i * ROWS + r] = line[i];
                        i += 1;
                    }
                    r += 1;
                }
                let mut i = 0;
                while i < width {
                    // SAFETY: tiles cover the result once, each place by one thread.
                    let line = unsafe { places.part(to + (column + i) * to_step + row, height) };
                    line.copy_from_slice(&tile[i * ROWS..i * ROWS + height]);
                    i += 1;
                }
                row += height;
            }
            column += width;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One element after the other.
    fn plain(values: &[f32], start: usize, axes: &Strides) -> Vec<f32> {
        let place = |number: usize| {
            axes.axes().iter().rev().fold((start, number), |(at, rest), (size, step)| {
                (at.wrapping_add((rest % size).wrapping_mul(*step)), rest / size)
            })
        };
        (0..axes.len()).map(|number| values[place(number).0]).collect()
    }

    #[test]
    fn every_kind_of_step_copies_the_right_elements() {
        let values: Vec<f32> = (0..300_000).map(|i| i as f32).collect();
        let cases: [(usize, &[(usize, usize)]); 9] = [
            (0, &[(300, 1), (500, 300)]),
            (7, &[(3, 60_000), (17, 1), (5, 1700), (33, 20)]),
            (0, &[(70, 1), (4, 70_000), (250, 280)]),
            (5, &[(100, 0), (300, 1)]),
            (0, &[(1000, 7), (50, 0)]),
            (19_999, &[(10, 20_000), (20_000, 1usize.wrapping_neg())]),
            (3, &[(20, 3), (6, 2)]),
            (0, &[(0, 1), (5, 20)]),
            (4, &[]),
        ];
        for (start, axes) in cases {
            let axes = Strides::new(axes.iter().copied());
            assert_eq!(gather(&values, start, &axes), plain(&values, start, &axes), "{axes:?}");
        }
    }
}
