//! Average pooling. The mean over a window is the mean of means along each axis: made of [`resample`](super::resample).

use crate::Var;
use crate::ops::pool::Pool;
use crate::ops::resample::{Table, resample};

impl Var {
    /// The mean of every window of images `[batch, channels, …]`. Zeros around the image count as values, unless
    /// [`Pool::without_padding`] says that the mean is over pixels alone. Differentiable any number of times.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 2.0, 3.0, 6.0], [1, 1, 2, 2]));
    /// assert_eq!(x.average_pool(&Pool::new(2)).item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the settings do not fit the shape.
    #[track_caller]
    #[must_use]
    pub fn average_pool(&self, settings: &Pool) -> Self {
        let windows = settings.windows("average_pool", &self.spec()).unwrap_or_else(|error| panic!("{error}"));
        let first = 5 - self.dims().len();
        (first..3).fold(self.clone(), |x, axis| {
            let (from, kernel) = (windows.x[axis], windows.kernel[axis]);
            let rows = (0..windows.y[axis]).map(|i| {
                let range = windows.window(axis, i);
                let count = if settings.counts_padding() { kernel } else { range.len() };
                range.map(|place| (place, 1.0 / count as f64)).collect()
            });
            resample(&x, axis + 2 - first, Table::new(from, rows))
        })
    }
}
