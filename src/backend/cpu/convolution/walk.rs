//! The walk of a convolution over a padded image: which taps meet which places, without a branch at the border.
//!
//! A forward convolution is one walk. A transposed one with stride `s` falls apart into up to `s` walks of stride 1 along each
//! axis, one for each [`Phase`].

use rayon::prelude::*;

use crate::backend::cpu::Temporary;
use crate::ops::{Geometry, Phase};
use crate::scalar::Real;

/// A walk along one axis: place `first + i · every` of the result, for `i` below `count`, reads place `i · step + offset` of
/// the padded source for each tap.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    pub(super) count: usize,
    pub(super) first: usize,
    pub(super) every: usize,
    pub(super) step: usize,
    /// Number of the tap in the kernel, and where it reads the padded source for place 0.
    pub(super) taps: Vec<(usize, usize)>,
    /// Places of the source, and zeros in front of and behind them.
    pub(super) source: usize,
    pub(super) before: usize,
    pub(super) after: usize,
}

impl Axis {
    fn forward(g: &Geometry, axis: usize) -> Self {
        let (step, last_tap) = (g.stride[axis], (g.kernel[axis] - 1) * g.dilation[axis]);
        let reach = (g.y[axis] - 1) * step + last_tap + 1;
        Self {
            count: g.y[axis],
            first: 0,
            every: 1,
            step,
            taps: (0..g.kernel[axis]).map(|tap| (tap, tap * g.dilation[axis])).collect(),
            source: g.x[axis],
            before: g.padding[axis],
            after: reach.saturating_sub(g.x[axis] + g.padding[axis]),
        }
    }

    fn transposed(g: &Geometry, axis: usize, phase: Phase) -> Self {
        let (stride, dilation) = (g.stride[axis], g.dilation[axis]);
        let (at, back) = ((phase.first + g.padding[axis]) / stride, |tap: usize| tap * dilation / stride);
        let before = phase.taps.last().map_or(0, |&tap| back(tap).saturating_sub(at));
        let end = phase.taps.first().map_or(0, |&tap| (at + phase.count).saturating_sub(back(tap)));
        Self {
            count: phase.count,
            first: phase.first,
            every: stride,
            step: 1,
            taps: phase.taps.iter().map(|&tap| (tap, before + at - back(tap))).collect(),
            source: g.y[axis],
            before,
            after: end.saturating_sub(g.y[axis]),
        }
    }

    /// The same walk over a source with more zeros around it.
    fn widened(self, before: usize, after: usize) -> Self {
        let more = before - self.before;
        let taps = self.taps.into_iter().map(|(tap, offset)| (tap, offset + more)).collect();
        Self { taps, before, after, ..self }
    }

    /// Places of the padded source.
    pub(super) fn padded(&self) -> usize {
        self.before + self.source + self.after
    }
}

/// The walks of all phases of an axis over one padded source, so that it is padded once.
fn alike(walks: Vec<Axis>) -> Vec<Axis> {
    let most = |zeros: fn(&Axis) -> usize| walks.iter().map(zeros).max().unwrap_or(0);
    let (before, after) = (most(|axis| axis.before), most(|axis| axis.after));
    walks.into_iter().map(|axis| axis.widened(before, after)).collect()
}

/// A walk along all axes.
///
/// The rows of padded planes are combed: pixels that a step along the width apart lie side by side, so that neighbouring
/// places read neighbouring numbers whatever the stride.
#[derive(Debug, Clone)]
pub(super) struct Walk {
    pub(super) axes: [Axis; 3],
    /// Sizes of the result.
    pub(super) result: [usize; 3],
}

/// A tap of a walk: its number in the kernel, and where it reads a padded plane for place 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tap {
    pub(super) number: usize,
    pub(super) offset: usize,
}

impl Walk {
    pub(super) fn forward(g: &Geometry) -> Self {
        Self { axes: [0, 1, 2].map(|axis| Axis::forward(g, axis)), result: g.y }
    }

