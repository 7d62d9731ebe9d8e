//! Bounding box of the object in an image, as input of the spatial-aware module.

use gradreel::{Error, ErrorKind, Key, Result, Tensor};
use serde::{Deserialize, Serialize};

/// A box in an image, as shares of the image's sides: (0, 0) is the upper left corner, (1, 1) the lower right.
///
/// Pixels cover an area: the box of a mask ends after its last pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageBox {
    /// Left and top.
    pub low: [f64; 2],
    /// Right and bottom.
    pub high: [f64; 2],
}

impl ImageBox {
    /// Tight bounding box of the pixels that are at least half covered; `None` if there are none.
    ///
    /// # Panics
    /// If the rows are not `width` long.
    #[track_caller]
    pub fn of_coverage(coverage: &[f32], width: usize) -> Option<Self> {
        assert!(width > 0 && coverage.len().is_multiple_of(width), "{} pixels in rows of {width}", coverage.len());
        let height = coverage.len() / width;
        let covered =
            coverage.iter().enumerate().filter(|(_, share)| **share >= 0.5).map(|(i, _)| [i % width, i / width]);
        let found = covered.fold(None, |found: Option<[[usize; 2]; 2]>, [x, y]| {
            let [low, high] = found.unwrap_or([[x, y]; 2]);
            Some([[low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]])
        });
        let sides = [width as f64, height as f64];
        found.map(|[low, high]| Self {
            low: [0, 1].map(|axis| low[axis] as f64 / sides[axis]),
            high: [0, 1].map(|axis| (high[axis] + 1) as f64 / sides[axis]),
        })
    }

    /// Tight bounding box of the non-white pixels of a picture `[1, 3, h, w]` in −1..1; `None` if all are white.
    ///
    /// # Errors
    /// If the picture cannot be read.
    ///
    /// # Panics
    /// If the shape is not `[1, 3, h, w]`.
    #[track_caller]
    pub fn of_picture(picture: &Tensor) -> Result<Option<Self>> {
        let [1, 3, height, width] = picture.dims()[..] else { panic!("a picture is [1, 3, h, w]") };
        let (values, area) = (picture.to_vec()?, height * width);
        let coverage: Vec<f32> = (0..area).map(|i| f32::from(u8::from(not_white(&values, i)))).collect();
        Ok(Self::of_coverage(&coverage, width))
    }

    /// Expanded on every side by a share of the image.
    #[must_use]
    pub fn padded(self, margin: f64) -> Self {
        Self { low: self.low.map(|x| x - margin), high: self.high.map(|x| x + margin) }
    }

    /// With normal noise of this relative standard deviation on every side, which imitates a detector.
    #[must_use]
    pub fn jittered(self, deviation: f64, key: Key) -> Self {
        let moves: Vec<f64> = key.normal(4).collect();
        let moved = |axis: usize| {
            let by = deviation * (self.high[axis] - self.low[axis]);
            let ends = [self.low[axis] + by * moves[axis], self.high[axis] + by * moves[axis + 2]];
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        };
        let [x, y] = [moved(0), moved(1)];
        Self { low: [x[0], y[0]], high: [x[1], y[1]] }
    }

    /// The centre.
    pub fn centre(&self) -> [f64; 2] {
        [0, 1].map(|axis| 0.5 * (self.low[axis] + self.high[axis]))
    }

    /// Intersection over union.
    pub fn overlap(&self, other: &Self) -> f64 {
        let area = |low: [f64; 2], high: [f64; 2]| (high[0] - low[0]).max(0.0) * (high[1] - low[1]).max(0.0);
        let low = [0, 1].map(|axis| self.low[axis].max(other.low[axis]));
        let high = [0, 1].map(|axis| self.high[axis].min(other.high[axis]));
        let common = area(low, high);
        let all = area(self.low, self.high) + area(other.low, other.high) - common;
        if all > 0.0 { common / all } else { 0.0 }
    }

    /// Rejects an invalid box.
    pub(super) fn check(&self) -> Result<()> {
        let finite = self.low.iter().chain(&self.high).all(|x| x.is_finite());
        if finite && (0..2).all(|axis| self.low[axis] < self.high[axis]) {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "this is no box around an object")
            .found(format!("{self:?}"))
            .wanted("left below right and top below bottom, in shares of the image"))
    }
}

/// Whether a pixel of a picture `[3, h, w]` in −1..1 belongs to an object on white.
pub(super) fn not_white(values: &[f64], pixel: usize) -> bool {
    /// Minimum difference from white.
    const WHITE: f64 = 0.2;
    let area = values.len() / 3;
    (0..3).any(|c| values[c * area + pixel] < 1.0 - WHITE)
}
