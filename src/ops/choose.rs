//! `choose`: `a` where a mask is not 0, else `b`.

use crate::Var;
use crate::ops::{Pointwise, uniform};
use crate::{Tensor, scalar::Scalar};

pub(super) const CHOOSE: Pointwise<3> = Pointwise {
    name: "choose",
    function: |[mask, a, b]| choose(mask, a, b),
    cases: || {
        let mask = || Tensor::from_vec(vec![1.0f64, 0.0, 0.0, 1.0, -2.0, 0.0], [2, 3]);
        vec![
            [mask(), uniform(1, [2, 3], -3.0..3.0), uniform(2, [2, 3], -3.0..3.0)],
            [mask(), uniform(1, [3], -3.0..3.0), uniform(2, [], -3.0..3.0)],
        ]
    },
    entry: || CHOOSE.all_cases(),
};

/// The cotangent of the branch not taken is set to 0, never multiplied by 0: what is infinite there does not leak.
fn choose(mask: Scalar, a: Scalar, b: Scalar) -> Scalar {
    // sign² is 1, or NaN for a mask that is NaN
    mask.eq(0.0).select(b, a * mask.sign().square())
}

impl Var {
    /// `a` where this mask is not 0, else `b`; NaN where the mask is NaN.
    ///
    /// The derivative goes to the branch taken. The other one gets 0 whatever it holds, but `0 · ∞` further back is NaN:
    /// keep its *argument* away from the pole, too.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-1.0f64, 0.0, 4.0], [3]));
    /// let inside = x.gt(&tape.constant(Tensor::from_vec(vec![0.0f64], [1])));
    /// let ones = tape.constant(Tensor::from_vec(vec![1.0f64], [1]));
    /// let root = inside.choose(&inside.choose(&x, &ones).sqrt(), &(0.0 * &ones));
    /// assert_eq!(root.value()?.slice::<f64>(), &[0.0, 0.0, 2.0]);
    /// assert_eq!(root.sum_all().backward()?.wrt(&x)?.slice::<f64>(), &[0.0, 0.0, 0.25]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn choose(&self, a: &Self, b: &Self) -> Self {
        CHOOSE.apply([&self.detach(), a, b])
    }
}