    pub(super) fn transposed(g: &Geometry) -> Vec<Self> {
        let axes = [0, 1, 2].map(|axis| {
            let walks = g.phases(axis).into_iter().map(|phase| Axis::transposed(g, axis, phase));
            alike(walks.collect())
        });
        let mut walks = Vec::new();
        for d in &axes[0] {
            for h in &axes[1] {
                for w in &axes[2] {
                    walks.push(Self { axes: [d.clone(), h.clone(), w.clone()], result: g.x });
                }
            }
        }
        walks
    }

    /// Places that it visits.
    pub(super) fn count(&self) -> usize {
        self.axes.iter().map(|axis| axis.count).product()
    }

    /// Elements of a padded plane, and distances between its slices and rows.
    pub(super) fn plane(&self) -> (usize, [usize; 2]) {
        let [d, h, w] = [0, 1, 2].map(|axis| self.axes[axis].padded());
        let row = w.next_multiple_of(self.axes[2].step);
        (d * h * row, [h * row, row])
    }

    /// Where a pixel of a padded row lies in the combed row.
    fn combed(&self, w: usize) -> usize {
        let step = self.axes[2].step;
        w % step * (self.axes[2].padded().div_ceil(step)) + w / step
    }

    pub(super) fn taps(&self, kernel: [usize; 3]) -> Vec<Tap> {
        let (_, [slice, row]) = self.plane();
        let mut taps = Vec::new();
        for &(d, at_d) in &self.axes[0].taps {
            for &(h, at_h) in &self.axes[1].taps {
                for &(w, at_w) in &self.axes[2].taps {
                    let number = (d * kernel[1] + h) * kernel[2] + w;
                    taps.push(Tap { number, offset: at_d * slice + at_h * row + self.combed(at_w) });
                }
            }
        }
        taps
    }

    /// Where the row `(d, h)` of places begins in a padded plane, and in a plane of the result.
    pub(super) fn row(&self, d: usize, h: usize) -> (usize, usize) {
        let (_, [slice, row]) = self.plane();
        let [depth, height, width] = &self.axes;
        let at = [depth.first + d * depth.every, height.first + h * height.every];
        let to = (at[0] * self.result[1] + at[1]) * self.result[2] + width.first;
        (d * depth.step * slice + h * height.step * row, to)
    }

    /// Whether the places of the result are all places, in order.
    pub(super) fn is_dense(&self) -> bool {
        self.axes.iter().all(|axis| axis.every == 1)
    }

    /// The planes of the source with its zeros around them, unless there are none.
    pub(super) fn pad<'a, T: Real>(&self, planes: &'a [T]) -> Padded<'a, T> {
        let step = self.axes[2].step;
        if step == 1 && self.axes.iter().all(|axis| axis.before == 0 && axis.after == 0) {
            return Padded::Same(planes);
        }
        let [d, h, w] = [0, 1, 2].map(|axis| self.axes[axis].source);
        let (len, [slice, row]) = self.plane();
        let mut padded = Temporary::new(planes.len() / (d * h * w) * len);
        padded.par_chunks_mut(len).zip(planes.par_chunks(d * h * w)).for_each(|(to, from)| {
            to.fill(T::ZERO);
            for i in 0..d {
                for j in 0..h {
                    let at = (i + self.axes[0].before) * slice + (j + self.axes[1].before) * row;
                    let (to, from) = (&mut to[at..at + row], &from[(i * h + j) * w..][..w]);
                    if step == 1 {
                        to[self.axes[2].before..][..w].copy_from_slice(from);
                        continue;
                    }
                    for first in 0..step.min(w) {
                        let to = &mut to[self.combed(first + self.axes[2].before)..];
                        from[first..].iter().step_by(step).zip(to).for_each(|(value, to)| *to = *value);
                    }
                }
            }
        });
        Padded::Copy(padded)
    }
}

/// Planes of a source.
pub(super) enum Padded<'a, T: Real> {
    Same(&'a [T]),
    Copy(Temporary<T>),
}

impl<T: Real> std::ops::Deref for Padded<'_, T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match self {
            Self::Same(planes) => planes,
            Self::Copy(planes) => planes,
        }
    }
}
