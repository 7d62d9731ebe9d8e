//! Values of a regular grid at points, what points spread to a grid, and how both change with the points.
//!
//! The kernels see the values of a node, and those of a point, side by side: their innermost loops run over channels. Of
//! tensors with channels first they are given (and return) transposed copies: two passes over memory, where every lookup
//! would otherwise touch a cache line per channel.

// plain loops over indices: iterator adaptors are not sure to be compiled for the wide registers
#![allow(clippy::needless_range_loop)]

mod cell;
mod sample;
mod scatter;
mod slope;

use std::borrow::Cow;

use crate::backend::cpu::{pool, strided};
use crate::backend::gpu::Strides;
use crate::ops::grid::{Extent, Placement};
use crate::scalar::Real;

use cell::Cells;

/// Points that a work item takes at a time where the result has to be turned over.
const TILE: usize = 64;

/// Calls `$function::<T, D, K>` for the axes and the number of corners that a placement has.
macro_rules! for_cells {
    ($place:expr, $cells:ident => $call:expr) => {
        match ($place.axes.len(), $place.nearest) {
            (2, false) => {
                let $cells = Cells::<T, 2, 4>::new($place);
                $call
            }
            (2, true) => {
                let $cells = Cells::<T, 2, 1>::new($place);
                $call
            }
            (3, false) => {
                let $cells = Cells::<T, 3, 8>::new($place);
                $call
            }
            (3, true) => {
                let $cells = Cells::<T, 3, 1>::new($place);
                $call
            }
            (axes, _) => unreachable!("grids have two or three axes, not {axes}"),
        }
    };
}

/// The values of the grid at the points.
pub(crate) fn sample<T: Real>(place: &Placement, extent: Extent, values: &[T], points: &[T]) -> Vec<T> {
    let values = node_rows(place, extent, values);
    let samples = for_cells!(place, cells => sample::run(&cells, extent, &values, points, place.channels_first));
    give_back(values);
    samples
}

/// What the samples add to the nodes around their points.
pub(crate) fn scatter<T: Real>(place: &Placement, extent: Extent, samples: &[T], points: &[T]) -> Vec<T> {
    let samples = point_rows(place, extent, samples);
    let sums = for_cells!(place, cells => scatter::run(&cells, extent, &samples, points));
    give_back(samples);
    if !place.channels_first || extent.channels <= 1 {
        return sums;
    }
    let columns = turned(&sums, extent.nodes, extent.channels);
    pool::give(sums);
    columns
}

/// The derivative of `Σ samples · sample(values, points)` with respect to the points.
pub(crate) fn slope<T: Real>(place: &Placement, extent: Extent, values: &[T], points: &[T], samples: &[T]) -> Vec<T> {
    let (values, samples) = (node_rows(place, extent, values), point_rows(place, extent, samples));
    let slopes = for_cells!(place, cells => slope::run(&cells, extent, &values, points, &samples));
    give_back(values);
    give_back(samples);
    slopes
}

/// Lets the next result have the place of a copy.
fn give_back<T: Real>(values: Cow<'_, [T]>) {
    if let Cow::Owned(values) = values {
        pool::give(values);
    }
}

/// The values of the grid with the channels of a node side by side.
fn node_rows<'a, T: Real>(place: &Placement, extent: Extent, values: &'a [T]) -> Cow<'a, [T]> {
    match place.channels_first && extent.channels > 1 {
        true => turned(values, extent.channels, extent.nodes).into(),
        false => values.into(),
    }
}

/// The samples with the channels of a point side by side.
fn point_rows<'a, T: Real>(place: &Placement, extent: Extent, samples: &'a [T]) -> Cow<'a, [T]> {
    match place.channels_first && extent.channels > 1 {
        true => turned(samples, extent.channels, extent.count).into(),
        false => samples.into(),
    }
}

/// Matrices `[rows, columns]` one after the other, turned over to `[columns, rows]`.
fn turned<T: Real>(values: &[T], rows: usize, columns: usize) -> Vec<T> {
    let matrix = rows * columns;
    let axes = Strides::new([(values.len() / matrix.max(1), matrix), (columns, 1), (rows, columns)]);
    strided::gather(values, 0, &axes)
}

/// Calls `$block::<W>($i)` for blocks of channels, the widest first, until all are done.
macro_rules! by_blocks {
    ($channels:expr, $i:ident => $block:ident($($argument:expr),*)) => {{
        let mut $i = 0;
        while $i + 16 <= $channels {
            $block::<T, 16, K>($($argument),*);
            $i += 16;
        }
        while $i + 4 <= $channels {
            $block::<T, 4, K>($($argument),*);
            $i += 4;
        }
        while $i < $channels {
            $block::<T, 1, K>($($argument),*);
            $i += 1;
        }
    }};
}
use by_blocks;
