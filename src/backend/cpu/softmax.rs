//! Softmax along one axis, and its adjoint: rows where the axis is the last, columns of vectors elsewhere.

// plain loops: iterator adaptors would lose the instruction set
#![allow(clippy::needless_range_loop)]

use rayon::prelude::*;

use super::{CHUNK, Places, buffer, vectorised};
use crate::scalar::{Job, Lane, Real};

/// A tensor as `[outer, len, inner]`, with the axis in the middle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    pub outer: usize,
    pub len: usize,
    pub inner: usize,
}

/// Vectors of a column that are worked on at once.
const GROUP: usize = 4;

/// What is computed of each row or column.
#[derive(Clone, Copy)]
pub(crate) enum Pass<'a, T> {
    /// `eˣ / Σ eˣ`
    Softmax(&'a [T]),
    /// `x − ln Σ eˣ`
    LogSoftmax(&'a [T]),
    /// `y (g − Σ g y)` of `y` and `g`.
    Adjoint(&'a [T], &'a [T]),
}

/// Runs a pass over a whole tensor.
///
/// # Panics
/// When an operand has not as many elements as the axes say.
pub(crate) fn run<T: Real>(axis: Axis, pass: Pass<'_, T>) -> Vec<T> {
    let count = axis.outer * axis.len * axis.inner;
    let fits = match pass {
        Pass::Softmax(x) | Pass::LogSoftmax(x) => x.len() == count,
        Pass::Adjoint(y, g) => y.len() == count && g.len() == count,
    };
    assert!(fits, "an operand of a softmax has not {count} elements");
    let mut result = buffer::<T>(count);
    if result.is_empty() {
        return result;
    }
    let to = Places::of(&mut result);
    // runs of rows, or of columns within one outer index
    let (runs, per_run) = if axis.inner == 1 {
        let rows = (CHUNK / axis.len).max(1);
        (axis.outer.div_ceil(rows), rows)
    } else {
        let columns = (CHUNK / axis.len).next_multiple_of(64);
        (axis.outer * axis.inner.div_ceil(columns), columns)
    };
    (0..runs).into_par_iter().for_each(|run| {
        // SAFETY: operands and result have as many elements as the axes say, and runs do not overlap.
        unsafe { vectorised(Run { axis, pass, to, run, per_run }) }
    });
    result
}

struct Run<'a, T> {
    axis: Axis,
    pass: Pass<'a, T>,
    to: Places<T>,
    run: usize,
    per_run: usize,
}

impl<T: Real> Job<T> for Run<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Axis { outer, len, inner } = self.axis;
        // SAFETY: every place is within `outer · len · inner`, and runs do not overlap.
        unsafe {
            if inner == 1 {
                let first = self.run * self.per_run;
                let mut row = first;
                while row < (first + self.per_run).min(outer) {
                    let (at, to) = (row * len, self.to.at(row * len));
                    match self.pass {
                        Pass::Softmax(x) => softmax_row::<V, false>(x.as_ptr().add(at), to, len),
                        Pass::LogSoftmax(x) => softmax_row::<V, true>(x.as_ptr().add(at), to, len),
                        Pass::Adjoint(y, g) => adjoint_row::<V>(y.as_ptr().add(at), g.as_ptr().add(at), to, len),
                    }
                    row += 1;
                }
                return;
            }
            let runs = inner.div_ceil(self.per_run);
            let start = self.run / runs * len * inner;
            let first = self.run % runs * self.per_run;
            let end = (first + self.per_run).min(inner);
            let mut column = first;
            while column < end {
                let at = start + column;
                let place = Column { len, step: inner, width: end - column };
                if end - column >= GROUP * V::WIDTH {
                    columns::<V, GROUP>(self.pass, at, self.to.at(at), place);
                    column += GROUP * V::WIDTH;
                } else {
                    columns::<V, 1>(self.pass, at, self.to.at(at), place);
                    column += V::WIDTH;
                }
            }
        }
    }
}

/// The largest number of a vector. A NaN may be passed over; the sum of the exponentials brings it back.
#[inline(always)]
unsafe fn largest_of<V: Lane>(m: V) -> V::Element {
    let mut values = [V::Element::ZERO; 16];
    // SAFETY: as the caller; no vector is wider than 16.
    unsafe { m.store(values.as_mut_ptr()) };
    let mut largest = values[0];
    for i in 1..V::WIDTH {
        if values[i] > largest {
            largest = values[i];
        }
    }
    largest
}

/// What is subtracted from every element: the largest one, or 0 where that is −∞, because −∞ − −∞ would be NaN.
#[inline(always)]
fn shift_of<T: Real>(largest: T) -> T {
    if largest == -T::INFINITY { T::ZERO } else { largest }
}

