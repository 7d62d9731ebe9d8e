//! The nodes around a point, their weights, and the weights' slopes.

use crate::ops::grid::Placement;
use crate::scalar::Real;

/// One axis of the grid, in the working precision.
#[derive(Clone, Copy)]
struct Axis<T> {
    component: usize,
    stride: usize,
    last: usize,
    end: T,
    origin: T,
    scale: T,
    shift: T,
}

/// How points of `D` coordinates relate to a grid, each with `K` nodes around it: `2ᴰ`, or 1 for the nearest.
pub(super) struct Cells<T, const D: usize, const K: usize> {
    axes: [Axis<T>; D],
    border: bool,
}

/// What one coordinate says: the two nodes along its axis (as offsets), their weights, and those weights' slopes. A node
/// outside has weight and slope 0 and the offset of its neighbour.
#[derive(Clone, Copy)]
pub(super) struct Hat<T> {
    offset: [usize; 2],
    weight: [T; 2],
    slope: [T; 2],
    /// The lower node's number plus one, so that the one before the first is 0.
    key: usize,
}

impl<T: Real, const D: usize, const K: usize> Cells<T, D, K> {
    pub(super) fn new(place: &Placement) -> Self {
        let real = T::from_f64;
        let mut stride: usize = place.axes.iter().map(|axis| axis.size).product();
        let axes = std::array::from_fn(|i| {
            let axis = &place.axes[i];
            stride /= axis.size;
            Axis {
                component: axis.component,
                stride,
                last: axis.size - 1,
                end: real((axis.size - 1) as f64),
                origin: real(axis.origin),
                scale: real(axis.scale),
                shift: real(axis.shift),
            }
        });
        Self { axes, border: place.border }
    }

    /// Number of nodes along the slowest axis.
    pub(super) fn planes(&self) -> usize {
        self.axes[0].last + 1
    }

    /// Number of nodes in one plane across the slowest axis.
    pub(super) fn plane(&self) -> usize {
        self.axes[0].stride
    }

    /// The number of the lower of a point's two planes, plus one; `None` where no node is near.
    pub(super) fn key(&self, point: &[T]) -> Option<usize> {
        self.hat(0, point, poison(point)).map(|hat| hat.key)
    }

    #[inline(always)]
    fn hat(&self, axis: usize, point: &[T], poison: T) -> Option<Hat<T>> {
        let Axis { component, stride, last, end, origin, scale, shift } = self.axes[axis];
        let mut g = (point[component] - origin) * scale + shift;
        let mut slope = scale;
        if self.border {
            if g <= T::ZERO {
                (g, slope) = (T::ZERO, T::ZERO);
            } else if g >= end {
                (g, slope) = (end, T::ZERO);
            }
        }
        g += poison;
        let (floor, lowest) = if K == 1 { (nearest(g), T::ZERO) } else { (g.floor(), -T::ONE) };
        if floor < lowest || floor > end {
            return None;
        }
        let base = floor.to_f64() as isize; // 0 for NaN
        let f = g - floor;
        let (mut weight, mut slopes) = ([T::ONE - f, f], [-slope, slope]);
        if K == 1 {
            // the same number for every place in the cell; NaN for NaN
            let nothing = if f.is_nan() { f } else { T::ZERO };
            (weight, slopes) = ([T::ONE + nothing, T::ZERO], [nothing, T::ZERO]);
        }
        // −1 for the lower node wraps around, and is replaced below
        let mut offset = [(base as usize).wrapping_mul(stride), (base + 1) as usize * stride];
        if base < 0 {
            (weight[0], slopes[0], offset[0]) = (T::ZERO, T::ZERO, offset[1]);
        }
        if base >= last as isize {
            (weight[1], slopes[1], offset[1]) = (T::ZERO, T::ZERO, offset[0]);
        }
        Some(Hat { offset, weight, slope: slopes, key: (base + 1) as usize })
    }

    #[inline(always)]
    fn hats(&self, point: &[T]) -> Option<[Hat<T>; D]> {
        let none = Hat { offset: [0; 2], weight: [T::ZERO; 2], slope: [T::ZERO; 2], key: 0 };
        let mut hats = [none; D];
        let poison = poison(point);
        for axis in 0..D {
            hats[axis] = self.hat(axis, point, poison)?;
        }
        Some(hats)
    }

    /// The offsets of the nodes around a point and their weights; `None` where no node is near.
    #[inline(always)]
    pub(super) fn weights(&self, point: &[T]) -> Option<([usize; K], [T; K])> {
        let hats = self.hats(point)?;
        let (mut offsets, mut weights) = ([0; K], [T::ONE; K]);
        for corner in 0..K {
            for axis in 0..D {
                let side = side::<D>(corner, axis);
                offsets[corner] += hats[axis].offset[side];
                weights[corner] *= hats[axis].weight[side];
            }
        }
        Some((offsets, weights))
    }

    /// The offsets of the nodes around a point, and their weights' derivatives with respect to its components.
    #[inline(always)]
    pub(super) fn slopes(&self, point: &[T]) -> Option<([usize; K], [[T; D]; K])> {
        let hats = self.hats(point)?;
        let (mut offsets, mut slopes) = ([0; K], [[T::ONE; D]; K]);
        for corner in 0..K {
            for axis in 0..D {
                let side = side::<D>(corner, axis);
                offsets[corner] += hats[axis].offset[side];
                for along in 0..D {
                    let factor = if along == axis { hats[axis].slope[side] } else { hats[axis].weight[side] };
                    slopes[corner][self.axes[along].component] *= factor;
                }
            }
        }
        Some((offsets, slopes))
    }
}

/// 0, or NaN for a point with a component that is not finite. Added to all its coordinates, it puts the point into the
/// first cell with weights of NaN.
#[inline(always)]
fn poison<T: Real>(point: &[T]) -> T {
    // 0 · x is 0, or NaN where x is not finite
    let mut sum = T::ZERO;
    for x in point {
        sum += T::ZERO * *x;
    }
    sum
}

/// On which side of a cell a corner lies along an axis: the slowest axis is the highest bit.
#[inline(always)]
fn side<const D: usize>(corner: usize, axis: usize) -> usize {
    corner >> (D - 1 - axis) & 1
}

/// The nearest whole number, the even one of two.
#[inline(always)]
fn nearest<T: Real>(x: T) -> T {
    let half = T::from_f64(0.5);
    let up = (x + half).floor();
    let over = up - x;
    let even = (up * half).floor() * T::from_f64(2.0) == up;
    if over > half || (over == half && !even) { up - T::ONE } else { up }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn halves_go_to_the_even_neighbour() {
        for x in [-2.5f32, -1.5, -0.5, 0.5, 1.5, 2.5, 0.499_999_97, 0.3, -0.7, 7.0, 8_388_609.0] {
            assert_eq!(nearest(x), x.round_ties_even(), "{x}");
        }
        assert!(nearest(f32::NAN).is_nan());
    }
}
