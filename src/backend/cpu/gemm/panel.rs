//! Where the factors of a product come from.

use std::ops::Range;

use crate::backend::cpu::prefetch;
use crate::scalar::{Job, Lane, Path, Real};

/// Places along the depth by which lines that lie side by side are asked for ahead of their use.
const ROWS_AHEAD: usize = 24;
/// The same where many strips are packed together.
const ROWS_BELOW: usize = 4;

/// One factor of a product, read as lines along the depth: a left factor's lines are its rows, a right factor's are its
/// columns, and both are summed over the depth.
///
/// The product asks for strips of a few lines, so that a factor need not exist as a matrix: a convolution packs its
/// patches straight from the image.
pub(crate) trait Panel<T>: Sync {
    /// Copies some lines over a range of the depth, so that the lines lie side by side:
    /// `into[(d − depth.start) · width + (l − lines.start)] = value(l, d)`.
    ///
    /// `into` holds `depth.len() · width` values and `lines.len() ≤ width`; what it puts at the places between
    /// `lines.len()` and `width` has no effect.
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]);

    /// Packs many lines: strips of `width` lines one after another, the last one as wide as the vectors that its lines
    /// fill.
    fn pack_strips(&self, lines: Range<usize>, depth: Range<usize>, [width, vector]: [usize; 2], into: &mut [T]) {
        each_strip(self, lines, depth, [width, vector], into);
    }

    /// Strips that were packed before, as [`Panel::pack_strips`] would pack them now.
    fn packed(&self, _lines: &Range<usize>, _depth: &Range<usize>) -> Option<&[T]> {
        None
    }

    /// The factor itself where it lies in memory at fixed distances, which may save packing it.
    fn strided(&self) -> Option<Strided<'_, T>> {
        None
    }
}

/// Packs lines strip by strip.
fn each_strip<T>(
    panel: &(impl Panel<T> + ?Sized),
    lines: Range<usize>,
    depth: Range<usize>,
    [width, vector]: [usize; 2],
    into: &mut [T],
) {
    for start in (0..lines.len()).step_by(width) {
        let strip = lines.start + start..lines.end.min(lines.start + start + width);
        let reach = strip.len().next_multiple_of(vector);
        panel.pack(strip, depth.clone(), reach, &mut into[start * depth.len()..][..reach * depth.len()]);
    }
}

/// A matrix in memory: element `(l, d)` is `values[l · line + d · depth]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strided<'a, T> {
    /// The numbers, from element `(0, 0)` on.
    pub(crate) values: &'a [T],
    /// The distance between lines.
    pub(crate) line: usize,
    /// The distance between neighbours along the depth.
    pub(crate) depth: usize,
}

impl<'a, T: Real> Strided<'a, T> {
    /// A factor whose lines each lie together, `length` values apart: the left factor `[m, k]` with `length = k`, or a
    /// right factor that is kept transposed, `[n, k]`.
    pub(crate) fn lines(values: &'a [T], length: usize) -> Self {
        Self { values, line: length, depth: 1 }
    }

    /// A factor whose neighbouring lines lie side by side, `count` of them: the right factor `[k, n]` with `count = n`,
    /// or a left factor that is kept transposed, `[k, m]`.
    pub(crate) fn side_by_side(values: &'a [T], count: usize) -> Self {
        Self { values, line: 1, depth: count }
    }
}

impl<T: Real> Panel<T> for Strided<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        assert!(lines.len() <= width && into.len() == depth.len() * width, "a strip does not fit");
        if lines.is_empty() || depth.is_empty() {
            return;
        }
        let last = (lines.end - 1) * self.line + (depth.end - 1) * self.depth;
        assert!(last < self.values.len(), "a factor is too short");
        let job = CopyStrip { from: *self, lines, depth, width, into };
        // SAFETY: the best path is available, and the sizes were checked above.
        unsafe { T::dispatch(Path::best(), job) }
    }

    fn pack_strips(&self, lines: Range<usize>, depth: Range<usize>, [width, vector]: [usize; 2], into: &mut [T]) {
        let whole = if self.line == 1 && width.is_multiple_of(vector) { lines.len() / width * width } else { 0 };
        let (rows, rest) = into.split_at_mut(whole * depth.len());
        if !rows.is_empty() {
            let last = (depth.end - 1) * self.depth + lines.start + whole;
            assert!(last <= self.values.len(), "a factor is too short");
            let job = CopyRows { from: *self, first: lines.start, depth: depth.clone(), width, into: rows };
            // SAFETY: the best path is available, a vector of it divides a strip's width, and the sizes were checked above.
            unsafe { T::dispatch(Path::best(), job) };
        }
        each_strip(self, lines.start + whole..lines.end, depth, [width, vector], rest);
    }

    fn strided(&self) -> Option<Strided<'_, T>> {
        Some(*self)
    }
}

