//! Folding the elements behind each result into one: sums, products, extrema over any axes.
//!
//! The elements are taken in pieces of fixed size, a piece in lanes, and pieces are joined in order: what comes out
//! depends on the shape alone, neither on the number of threads nor on the width of the vectors.

use std::marker::PhantomData;

use rayon::prelude::*;

use super::{Work, filled, widest};
use crate::scalar::Real;

/// How elements are folded. `join` must be associative but for rounding, with `START` as its neutral element.
pub(crate) trait Fold<T: Real>: 'static {
    type State: Copy + Send + Sync;
    const START: Self::State;
    fn add(state: Self::State, x: T) -> Self::State;
    fn join(a: Self::State, b: Self::State) -> Self::State;
    fn finish(state: Self::State) -> T;
}

/// States side by side while a run of elements is folded.
const LANES: usize = 32;
/// Fewer of them for what is left of a run.
const FEW: usize = 8;
/// Elements of one piece, about: large enough to hide scheduling.
const PIECE: usize = 1 << 16;
/// Columns folded at a time: their states stay in the first-level cache.
const COLUMNS: usize = 1024;

/// Folds `x`: a result for every place of the axes `kept`, over all places of the axes `folded`. Both hold sizes and
/// steps, without axes of size 1 and merged where a single walk passes.
pub(crate) fn reduce<T: Real, F: Fold<T>>(x: &[T], kept: &[(usize, usize)], folded: &[(usize, usize)]) -> Vec<T> {
    let count = |axes: &[(usize, usize)]| axes.iter().map(|(size, _)| size).product::<usize>();
    let (results, behind) = (count(kept), count(folded));
    if results == 0 || behind == 0 {
        return vec![F::finish(F::START); results];
    }
    match kept.last() {
        Some(&(width, 1)) => columns::<T, F>(x, &kept[..kept.len() - 1], width, folded),
        _ => rows::<T, F>(x, kept, folded),
    }
}

/// Where the place with this number lies.
#[inline(always)]
fn offset(axes: &[(usize, usize)], number: usize) -> usize {
    let (mut at, mut rest, mut axis) = (0, number, axes.len());
    while axis > 1 {
        axis -= 1;
        let (size, step) = axes[axis];
        at += rest % size * step;
        rest /= size;
    }
    if axis == 1 { at + rest * axes[0].1 } else { at }
}

/// When the elements behind one result lie side by side, at least in runs.
fn rows<T: Real, F: Fold<T>>(x: &[T], kept: &[(usize, usize)], folded: &[(usize, usize)]) -> Vec<T> {
    let results: usize = kept.iter().map(|(size, _)| size).product();
    let (outer, run) = match folded.split_last() {
        Some((&(size, 1), outer)) => (outer, size),
        _ => (folded, 1),
    };
    let runs: usize = outer.iter().map(|(size, _)| size).product();
    if runs * run <= 2 * PIECE {
        return filled(results, (PIECE / (runs * run)).max(1), |first, out: &mut [T]| {
            widest(Rows::<T, F> { x, kept, outer, run, runs: 0..runs, first, out, of: PhantomData });
        });
    }
    // long runs are cut, short ones taken together
    let (cuts, length) = (run.div_ceil(PIECE), run.min(PIECE));
    let together = (PIECE / run).max(1);
    let pieces = runs.div_ceil(together) * cuts;
    let states: Vec<F::State> = (0..results * pieces)
        .into_par_iter()
        .map(|number| {
            let (piece, base) = (number % pieces, offset(kept, number / pieces));
            let start = piece % cuts * length;
            let runs = piece / cuts * together..runs.min((piece / cuts + 1) * together);
            widest(Piece::<T, F> { x, base: base + start, outer, run: length.min(run - start), runs, of: PhantomData })
        })
        .collect();
    states.chunks(pieces).map(|parts| F::finish(parts.iter().fold(F::START, |a, b| F::join(a, *b)))).collect()
}

/// Some results, each over all of its runs.
struct Rows<'a, T, F> {
    x: &'a [T],
    kept: &'a [(usize, usize)],
    outer: &'a [(usize, usize)],
    run: usize,
    runs: std::ops::Range<usize>,
    first: usize,
    out: &'a mut [T],
    of: PhantomData<F>,
}

impl<T: Real, F: Fold<T>> Work for Rows<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut i = 0;
        while i < self.out.len() {
            let base = offset(self.kept, self.first + i);
            let piece = Piece::<T, F> {
                x: self.x,
                base,
                outer: self.outer,
                run: self.run,
                runs: self.runs.clone(),
                of: PhantomData,
            };
            self.out[i] = F::finish(piece.run());
            i += 1;
        }
    }
}

/// Some runs behind one result.
struct Piece<'a, T, F> {
    x: &'a [T],
    base: usize,
    outer: &'a [(usize, usize)],
    run: usize,
    runs: std::ops::Range<usize>,
    of: PhantomData<F>,
}

