//! `logsumexp`: `ln Σ eˣ` over some axes without overflow; composed of other ops.

use crate::Var;
use crate::ops::reduction::Axes;

impl Var {
    /// `ln Σ eˣ` over some axes, which are dropped, without overflow. Rows of nothing but −∞ give −∞ and a derivative of 0;
    /// NaN stays NaN.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1000.0f64, 1000.0, f64::NEG_INFINITY, f64::NEG_INFINITY], [2, 2]));
    /// let y = x.logsumexp(&[1]);
    /// assert_eq!(y.value()?.slice::<f64>(), &[1000.0 + 2.0f64.ln(), f64::NEG_INFINITY]);
    /// assert_eq!(y.sum_all().backward()?.wrt(&x)?.slice::<f64>(), &[0.5, 0.5, 0.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn logsumexp(&self, axes: &[usize]) -> Self {
        let dropped = Axes::new(axes);
        let (zero, one) = (self.number(0.0), self.number(1.0));
        // where nothing finite is largest, nothing is taken out: the shift must not make NaN
        let largest = self.detach().max(axes);
        let shift = largest.abs().lt(&self.number(f64::INFINITY)).choose(&largest, &zero);
        let sum = (self - &shift.reshape(dropped.with_ones(self.shape()))).exp().sum(axes);
        let nothing = sum.eq(&zero);
        let log = nothing.choose(&one, &sum).ln();
        nothing.choose(&self.number(f64::NEG_INFINITY), &log) + shift
    }
}
