//! First-order recurrences along an axis.

use rayon::prelude::*;

use super::strided::Places;
use super::{CHUNK, Work, buffer, widest};
use crate::scalar::Real;

/// Neighbouring lines walked together.
const LINES: usize = 128;

/// `yᵢ = aᵢ yᵢ₋₁ + bᵢ` along the middle axis of `[outer, len, inner]`, starting from `y₀ = b₀` or, in reverse, from the
/// end; without `a`, running sums. States are kept in `f64`.
pub(crate) fn scan<T: Real>(a: Option<&[T]>, b: &[T], [outer, len, inner]: [usize; 3], reverse: bool) -> Vec<T> {
    let mut result = buffer(b.len());
    if b.is_empty() {
        return result;
    }
    let y = Places::of(&mut result);
    let tiles = inner.div_ceil(LINES);
    let unit = |unit: usize| {
        let (row, first) = (unit / tiles * len, unit % tiles * LINES);
        let lines = LINES.min(inner - first);
        let work = Lines { a, b, y, start: row * inner + first, len, inner, lines, reverse };
        if lines == 1 { work.run() } else { widest(work) }
    };
    let together = (CHUNK / (len * inner.min(LINES))).max(1);
    (0..outer * tiles).into_par_iter().with_min_len(together).for_each(unit);
    result
}

/// Neighbouring lines.
struct Lines<'a, T> {
    a: Option<&'a [T]>,
    b: &'a [T],
    y: Places<T>,
    start: usize,
    len: usize,
    inner: usize,
    lines: usize,
    reverse: bool,
}

impl<T: Real> Work for Lines<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { a, b, y, start, len, inner, lines, reverse } = self;
        let mut states = [0.0; LINES];
        let mut step = 0;
        while step < len {
            let at = start + if reverse { len - 1 - step } else { step } * inner;
            let values = &b[at..at + lines];
            let mut line = 0;
            match a.filter(|_| step > 0).map(|a| &a[at..at + lines]) {
                Some(factors) => {
                    while line < lines {
                        states[line] = factors[line].to_f64() * states[line] + values[line].to_f64();
                        line += 1;
                    }
                }
                None => {
                    while line < lines {
                        states[line] += values[line].to_f64();
                        line += 1;
                    }
                }
            }
            line = 0;
            while line < lines {
                // SAFETY: every place belongs to one line, and every line to one unit.
                unsafe { y.write(at + line, T::from_f64(states[line])) };
                line += 1;
            }
            step += 1;
        }
    }
}