#[inline(always)]
unsafe fn softmax_row<V: Lane, const LOG: bool>(x: *const V::Element, y: *mut V::Element, len: usize) {
    // SAFETY: both have `len` elements.
    unsafe {
        let whole = len - len % (GROUP * V::WIDTH);
        let mut tops = [V::splat(-V::Element::INFINITY); GROUP];
        let mut at = 0;
        while at < whole {
            for g in 0..GROUP {
                tops[g] = V::load(x.add(at + g * V::WIDTH)).larger(tops[g]);
            }
            at += GROUP * V::WIDTH;
        }
        let mut largest = largest_of(tops[0].larger(tops[1]).larger(tops[2].larger(tops[3])));
        while at < len {
            if *x.add(at) > largest {
                largest = *x.add(at);
            }
            at += 1;
        }
        let shift = V::splat(shift_of(largest));
        let mut sums = [V::splat(V::Element::ZERO); GROUP];
        at = 0;
        while at < whole {
            for g in 0..GROUP {
                let e = V::load(x.add(at + g * V::WIDTH)).sub(shift).exp_of_negative();
                if !LOG {
                    e.store(y.add(at + g * V::WIDTH));
                }
                sums[g] = sums[g].add(e);
            }
            at += GROUP * V::WIDTH;
        }
        let mut sum = sums[0].add(sums[1]).add(sums[2].add(sums[3])).total();
        while at < len {
            let count = V::WIDTH.min(len - at);
            let e = V::load_part(x.add(at), count).sub(shift).exp_of_negative();
            let mut values = [V::Element::ZERO; 16];
            e.store(values.as_mut_ptr());
            for i in 0..count {
                if !LOG {
                    *y.add(at + i) = values[i];
                }
                sum += values[i];
            }
            at += count;
        }
        at = 0;
        if LOG {
            let log_sum = V::splat(if sum == V::Element::ZERO { V::Element::ZERO } else { sum.ln() });
            while at < len {
                V::load_part(x.add(at), len - at).sub(shift).sub(log_sum).store_part(y.add(at), len - at);
                at += V::WIDTH;
            }
        } else {
            let factor = V::splat(if sum == V::Element::ZERO { V::Element::ZERO } else { V::Element::ONE / sum });
            while at < len {
                V::load_part(y.add(at), len - at).mul(factor).store_part(y.add(at), len - at);
                at += V::WIDTH;
            }
        }
    }
}

#[inline(always)]
unsafe fn adjoint_row<V: Lane>(y: *const V::Element, g: *const V::Element, to: *mut V::Element, len: usize) {
    // SAFETY: all have `len` elements.
    unsafe {
        let whole = len - len % (GROUP * V::WIDTH);
        let mut sums = [V::splat(V::Element::ZERO); GROUP];
        let mut at = 0;
        while at < whole {
            for k in 0..GROUP {
                let place = at + k * V::WIDTH;
                sums[k] = V::load(y.add(place)).mul_add(V::load(g.add(place)), sums[k]);
            }
            at += GROUP * V::WIDTH;
        }
        while at < len {
            sums[0] = V::load_part(y.add(at), len - at).mul_add(V::load_part(g.add(at), len - at), sums[0]);
            at += V::WIDTH;
        }
        let mean = V::splat(sums[0].add(sums[1]).add(sums[2].add(sums[3])).total());
        at = 0;
        while at < len {
            let slope = V::load_part(g.add(at), len - at).sub(mean);
            V::load_part(y.add(at), len - at).mul(slope).store_part(to.add(at), len - at);
            at += V::WIDTH;
        }
    }
}

/// Neighbouring columns: `len` elements, `step` apart; `width` columns are left.
#[derive(Clone, Copy)]
struct Column {
    len: usize,
    step: usize,
    width: usize,
}

/// `N` vectors of columns that begin at `at` of the operands and at `to`.
#[inline(always)]
unsafe fn columns<V: Lane, const N: usize>(pass: Pass<'_, V::Element>, at: usize, to: *mut V::Element, place: Column) {
    let Column { len, step, width } = place;
    let (zero, one) = (V::Element::ZERO, V::Element::ONE);
    // SAFETY: `len` rows of at least `min(width, N · WIDTH)` columns, `step` apart.
    unsafe {
        match pass {
            Pass::Softmax(x) | Pass::LogSoftmax(x) => {
                let x = x.as_ptr().add(at);
                let mut tops = [V::splat(-V::Element::INFINITY); N];
                for i in 0..len {
                    for n in 0..N {
                        let from = x.add(i * step + n * V::WIDTH);
                        tops[n] = V::load_part(from, width - n * V::WIDTH).larger(tops[n]);
                    }
                }
                let mut sums = [V::splat(zero); N];
                for n in 0..N {
                    tops[n] = tops[n].le(V::splat(-V::Element::INFINITY)).choose(V::splat(zero), tops[n]);
                }
                let log = matches!(pass, Pass::LogSoftmax(_));
                for i in 0..len {
                    for n in 0..N {
                        let place = i * step + n * V::WIDTH;
                        let e = V::load_part(x.add(place), width - n * V::WIDTH).sub(tops[n]).exp_of_negative();
                        if !log {
                            e.store_part(to.add(place), width - n * V::WIDTH);
                        }
                        sums[n] = sums[n].add(e);
                    }
                }
                for n in 0..N {
                    let empty = sums[n].le(V::splat(zero));
                    sums[n] = match log {
                        true => empty.choose(V::splat(zero), sums[n].ln()),
                        false => empty.choose(V::splat(zero), V::splat(one).div(sums[n])),
                    };
                }
                for i in 0..len {
                    for n in 0..N {
                        let (place, width) = (i * step + n * V::WIDTH, width - n * V::WIDTH);
                        let value = match log {
                            true => V::load_part(x.add(place), width).sub(tops[n]).sub(sums[n]),
                            false => V::load_part(to.add(place), width).mul(sums[n]),
                        };
                        value.store_part(to.add(place), width);
                    }
                }
            }
            Pass::Adjoint(y, g) => {
                let (y, g) = (y.as_ptr().add(at), g.as_ptr().add(at));
                let mut sums = [V::splat(zero); N];
                for i in 0..len {
                    for n in 0..N {
                        let (place, width) = (i * step + n * V::WIDTH, width - n * V::WIDTH);
                        sums[n] = V::load_part(y.add(place), width).mul_add(V::load_part(g.add(place), width), sums[n]);
                    }
                }
                for i in 0..len {
                    for n in 0..N {
                        let (place, width) = (i * step + n * V::WIDTH, width - n * V::WIDTH);
                        let slope = V::load_part(g.add(place), width).sub(sums[n]);
                        V::load_part(y.add(place), width).mul(slope).store_part(to.add(place), width);
                    }
                }
            }
        }
    }
}
