//! Normalisation of runs of elements: group norm and layer norm are the same loops under two layouts.
//!
//! The mean is found in two passes: the second one sums the distances to the mean of the first and their squares, so that
//! neither a large mean nor a tiny spread costs digits. It is kept as a sum of two numbers for the same reason. Sums are
//! in `f64` over blocks that are added up in vectors.

use rayon::prelude::*;

use super::{Places, buffer, vectorised};
use crate::Element;
use crate::scalar::{Job, Lane, Real};

/// What is normalised together, and which parameter belongs to an element.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    /// Number of runs of elements that are normalised together.
    pub groups: usize,
    /// Elements of a run.
    pub len: usize,
    /// Neighbouring elements that share a parameter.
    pub inner: usize,
    /// Number of parameters; element `i` of the tensor has number `i / inner mod parameters`.
    pub parameters: usize,
}

/// Scale and shift of each parameter number; nothing for 1 and 0.
pub(crate) type Affine<'a, T> = Option<[&'a [T]; 2]>;

/// The forward pass.
#[derive(Clone, Copy)]
pub(crate) struct Normalise<'a, T> {
    pub layout: Layout,
    pub x: &'a [T],
    pub affine: Affine<'a, T>,
    pub epsilon: f64,
    /// Whether `z · logistic(z)` of the normalised element `z` is wanted in its place.
    pub silu: bool,
}

/// Mean in two parts and reciprocal standard deviation of a run.
type Statistics<T> = [T; 3];

/// Cotangents of the operand, of scale and of shift.
pub(crate) struct Cotangents<T> {
    pub x: Vec<T>,
    pub affine: Option<[Vec<T>; 2]>,
}

/// Elements whose sums stay in `T` before they are added to an `f64`.
const BLOCK: usize = 4096;

/// Work items that runs are dealt to where each has sums of its own.
const ITEMS: usize = 32;

impl<T: Real> Normalise<'_, T> {
    /// # Panics
    /// When the operand, scale or shift is not of the layout.
    fn check(&self) {
        let Layout { groups, len, inner, parameters } = self.layout;
        assert_eq!(self.x.len(), groups * len, "the operand of a normalisation does not fit");
        let whole = inner > 0 && len.is_multiple_of(inner) && parameters > 0 && parameters.is_multiple_of(len / inner);
        assert!(self.x.is_empty() || whole, "parameters of a normalisation do not fit its runs");
        let affine = self.affine.is_none_or(|both| both.iter().all(|values| values.len() == parameters));
        assert!(affine, "scale and shift of a normalisation do not fit");
    }

    /// The result, and for each run its mean in two parts and its reciprocal standard deviation.
    pub(crate) fn forward(self) -> (Vec<T>, Vec<T>) {
        self.check();
        let Layout { groups, len, .. } = self.layout;
        let mut y = buffer::<T>(self.x.len());
        let mut statistics = vec![T::ZERO; 3 * groups];
        if y.is_empty() {
            return (y, statistics);
        }
        let runs = (BLOCK / len).max(1);
        let items = y.par_chunks_mut(runs * len).zip(statistics.par_chunks_mut(3 * runs)).enumerate();
        items.for_each(|(item, (y, statistics))| {
            // SAFETY: operand and parameters are of the layout; the item has whole runs.
            unsafe { vectorised(Forward { of: self, first: item * runs, y, statistics }) }
        });
        (y, statistics)
    }

    /// Cotangents from that of the result and the statistics of the forward pass.
    pub(crate) fn backward(self, statistics: &[T], g: &[T]) -> Cotangents<T> {
        self.check();
        assert_eq!(g.len(), self.x.len(), "the cotangent of a normalisation does not fit");
        let Layout { groups, len, inner, parameters } = self.layout;
        let mut dx = buffer::<T>(self.x.len());
        let mut affine = self.affine.map(|_| [vec![T::ZERO; parameters], vec![T::ZERO; parameters]]);
        if dx.is_empty() {
            return Cotangents { x: dx, affine };
        }
        // Each item has one sum for each parameter number in a run, for scale and shift, added up over the item's runs.
        let per_run = len / inner;
        let runs = if inner == 1 && per_run == parameters { groups.div_ceil(ITEMS) } else { 1 };
        let items = groups.div_ceil(runs);
        let row = if affine.is_some() { 2 * per_run } else { 0 };
        let mut sums = vec![T::ZERO; items * row];
        let (to, shares) = (Places::of(&mut dx), Places::of(&mut sums));
        (0..items).into_par_iter().for_each(|item| {
            // SAFETY: the items' rows lie within `sums` and do not overlap.
            let sums = unsafe { shares.part(item * row, row) };
            for group in item * runs..((item + 1) * runs).min(groups) {
                // SAFETY: the runs lie within `dx` and do not overlap.
                let dx = unsafe { to.part(group * len, len) };
                let statistics = std::array::from_fn(|i| statistics[3 * group + i]);
                // SAFETY: operands and parameters are of the layout; `sums` has a share for each parameter, or none.
                unsafe { vectorised(Backward { of: self, group, statistics, g, dx, sums }) };
            }
        });
        for totals in affine.iter_mut() {
            for (item, rows) in sums.chunks(2 * per_run).enumerate() {
                let first = self.first_parameter(item * runs);
                for (total, row) in totals.iter_mut().zip(rows.chunks(per_run)) {
                    total[first..first + per_run].iter_mut().zip(row).for_each(|(total, x)| *total += *x);
                }
            }
        }
        Cotangents { x: dx, affine }
    }

    /// Number of the first parameter of a run.
    fn first_parameter(&self, group: usize) -> usize {
        group * self.layout.len / self.layout.inner % self.layout.parameters
    }
}

