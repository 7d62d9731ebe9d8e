//! What happens to a tile of a product before it leaves the first-level cache.

use crate::scalar::{Job, Lane, Real};

/// A function applied to each element at the end.
///
/// ```
/// use gradreel::{Tape, Tensor, ops::Activation};
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1, 1]));
/// let w = tape.leaf(Tensor::from_vec(vec![-2.0], [1, 1]));
/// let b = tape.leaf(Tensor::from_vec(vec![0.5], [1]));
/// let y = x.mlp(&[(&w, &b), (&w, &b)], Activation::Relu);
/// assert_eq!(y.item()?, 0.5); // the hidden layer is max(−1.5, 0)
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// `x`
    #[default]
    Identity,
    /// `max(x, 0)`; NaN stays NaN.
    Relu,
    /// `tanh x`
    Tanh,
    /// `1 / (1 + e⁻ˣ)`
    Logistic,
    /// `ln(1 + eˣ)`
    Softplus,
    /// `x / (1 + e⁻ˣ)`
    Silu,
}

impl Activation {
    /// The function of a vector.
    ///
    /// # Safety
    /// The instruction set of `V` must be enabled.
    #[inline(always)]
    pub(crate) unsafe fn of<V: Lane>(self, x: V) -> V {
        // SAFETY: as this method.
        unsafe {
            match self {
                Self::Identity => x,
                // the larger of a pair is the second where either is NaN
                Self::Relu => V::splat(V::Element::ZERO).larger(x),
                Self::Tanh => x.tanh(),
                Self::Logistic => x.logistic(),
                Self::Softplus => x.softplus(),
                Self::Silu => x.mul(x.logistic()),
            }
        }
    }
}

/// `y = activation(x + bias of the row + bias of the column)`, applied where the last part of a sum arrives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Epilogue<'a, T> {
    pub(super) row_bias: Option<&'a [T]>,
    pub(super) column_bias: Option<&'a [T]>,
    pub(super) activation: Activation,
}

impl<T: Real> Epilogue<'_, T> {
    pub(super) const NONE: Self = Self { row_bias: None, column_bias: None, activation: Activation::Identity };

    pub(super) fn is_none(&self) -> bool {
        self.row_bias.is_none() && self.column_bias.is_none() && self.activation == Activation::Identity
    }

    /// Whether it is cheap enough to happen before a tile is stored.
    pub(super) fn is_simple(&self) -> bool {
        self.row_bias.is_none() && matches!(self.activation, Activation::Identity | Activation::Relu)
    }

    /// The same for the transposed product.
    pub(super) fn transposed(self) -> Self {
        Self { row_bias: self.column_bias, column_bias: self.row_bias, ..self }
    }
}

/// Finishes a tile whose rows are whole vectors.
///
/// Whoever dispatches it promises that `tile` is valid for `shape[0]` rows of `shape[1]` vectors at distance `row`, and
/// `column_bias` for one such row.
pub(super) struct Finish<'a, T> {
    pub(super) epilogue: &'a Epilogue<'a, T>,
    pub(super) tile: *mut T,
    pub(super) row: usize,
    /// The place of the tile's first row in the product.
    pub(super) first_row: usize,
    pub(super) shape: [usize; 2],
    pub(super) column_bias: Option<*const T>,
}

impl<T: Real> Job<T> for Finish<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { epilogue, tile, row, first_row, shape: [rows, vectors], column_bias } = self;
        macro_rules! each {
            ($activation:path) => {
                for r in 0..rows {
                    for v in 0..vectors {
                        // SAFETY: the caller's promise.
                        unsafe {
                            let at = tile.add(r * row + v * V::WIDTH);
                            let mut x = V::load(at);
                            if let Some(bias) = epilogue.row_bias {
                                x = x.add(V::splat(bias[first_row + r]));
                            }
                            if let Some(bias) = column_bias {
                                x = x.add(V::load(bias.add(v * V::WIDTH)));
                            }
                            $activation.of(x).store(at);
                        }
                    }
                }
            };
        }
        match epilogue.activation {
            Activation::Identity => each!(Activation::Identity),
            Activation::Relu => each!(Activation::Relu),
            Activation::Tanh => each!(Activation::Tanh),
            Activation::Logistic => each!(Activation::Logistic),
            Activation::Softplus => each!(Activation::Softplus),
            Activation::Silu => each!(Activation::Silu),
        }
    }
}