impl<T: Real, F: Fold<T>> Work for Piece<'_, T, F> {
    type Output = F::State;

    #[inline(always)]
    fn run(self) -> F::State {
        let mut state = F::START;
        let mut number = self.runs.start;
        if self.run < LANES {
            while number < self.runs.end {
                let at = self.base + offset(self.outer, number);
                let values = &self.x[at..at + self.run];
                let mut i = 0;
                while i < values.len() {
                    state = F::add(state, values[i]);
                    i += 1;
                }
                number += 1;
            }
            return state;
        }
        // the lanes stay in registers: nothing below indexes them by a number that is not known beforehand
        let mut lanes = [F::START; LANES];
        let mut few = [F::START; FEW];
        while number < self.runs.end {
            let at = self.base + offset(self.outer, number);
            let values = &self.x[at..at + self.run];
            let (blocks, rest) = values.as_chunks::<LANES>();
            let mut block = 0;
            while block < blocks.len() {
                lanes = added::<T, F, LANES>(lanes, &blocks[block]);
                block += 1;
            }
            let (blocks, rest) = rest.as_chunks::<FEW>();
            let mut block = 0;
            while block < blocks.len() {
                few = added::<T, F, FEW>(few, &blocks[block]);
                block += 1;
            }
            let mut i = 0;
            while i < rest.len() {
                state = F::add(state, rest[i]);
                i += 1;
            }
            number += 1;
        }
        // halves onto halves
        let mut wide = [F::START; FEW];
        let mut i = 0;
        while i < FEW {
            let (a, b) = (F::join(lanes[i], lanes[FEW + i]), F::join(lanes[2 * FEW + i], lanes[3 * FEW + i]));
            wide[i] = F::join(F::join(a, b), few[i]);
            i += 1;
        }
        let halves = [
            F::join(wide[0], wide[4]),
            F::join(wide[1], wide[5]),
            F::join(wide[2], wide[6]),
            F::join(wide[3], wide[7]),
        ];
        F::join(state, F::join(F::join(halves[0], halves[2]), F::join(halves[1], halves[3])))
    }
}

/// A block of elements, each added to its lane.
#[inline(always)]
fn added<T: Real, F: Fold<T>, const N: usize>(mut lanes: [F::State; N], block: &[T; N]) -> [F::State; N] {
    let mut i = 0;
    while i < N {
        lanes[i] = F::add(lanes[i], block[i]);
        i += 1;
    }
    lanes
}

/// When neighbouring results have neighbouring elements behind them: `width` results for each place of `kept`.
fn columns<T: Real, F: Fold<T>>(x: &[T], kept: &[(usize, usize)], width: usize, folded: &[(usize, usize)]) -> Vec<T> {
    let (&(size, step), outer) = folded.split_last().unwrap_or((&(1, 0), &[]));
    // narrow rows that lie side by side are taken several at once, each as columns of its own
    let group = if step == width && width < 64 { (64 / width).min(size) } else { 1 };
    let tile = (width * group).min(COLUMNS);
    let tiles = width.div_ceil(tile);
    let places: usize = kept.iter().map(|(size, _)| size).product();
    let lines = outer.iter().map(|(size, _)| size).product::<usize>() * size.div_ceil(group);
    let together = (PIECE / tile).max(1);
    let pieces = lines.div_ceil(together);
    let fold = |place: usize, start: usize, tile: usize, piece: usize, states: &mut [F::State]| {
        let base = offset(kept, place) + start;
        let lines = piece * together..lines.min((piece + 1) * together);
        widest(Columns::<T, F> { x, base, outer, size, step, group, tile, width, lines, states, of: PhantomData });
    };
    if pieces == 1 {
        let few = (PIECE / (lines * tile)).max(1) * tile / group;
        return filled(places * width, few, |first, out: &mut [T]| {
            let mut states = vec![F::START; tile];
            let mut done = 0;
            while done < out.len() {
                let (place, start) = ((first + done) / width, (first + done) % width);
                let part = tile.min(width - start).min(out.len() - done);
                states.fill(F::START);
                fold(place, start, part, 0, &mut states);
                let out = &mut out[done..done + part];
                out.iter_mut().zip(&states).for_each(|(out, state)| *out = F::finish(*state));
                done += part;
            }
        });
    }
    // states of every piece, [places, tiles, pieces, tile]
    let mut states = vec![F::START; places * tiles * pieces * tile];
    states.par_chunks_mut(tile).enumerate().for_each(|(unit, states)| {
        let start = unit / pieces % tiles * tile;
        fold(unit / pieces / tiles, start, tile.min(width - start), unit % pieces, states);
    });
    filled(places * width, (PIECE / pieces).max(1), |first, out: &mut [T]| {
        for (i, out) in out.iter_mut().enumerate() {
            let (place, column) = ((first + i) / width, (first + i) % width);
            let at = (place * tiles + column / tile) * pieces * tile + column % tile;
            *out = F::finish((0..pieces).fold(F::START, |a, piece| F::join(a, states[at + piece * tile])));
        }
    })
}

/// Some lines of elements, added to the states of their columns. A line is up to `group` rows of the last folded axis.
struct Columns<'a, T: Real, F: Fold<T>> {
    x: &'a [T],
    base: usize,
    outer: &'a [(usize, usize)],
    size: usize,
    step: usize,
    group: usize,
    tile: usize,
    width: usize,
    lines: std::ops::Range<usize>,
    states: &'a mut [F::State],
    of: PhantomData<F>,
}

impl<T: Real, F: Fold<T>> Work for Columns<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { x, base, outer, size, step, group, tile, width, lines, states, .. } = self;
        let groups = size.div_ceil(group);
        let mut line = lines.start;
        while line < lines.end {
            let row = line % groups * group;
            let at = base + offset(outer, line / groups) + row * step;
            let len = if group > 1 { width * group.min(size - row) } else { tile };
            let values = &x[at..at + len];
            let states = &mut states[..len];
            let mut i = 0;
            while i < len {
                states[i] = F::add(states[i], values[i]);
                i += 1;
            }
            line += 1;
        }
        // the rows of a group belong to the same results
        let mut row = 1;
        while row < group {
            let mut i = 0;
            while i < width {
                states[i] = F::join(states[i], states[row * width + i]);
                i += 1;
            }
            row += 1;
        }
    }
}
