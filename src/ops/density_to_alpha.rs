//! `density_to_alpha`: the opacity of a sample of a volume with some raw density.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const DENSITY_TO_ALPHA: Pointwise<3> = Pointwise {
    name: "density_to_alpha",
    function: |[density, shift, step]| -(-(step * (density + shift).softplus())).exp_m1(),
    cases: || {
        let one = |x: f64| Tensor::from_vec(vec![x], [1]);
        vec![
            [uniform(1, [4, 5], -3.0..9.0), one(-2.0), one(0.5)],
            [Tensor::from_vec(vec![4.0f64, 8.0, 9.2, 15.0, 25.0], [5]), one(-9.2), one(0.05)],
        ]
    },
    entry: || DENSITY_TO_ALPHA.all_cases(),
};

impl Var {
    /// The opacity `1 − (1 + e^{d + shift})^{−step} = 1 − exp(−step · softplus(d + shift))` of a stretch of length `step`
    /// through a volume of raw density `d`.
    ///
    /// With `shift = ln(1 / (1 − α₀) − 1)` a density of 0 has the opacity α₀ over a stretch of length 1. Neither the opacity
    /// nor its derivative overflows. C. Sun, M. Sun, H.-T. Chen, "Direct Voxel Grid Optimization", CVPR 2022 (there
    /// `raw2alpha`, of post-activated density).
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let density = tape.leaf(Tensor::from_vec(vec![0.0f64, 500.0], [2]));
    /// let alpha = density.density_to_alpha((1.0f64 / (1.0 - 1e-4) - 1.0).ln(), 1.0);
    /// assert!((alpha.value()?.slice::<f64>()[0] - 1e-4).abs() < 1e-15);
    /// assert_eq!(alpha.value()?.slice::<f64>()[1], 1.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn density_to_alpha(&self, shift: f64, step: f64) -> Self {
        DENSITY_TO_ALPHA.apply([self, &self.number(shift), &self.number(step)])
    }
}