/// Some runs, one after the other.
struct Forward<'a, T> {
    of: Normalise<'a, T>,
    first: usize,
    y: &'a mut [T],
    statistics: &'a mut [T],
}

impl<T: Real> Job<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Layout { len, inner, .. } = self.of.layout;
        let rows = if inner == 1 { 1 } else { len / inner };
        let width = len / rows;
        for number in 0..self.y.len() / len {
            let group = self.first + number;
            let x = &self.of.x[group * len..][..len];
            let first = self.of.first_parameter(group);
            // SAFETY: rows lie within the run.
            unsafe {
                let statistics = statistics::<V>(x, self.of.epsilon);
                self.statistics[3 * number..][..3].copy_from_slice(&statistics);
                for row in 0..rows {
                    let line = Line { x: x.as_ptr().add(row * width), width, statistics };
                    let affine = RowAffine::new(self.of.affine, first + row, inner == 1);
                    let y = self.y.as_mut_ptr().add(number * len + row * width);
                    match self.of.silu {
                        true => line.write::<V, true>(affine, y),
                        false => line.write::<V, false>(affine, y),
                    }
                }
            }
        }
    }
}

/// Mean and reciprocal standard deviation.
#[inline(always)]
unsafe fn statistics<V: Lane>(x: &[V::Element], epsilon: f64) -> Statistics<V::Element> {
    // SAFETY: as the caller.
    unsafe {
        let count = x.len() as f64;
        let near = V::Element::from_f64(sums::<V>(x, V::Element::ZERO)[0] / count);
        let [first, second] = sums::<V>(x, near);
        let rest = first / count;
        let variance = second / count - rest * rest;
        [near, V::Element::from_f64(rest), V::Element::from_f64(1.0 / (variance + epsilon).sqrt())]
    }
}

/// Sums of the distances to a number and of their squares.
#[inline(always)]
unsafe fn sums<V: Lane>(x: &[V::Element], from: V::Element) -> [f64; 2] {
    const GROUP: usize = 4;
    let mut totals = [0.0; 2];
    let mut block = 0;
    // SAFETY: blocks lie within the slice.
    unsafe {
        let from = V::splat(from);
        while block < x.len() {
            let (at, width) = (x.as_ptr().add(block), BLOCK.min(x.len() - block));
            let mut firsts = [V::splat(V::Element::ZERO); GROUP];
            let mut seconds = firsts;
            let whole = width - width % (GROUP * V::WIDTH);
            let mut i = 0;
            while i < whole {
                for k in 0..GROUP {
                    let d = V::load(at.add(i + k * V::WIDTH)).sub(from);
                    firsts[k] = firsts[k].add(d);
                    seconds[k] = d.mul_add(d, seconds[k]);
                }
                i += GROUP * V::WIDTH;
            }
            let mut rest = [V::Element::ZERO; 16];
            while i < width {
                let count = V::WIDTH.min(width - i);
                V::load_part(at.add(i), count).sub(from).store(rest.as_mut_ptr());
                rest[count..].fill(V::Element::ZERO);
                let d = V::load(rest.as_ptr());
                firsts[0] = firsts[0].add(d);
                seconds[0] = d.mul_add(d, seconds[0]);
                i += count;
            }
            totals[0] += firsts[0].add(firsts[1]).add(firsts[2].add(firsts[3])).total().to_f64();
            totals[1] += seconds[0].add(seconds[1]).add(seconds[2].add(seconds[3])).total().to_f64();
            block += BLOCK;
        }
    }
    totals
}

