//! Resizing of images and volumes: nearest and linear, to a size or by a factor. Made of [`resample`](super::resample).

use crate::ops::PerAxis;
use crate::ops::resample::{Table, resample};
use crate::{Error, ErrorKind, Var};

/// How values between pixels are found.
///
/// ```
/// use gradreel::{Tape, Tensor, ops::Resampling};
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0, 3.0], [1, 1, 2]));
/// assert_eq!(x.scale_by(2.0, Resampling::Nearest).dims(), [1, 1, 4]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Resampling {
    /// The pixel at the rounded-down place `⌊i · from / to⌋`.
    Nearest,
    /// Between the neighbours along each axis (bilinear, trilinear), where pixels are areas and the borders of both images
    /// meet: place `(i + ½) · from / to − ½`.
    Linear,
    /// The same, where pixels are points and the centres of the corner pixels meet: place `i (from − 1) / (to − 1)`.
    LinearCorners,
}

impl Resampling {
    /// The pixels that place `i` of the result is made of; `scale` is the distance between its places in pixels.
    fn row(self, i: usize, [from, to]: [usize; 2], scale: f64) -> Vec<(usize, f64)> {
        let place = match self {
            // in single precision, as PyTorch finds it
            Self::Nearest if to == from => return vec![(i, 1.0)],
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            Self::Nearest => return vec![((((i as f32) * (scale as f32)) as usize).min(from - 1), 1.0)],
            Self::Linear => ((i as f64 + 0.5) * scale - 0.5).max(0.0),
            Self::LinearCorners if to == 1 => 0.0,
            Self::LinearCorners => i as f64 * ((from - 1) as f64 / (to - 1) as f64),
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let first = (place as usize).min(from - 1);
        let share = place - first as f64;
        if first + 1 == from || share == 0.0 {
            vec![(first, 1.0)]
        } else {
            vec![(first, 1.0 - share), (first + 1, share)]
        }
    }
}

/// Resizes the spatial axes; `scales` are the distances between places of the result in pixels.
#[track_caller]
fn resize(x: &Var, size: &[usize], scales: &[f64], interpolation: Resampling) -> Var {
    // what shrinks comes first, and what grows the most comes last, so that little passes through all steps; of axes that
    // grow alike the last comes first, for whole rows of the others are then taken at once
    let mut axes: Vec<usize> = (0..size.len()).rev().collect();
    let growth = |&axis: &usize| size[axis] as f64 / x.dims()[axis + 2] as f64;
    axes.sort_by(|a, b| growth(a).total_cmp(&growth(b)));
    axes.into_iter().fold(x.clone(), |x, axis| {
        let (from, to) = (x.dims()[axis + 2], size[axis]);
        if from == to && (scales[axis] - 1.0).abs() < 1e-12 {
            return x;
        }
        let rows = (0..to).map(|i| interpolation.row(i, [from, to], scales[axis]));
        resample(&x, axis + 2, Table::new(from, rows))
    })
}

#[track_caller]
fn refuse(x: &Var, what: String) -> ! {
    let error = Error::new(ErrorKind::Shape, "resize: the size does not fit")
        .found(format!("{:?} to {what}", x.spec()))
        .wanted("batch, channels and spatial axes of at least 1, and a size of at least 1 for each")
        .fix("give one size for all axes, or one for each");
    panic!("{error}");
}

impl Var {
    /// Images `[batch, channels, …]` resized to these sizes of the spatial axes. Differentiable any number of times.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Resampling};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0f64, 1.0], [1, 1, 2]));
    /// let y = x.resize([4], Resampling::Linear);
    /// assert_eq!(y.value()?.slice::<f64>(), [0.0, 0.25, 0.75, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When there is not one size for each axis, or an axis is or would be empty.
    #[track_caller]
    #[must_use]
    pub fn resize(&self, size: impl Into<PerAxis>, interpolation: Resampling) -> Self {
        let size = size.into();
        let resolved = self.dims().len().checked_sub(2).and_then(|rank| size.resolve(rank));
        match resolved {
            Some(to) if !to.contains(&0) && !self.dims()[2..].contains(&0) => {
                let scales: Vec<_> =
                    to.iter().zip(&self.dims()[2..]).map(|(to, from)| *from as f64 / *to as f64).collect();
                resize(self, &to, &scales, interpolation)
            }
            _ => refuse(self, format!("{size:?}")),
        }
    }

    /// Images `[batch, channels, …]` enlarged (or shrunk) by a factor for every spatial axis, to the size rounded down. As in
    /// PyTorch, places are spaced by exactly the inverse of the factor, whatever the rounding of the size.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Resampling};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [1, 1, 2]));
    /// assert_eq!(x.scale_by(2.0, Resampling::Nearest).value()?.slice::<f64>(), [1.0, 1.0, 2.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis is or would be empty.
    #[track_caller]
    #[must_use]
    pub fn scale_by(&self, factor: f64, interpolation: Resampling) -> Self {
        let spatial = self.dims().get(2..).unwrap_or(&[]);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let size: Vec<_> = spatial.iter().map(|&from| (from as f64 * factor).floor() as usize).collect();
        if spatial.contains(&0) || size.contains(&0) || size.is_empty() {
            refuse(self, format!("{factor} times the size"));
        }
        resize(self, &size, &vec![1.0 / factor; size.len()], interpolation)
    }
}
