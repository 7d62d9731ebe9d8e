//! Pictures moved and scaled within others.

use ndarray::{Array2, Array3};

use crate::video::Frame;
use crate::views::ImageBox;

/// Samples of a pixel along each axis at most, where a picture is shrunk.
const MOST_SAMPLES: usize = 8;

/// A move of a picture's points: `to + scale (x − from)`, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Move {
    pub from: [f64; 2],
    pub to: [f64; 2],
    pub scale: f64,
}

/// The picture moved into one of `[width, height]` pixels, white and empty around it. Of a picture that shrinks, pixels are means of
/// several samples.
pub(super) fn moved(frame: &Frame, by: Move, [width, height]: [usize; 2]) -> Frame {
    let samples = ((1.0 / by.scale).ceil() as usize).clamp(1, MOST_SAMPLES);
    let mut rgb = Array3::ones((height, width, 3));
    let mut alpha = Array2::zeros((height, width));
    let share = 1.0 / (samples * samples) as f32;
    for row in 0..height {
        for column in 0..width {
            let mut sums = [0.0f32; 4];
            for sample in 0..samples * samples {
                let within = [sample % samples, sample / samples].map(|k| (k as f64 + 0.5) / samples as f64);
                let at = [column as f64 + within[0], row as f64 + within[1]];
                let source = [0, 1].map(|axis| by.from[axis] + (at[axis] - by.to[axis]) / by.scale);
                let found = looked_up(frame, source);
                (0..4).for_each(|c| sums[c] += share * found[c]);
            }
            (0..3).for_each(|c| rgb[[row, column, c]] = sums[c]);
            alpha[[row, column]] = sums[3];
        }
    }
    Frame { rgb, alpha, weight: Array2::ones((height, width)) }
}

/// Colour over white and coverage at a point \[pixels\], linear between pixels; white and empty outside.
fn looked_up(frame: &Frame, [u, v]: [f64; 2]) -> [f32; 4] {
    let (height, width) = frame.alpha.dim();
    let (x, y) = (u - 0.5, v - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let mut sums = [0.0f32; 4];
    for (below, beside) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let weight =
            if beside == 1 { x - left } else { 1.0 - (x - left) } * if below == 1 { y - top } else { 1.0 - (y - top) };
        let (column, row) = (left + f64::from(beside), top + f64::from(below));
        let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        let found = if inside {
            let at = (row as usize, column as usize);
            [0, 1, 2].map(|c| frame.rgb[[at.0, at.1, c]]).into_iter().chain([frame.alpha[at]]).collect::<Vec<f32>>()
        } else {
            vec![1.0, 1.0, 1.0, 0.0]
        };
        (0..4).for_each(|c| sums[c] += weight as f32 * found[c]);
    }
    sums
}

/// The picture with nothing but what is in a box, a margin of a pixel included.
pub(super) fn within(frame: &Frame, bounds: &ImageBox) -> Frame {
    let (height, width) = frame.alpha.dim();
    let sides = [width as f64, height as f64];
    let inside = |row: usize, column: usize| {
        [column, row].into_iter().enumerate().all(|(axis, at)| {
            let (low, high) = (bounds.low[axis] * sides[axis] - 1.5, bounds.high[axis] * sides[axis] + 0.5);
            (low..=high).contains(&(at as f64))
        })
    };
    let mut kept = frame.clone();
    for row in 0..height {
        for column in (0..width).filter(|column| !inside(row, *column)) {
            (0..3).for_each(|c| kept.rgb[[row, column, c]] = 1.0);
            kept.alpha[[row, column]] = 0.0;
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::boxes::of_frame;

    fn square(low: [usize; 2], side: usize, size: usize) -> Frame {
        let inside = |y: usize, x: usize| (low[0]..low[0] + side).contains(&x) && (low[1]..low[1] + side).contains(&y);
        Frame {
            rgb: Array3::from_shape_fn((size, size, 3), |(y, x, c)| if inside(y, x) { 0.25 * c as f32 } else { 1.0 }),
            alpha: Array2::from_shape_fn((size, size), |(y, x)| f32::from(u8::from(inside(y, x)))),
            weight: Array2::ones((size, size)),
        }
    }

    #[test]
    fn a_move_takes_the_box_with_it() {
        let frame = square([4, 6], 8, 32);
        let by = Move { from: [8.0, 10.0], to: [40.0, 24.0], scale: 2.0 };
        let found = of_frame(&moved(&frame, by, [64, 48])).unwrap();
        let sides = [64.0, 48.0];
        let [low, high] = [found.low, found.high].map(|end| [end[0] * sides[0], end[1] * sides[1]]);
        assert_eq!((low, high), ([32.0, 16.0], [48.0, 32.0]));
        let same = Move { from: [3.0, 3.0], to: [3.0, 3.0], scale: 1.0 };
        assert_eq!(moved(&frame, same, [32, 32]), frame);
    }

    #[test]
    fn what_shrinks_keeps_its_area_and_its_middle() {
        let frame = square([16, 16], 32, 64);
        let by = Move { from: [32.0; 2], to: [8.0; 2], scale: 0.25 };
        let small = moved(&frame, by, [16, 16]);
        assert!((small.alpha.sum() - 64.0).abs() < 0.5, "{}", small.alpha.sum());
        assert_eq!(of_frame(&small).unwrap().centre(), [0.5; 2]);
    }

    #[test]
    fn what_is_outside_of_the_box_is_not_the_object() {
        let mut frame = square([4, 4], 4, 16);
        frame.alpha[[12, 12]] = 1.0;
        let kept = within(&frame, &of_frame(&square([4, 4], 4, 16)).unwrap());
        assert_eq!((kept.alpha[[5, 5]], kept.alpha[[12, 12]], kept.rgb[[12, 12, 0]]), (1.0, 0.0, 1.0));
    }
}