/// Packs whole strips of lines that lie side by side, all strips of one place along the depth before the next place: what
/// is read lies together.
struct CopyRows<'a, 'b, T> {
    from: Strided<'a, T>,
    first: usize,
    depth: Range<usize>,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for CopyRows<'_, '_, T> {
    type Output = ();

    /// # Safety
    /// The matrix must reach as far as the strips and the depth, and a strip must be whole vectors wide.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { from, first, depth, width, into } = self;
        let strip = width * depth.len();
        for (i, d) in depth.enumerate() {
            let row = from.values.as_ptr().wrapping_add(d * from.depth + first);
            for start in 0..into.len() / strip {
                let mut v = 0;
                while v < width {
                    let at = row.wrapping_add(start * width + v);
                    prefetch::to_read::<false, T>(at.wrapping_add(ROWS_BELOW * from.depth));
                    // SAFETY: the caller's promise.
                    unsafe { V::load(at).store(into.as_mut_ptr().add(start * strip + i * width + v)) };
                    v += V::WIDTH;
                }
            }
        }
    }
}

/// Packs a strip of a matrix in memory by whole vectors or squares. Their stores may reach beyond a row of the strip, into
/// the next one, which is written afterwards; at the end of the strip, elements are copied one by one.
struct CopyStrip<'a, 'b, T> {
    from: Strided<'a, T>,
    lines: Range<usize>,
    depth: Range<usize>,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for CopyStrip<'_, '_, T> {
    type Output = ();

    /// # Safety
    /// The matrix must reach as far as the lines and the depth, and the strip must be as long as both ask for.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        // SAFETY: the caller's promise.
        unsafe {
            match (self.from.line, self.from.depth) {
                (1, _) => self.rows::<V>(),
                (_, 1) => self.squares::<V>(),
                _ => {
                    let first = self.depth.start;
                    self.elements(first);
                }
            }
        }
    }
}

impl<T: Real> CopyStrip<'_, '_, T> {
    /// Copies what lies at `first` and behind along the depth, element by element.
    #[inline(always)]
    unsafe fn elements(self, first: usize) {
        for d in first..self.depth.end {
            for l in 0..self.lines.len() {
                let at = (self.lines.start + l) * self.from.line + d * self.from.depth;
                // SAFETY: the promise of `run`.
                unsafe {
                    *self.into.get_unchecked_mut((d - self.depth.start) * self.width + l) =
                        *self.from.values.get_unchecked(at);
                }
            }
        }
    }

    /// Lines that lie side by side: a short copy for each place along the depth.
    #[inline(always)]
    unsafe fn rows<V: Lane<Element = T>>(self) {
        let reach = self.lines.len().next_multiple_of(V::WIDTH);
        let mut d = self.depth.start;
        while d < self.depth.end {
            let (at, to) = (d * self.from.depth + self.lines.start, (d - self.depth.start) * self.width);
            if at + reach > self.from.values.len() || to + reach > self.into.len() {
                break;
            }
            let mut i = 0;
            while i < reach {
                // SAFETY: both ends were checked above.
                unsafe {
                    let from = self.from.values.as_ptr().add(at + i);
                    prefetch::to_read::<false, T>(from.wrapping_add(ROWS_AHEAD * self.from.depth));
                    V::load(from).store(self.into.as_mut_ptr().add(to + i));
                }
                i += V::WIDTH;
            }
            d += 1;
        }
        // SAFETY: the promise of `run`.
        unsafe { self.elements(d) }
    }

    /// Lines that each lie together: squares of a few lines are transposed, the last lines first, so that what they
    /// store beyond their row is written over.
    #[inline(always)]
    unsafe fn squares<V: Lane<Element = T>>(self) {
        let lines = self.lines.len();
        let reach = lines.next_multiple_of(V::SIDE);
        let mut d = self.depth.start;
        while d + V::SIDE <= self.depth.end {
            let to = (d - self.depth.start) * self.width;
            if to + (V::SIDE - 1) * self.width + reach > self.into.len() {
                break;
            }
            let mut first = reach;
            while first > 0 {
                first -= V::SIDE;
                let mut rows = [self.from.values.as_ptr(); 8];
                for r in 0..V::SIDE {
                    // lines beyond the last one are copies of it
                    let line = if first + r < lines { first + r } else { lines - 1 };
                    rows[r] = rows[r].wrapping_add((self.lines.start + line) * self.from.line + d);
                    prefetch::to_read::<false, T>(rows[r].wrapping_add(256 / size_of::<T>()));
                }
                // SAFETY: the lines reach to the end of this square by the promise of `run`, and the strip does, too.
                unsafe { V::transpose(&rows, self.into.as_mut_ptr().add(to + first), self.width) };
            }
            d += V::SIDE;
        }
        // SAFETY: the promise of `run`.
        unsafe { self.elements(d) }
    }
}