/// Scale and shift along a row: the same for all its elements, or one each.
#[derive(Clone, Copy)]
enum RowAffine<T> {
    Same(T, T),
    Each(*const T, *const T),
}

impl<T: Real> RowAffine<T> {
    #[inline(always)]
    fn new(affine: Affine<'_, T>, first: usize, each: bool) -> Self {
        match affine {
            None => Self::Same(T::ONE, T::ZERO),
            Some([scale, shift]) if each => Self::Each(scale[first..].as_ptr(), shift[first..].as_ptr()),
            Some([scale, shift]) => Self::Same(scale[first], shift[first]),
        }
    }

    /// Scale and shift of `count` elements from `at` on.
    #[inline(always)]
    unsafe fn load<V: Lane<Element = T>>(self, at: usize, count: usize) -> (V, V) {
        // SAFETY: as the caller.
        unsafe {
            match self {
                Self::Same(scale, shift) => (V::splat(scale), V::splat(shift)),
                Self::Each(scale, shift) => (V::load_part(scale.add(at), count), V::load_part(shift.add(at), count)),
            }
        }
    }
}

/// Neighbouring elements of a run.
#[derive(Clone, Copy)]
struct Line<T> {
    x: *const T,
    width: usize,
    statistics: Statistics<T>,
}

impl<T: Real> Line<T> {
    #[inline(always)]
    unsafe fn normalised<V: Lane<Element = T>>(self, at: usize) -> V {
        let [near, rest, reciprocal] = self.statistics;
        // SAFETY: as the caller.
        unsafe {
            let x = V::load_part(self.x.add(at), self.width - at);
            x.sub(V::splat(near)).sub(V::splat(rest)).mul(V::splat(reciprocal))
        }
    }

    #[inline(always)]
    unsafe fn write<V: Lane<Element = T>, const SILU: bool>(self, affine: RowAffine<T>, y: *mut T) {
        let mut at = 0;
        while at < self.width {
            // SAFETY: as the caller.
            unsafe {
                let (scale, shift) = affine.load::<V>(at, self.width - at);
                let mut z = self.normalised::<V>(at).mul_add(scale, shift);
                if SILU {
                    z = z.mul(z.logistic());
                }
                z.store_part(y.add(at), self.width - at);
            }
            at += V::WIDTH;
        }
    }
}

struct Backward<'a, T> {
    of: Normalise<'a, T>,
    group: usize,
    statistics: Statistics<T>,
    g: &'a [T],
    dx: &'a mut [T],
    /// Shares of the cotangents of scale and shift, which are added to; empty where nobody wants them.
    sums: &'a mut [T],
}

