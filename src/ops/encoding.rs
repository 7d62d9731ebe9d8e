//! Sinusoidal encodings of times and positions: composed of other ops.

use crate::{Tensor, Var};

impl Var {
    /// Numbers as constants of this tensor's dtype on its device.
    #[track_caller]
    fn numbers(&self, values: Vec<f64>) -> Self {
        let len = values.len();
        let values = Tensor::from_vec(values, [len]).cast(self.dtype()).and_then(|x| x.to_device(&self.device()));
        match values {
            Ok(values) => self.tape().constant(values),
            Err(fault) => {
                self.tape().keep_fault(fault);
                self.tape().constant(Tensor::zeros([len], self.dtype()))
            }
        }
    }

    /// The embedding of times `t` `[n]` that diffusion models and transformers use: `[n, size]` with
    /// `[cos(t f₀) … cos(t fₕ₋₁), sin(t f₀) … sin(t fₕ₋₁)]`, `fᵢ = 10000^{−i/h}`, `h = ⌊size/2⌋`, and one 0 at the end if
    /// `size` is odd (cosines first, as in Ho, Jain, Abbeel 2020 and its successors).
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let t = tape.constant(Tensor::from_vec(vec![0.0f32, 1.0], [2]));
    /// let y = t.sinusoid(5);
    /// assert_eq!(y.dims(), &[2, 5]);
    /// assert_eq!(y.value()?.slice::<f32>()[..5], [1.0, 1.0, 0.0, 0.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the times are not a list of `f32` or `f64`, or `size` is below 2.
    #[track_caller]
    #[must_use]
    pub fn sinusoid(&self, size: usize) -> Self {
        assert!(self.shape().rank() == 1 && size >= 2, "sinusoid: {:?} in {size} numbers", self.spec());
        let half = size / 2;
        let rates = (0..half).map(|i| (-(10_000f64.ln()) * i as f64 / half as f64).exp()).collect();
        let angles = self.unsqueeze(1) * self.numbers(rates);
        angles.cos().concat(&[&angles.sin()], 1).pad(1, 0, size % 2)
    }

    /// The encoding of positions that radiance fields use: `[.., n]` becomes `[.., n (1 + 2 L)]` with `x`, then
    /// `sin(2ʲ x_c)`, then `cos(2ʲ x_c)`, each block component by component with `j = 0 … L − 1` fastest (Mildenhall and
    /// others 2020, without the factor π). Bring positions to about `[−1, 1]` first.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.5], [1, 1]));
    /// // x, sin x, sin 2x, cos x, cos 2x
    /// let encoded = x.positional_encoding(2);
    /// assert_eq!(encoded.dims(), [1, 5]);
    /// assert!((encoded.value()?.slice::<f64>()[2] - 1.0f64.sin()).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When there is no axis.
    #[track_caller]
    #[must_use]
    pub fn positional_encoding(&self, levels: usize) -> Self {
        let rank = self.shape().rank();
        assert!(rank > 0, "positional_encoding: {:?} has no axis of components", self.spec());
        if levels == 0 {
            return self.clone();
        }
        let rates = (0..levels).map(|j| 2f64.powi(j.try_into().expect("few levels"))).collect();
        let angles = (self.unsqueeze(rank) * self.numbers(rates)).flatten(rank - 1..rank + 1);
        self.concat(&[&angles.sin(), &angles.cos()], rank - 1)
    }
}