impl<T: Real> Job<T> for Backward<'_, T> {
    type Output = ();

    /// With the normalised `n`, the cotangent `c` of `z = scale · n + shift`, and means over the run:
    /// `dx = (scale c − mean(scale c) − n mean(scale c n)) / deviation`. `c` is kept in `dx` between the passes.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Layout { len, inner, .. } = self.of.layout;
        let first = self.of.first_parameter(self.group);
        let each = inner == 1;
        let rows = if each { 1 } else { len / inner };
        let width = len / rows;
        let mut means = [0.0; 2];
        // SAFETY: rows lie within the run.
        unsafe {
            let x = self.of.x.as_ptr().add(self.group * len);
            let g = self.g.as_ptr().add(self.group * len);
            for row in 0..rows {
                let line = Line { x: x.add(row * width), width, statistics: self.statistics };
                let affine = RowAffine::new(self.of.affine, first + row, each);
                let (g, dx) = (g.add(row * width), self.dx.as_mut_ptr().add(row * width));
                let scale_sums = match (each, self.sums.is_empty()) {
                    (true, false) => self.sums.as_mut_ptr(),
                    _ => std::ptr::null_mut(),
                };
                let sums = match self.of.silu {
                    true => line.gather::<V, true>(affine, g, dx, scale_sums),
                    false => line.gather::<V, false>(affine, g, dx, scale_sums),
                };
                match affine {
                    RowAffine::Same(scale, _) => {
                        let scale = scale.to_f64();
                        means[0] += scale * sums[0];
                        means[1] += scale * sums[1];
                        if !each && !self.sums.is_empty() {
                            self.sums[row] += T::from_f64(sums[1]);
                            self.sums[rows + row] += T::from_f64(sums[0]);
                        }
                    }
                    RowAffine::Each(..) => {
                        means[0] += sums[0];
                        means[1] += sums[1];
                    }
                }
            }
            let count = len as f64;
            let (mean, slope) = (V::splat(T::from_f64(means[0] / count)), V::splat(T::from_f64(means[1] / count)));
            let reciprocal = V::splat(self.statistics[2]);
            for row in 0..rows {
                let line = Line { x: x.add(row * width), width, statistics: self.statistics };
                let affine = RowAffine::new(self.of.affine, first + row, each);
                let (g, dx) = (g.add(row * width), self.dx.as_mut_ptr().add(row * width));
                // without SiLU the cotangent of z is g itself
                let from = if self.of.silu { dx.cast_const() } else { g };
                let mut at = 0;
                while at < width {
                    let (scale, _) = affine.load::<V>(at, width - at);
                    let centred = V::load_part(from.add(at), width - at).mul_sub(scale, mean);
                    let slopes = line.normalised::<V>(at).neg_mul_add(slope, centred);
                    slopes.mul(reciprocal).store_part(dx.add(at), width - at);
                    at += V::WIDTH;
                }
            }
        }
    }
}

impl<T: Real> Line<T> {
    /// Sums of the cotangents of `z` and of their products with the normalised elements: times the scale where each element
    /// has its own, in which case the parameters' shares are added to `shares` (scales first) unless it is null.
    #[inline(always)]
    unsafe fn gather<V: Lane<Element = T>, const SILU: bool>(
        self,
        affine: RowAffine<T>,
        g: *const T,
        dx: *mut T,
        shares: *mut T,
    ) -> [f64; 2] {
        let mut totals = [0.0; 2];
        let each = matches!(affine, RowAffine::Each(..));
        let mut block = 0;
        // SAFETY: as the caller.
        unsafe {
            while block < self.width {
                let end = self.width.min(block + BLOCK);
                let (mut firsts, mut seconds) = (V::splat(T::ZERO), V::splat(T::ZERO));
                let mut at = block;
                while at < end {
                    let left = self.width - at;
                    let (scale, shift) = affine.load::<V>(at, left);
                    let n = self.normalised::<V>(at);
                    let mut c = V::load_part(g.add(at), left);
                    if SILU {
                        let z = n.mul_add(scale, shift);
                        let s = z.logistic();
                        // d(z s)/dz = s (1 + z (1 − s))
                        let bend = z.mul(V::splat(T::ONE).sub(s));
                        c = c.mul(s.mul_add(bend, s));
                        c.store_part(dx.add(at), left);
                    }
                    let product = c.mul(n);
                    if each {
                        if !shares.is_null() {
                            let (for_scale, for_shift) = (shares.add(at), shares.add(self.width + at));
                            V::load_part(for_scale, left).add(product).store_part(for_scale, left);
                            V::load_part(for_shift, left).add(c).store_part(for_shift, left);
                        }
                        firsts = c.mul_add(scale, firsts);
                        seconds = product.mul_add(scale, seconds);
                    } else {
                        firsts = firsts.add(c);
                        seconds = seconds.add(product);
                    }
                    at += V::WIDTH;
                }
                totals[0] += firsts.total().to_f64();
                totals[1] += seconds.total().to_f64();
                block += BLOCK;
            }
        }
        totals
    }
}
