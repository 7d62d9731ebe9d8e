//! The symbolic number that traced functions compute with.

use super::instruction::{Binary, Unary};
use super::trace;

/// A number inside a traced function: a handle to one value of the program being recorded, or a plain constant.
///
/// It is `Copy`, has the usual operators (with `f64` on either side) and the methods of a float. Between plain
/// constants the operations compute at once in `f64`, also outside a trace.
///
/// ```
/// use gradreel::scalar::{Program, Scalar};
///
/// fn huber(x: Scalar) -> Scalar {
///     let r = x.abs();
///     r.le(1.0).select(0.5 * x.square(), r - 0.5)
/// }
/// let program = Program::trace("huber", &["x"], &["y"], |x| vec![huber(x[0])]);
/// assert_eq!(program.eval(&[3.0_f64]), [2.5]);
/// assert_eq!(huber(Scalar::from(-3.0)).constant(), Some(2.5));
/// ```
///
/// # Panics
/// Every operation panics if a handle is used after, or outside, the `Program::trace` call that made it.
#[derive(Debug, Clone, Copy)]
pub struct Scalar(pub(super) Repr);

#[derive(Debug, Clone, Copy)]
pub(super) enum Repr {
    Const(f64),
    Node { trace: u64, id: u32 },
}

/// The outcome of a comparison inside a traced function: true or false for each lane.
///
/// A comparison with NaN is false, so `x.lt(y).not()` and `x.ge(y)` differ there.
///
/// ```
/// use gradreel::scalar::Program;
/// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].gt(1.0).select(10.0, 20.0)]);
/// assert_eq!(f.eval(&[3.0]), [10.0]);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Condition(Scalar);

impl From<f64> for Scalar {
    fn from(value: f64) -> Self {
        Self(Repr::Const(value))
    }
}

macro_rules! unary_methods {
    ($($(#[$doc:meta])* $name:ident => $op:ident;)*) => {$(
        $(#[$doc])*
        #[must_use]
        #[track_caller]
        pub fn $name(self) -> Self {
            trace::unary(Unary::$op, self)
        }
    )*};
}

impl Scalar {
    unary_methods! {
        /// `|x|`; its derivative at 0 is 0.
        abs => Abs;
        /// −1, 0 or 1; its derivative is 0 everywhere.
        sign => Sign;
        /// The largest integer not above `x`; its derivative is 0 everywhere.
        floor => Floor;
        /// `1 / x`
        recip => Recip;
        /// `√x`; its derivative at 0 is infinite.
        sqrt => Sqrt;
        /// `eˣ`
        exp => Exp;
        /// Natural logarithm; −∞ at 0, NaN below.
        ln => Ln;
        /// Sine of an angle in radians.
        sin => Sin;
        /// Cosine of an angle in radians.
        cos => Cos;
        /// Hyperbolic tangent.
        tanh => Tanh;
        /// The logistic sigmoid `1 / (1 + e⁻ˣ)`, accurate on both sides.
        logistic => Logistic;
        /// `ln(1 + eˣ)`, a smooth map to positive numbers; equals `x` for large `x`.
        softplus => Softplus;
        /// `ln(1 + x)` without cancellation near 0.
        ln_1p => Ln1p;
        /// `eˣ − 1` without cancellation near 0.
        exp_m1 => ExpM1;
        /// The error function `2/√π ∫₀ˣ e^{−t²} dt`.
        erf => Erf;
    }

    /// The value if it is known while tracing.
    ///
    /// ```
    /// use gradreel::scalar::Scalar;
    /// assert_eq!(Scalar::from(2.0).constant(), Some(2.0));
    /// ```
    #[must_use]
    pub fn constant(self) -> Option<f64> {
        match self.0 {
            Repr::Const(value) => Some(value),
            Repr::Node { .. } => None,
        }
    }

    /// The smallest integer not below `x`; its derivative is 0 everywhere.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].ceil()]);
    /// assert_eq!(f.eval(&[1.2]), [2.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn ceil(self) -> Self {
        -(-self).floor()
    }

    /// The nearest integer, halves upwards; its derivative is 0 everywhere.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].round()]);
    /// assert_eq!(f.eval(&[1.5]), [2.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn round(self) -> Self {
        let below = self.floor();
        (self - below).ge(0.5).select(below + 1.0, below)
    }

    /// `x²`
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].square()]);
    /// assert_eq!(f.eval(&[3.0]), [9.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn square(self) -> Self {
        self * self
    }

    /// `xⁿ` by repeated squaring; any sign of `x`, and `(1/x)⁻ⁿ` for negative `n`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].powi(-2)]);
    /// assert_eq!(f.eval(&[2.0]), [0.25]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn powi(self, n: i32) -> Self {
        // the reciprocal first: the slope of its power at 0 is infinite, that of a power's reciprocal would be ∞ · 0
        let base = if n < 0 { self.recip() } else { self };
        let (mut power, mut base, mut left) = (Self::from(1.0), base, n.unsigned_abs());
        while left > 0 {
            if left & 1 == 1 {
                power *= base;
            }
            left >>= 1;
            if left > 0 {
                base = base * base;
            }
        }
        power
    }

    /// `xᵇ`; NaN for `x < 0`, unless `b` is whole. A small whole constant exponent becomes [`Scalar::powi`], ½ becomes
    /// [`Scalar::sqrt`].
    ///
    /// The slope in `x` is 0 where `b = 0`; that in `b` is 0 where `x = 0` and `b ≥ 0`, −∞ where `x = 0` and `b < 0`, and
    /// NaN where `x < 0`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].powf(0.5)]);
    /// assert_eq!(f.eval(&[9.0]), [3.0]);
    /// ```
    #[must_use]
    #[track_caller]
    #[allow(clippy::cast_possible_truncation)]
    pub fn powf(self, b: impl Into<Self>) -> Self {
        let b = b.into();
        match b.constant() {
            Some(n) if n.fract() == 0.0 && n.abs() <= 64.0 => self.powi(n as i32),
            Some(0.5) => self.sqrt(),
            _ => trace::binary(Binary::Powf, self, b),
        }
    }

    /// The smaller of two; on a tie the derivative goes to `self`; NaN if either is NaN.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].min(1.0)]);
    /// assert_eq!(f.eval(&[3.0]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn min(self, b: impl Into<Self>) -> Self {
        trace::binary(Binary::Min, self, b.into())
    }

    /// The larger of two; on a tie the derivative goes to `self`; NaN if either is NaN.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].max(1.0)]);
    /// assert_eq!(f.eval(&[3.0]), [3.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn max(self, b: impl Into<Self>) -> Self {
        trace::binary(Binary::Max, self, b.into())
    }

    /// The nearest number in `[low, high]`; the derivative is 1 inside and at both ends, 0 outside.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].clamp(0.0, 1.0)]);
    /// assert_eq!(f.eval(&[3.0]), [1.0]);
    /// ```
    ///
    /// # Panics
    /// If `low > high` or either is NaN.
    #[must_use]
    #[track_caller]
    pub fn clamp(self, low: f64, high: f64) -> Self {
        assert!(low <= high, "scalar clamp: the lower end {low} is not below the upper end {high}");
        self.max(low).min(high)
    }

    /// `self < b`
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].lt(2.0).to_scalar()]);
    /// assert_eq!(f.eval(&[2.0]), [0.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn lt(self, b: impl Into<Self>) -> Condition {
        Condition(trace::binary(Binary::Lt, self, b.into()))
    }

    /// `self ≤ b`
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].le(2.0).to_scalar()]);
    /// assert_eq!(f.eval(&[2.0]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn le(self, b: impl Into<Self>) -> Condition {
        Condition(trace::binary(Binary::Le, self, b.into()))
    }

    /// `self > b`
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].gt(2.0).to_scalar()]);
    /// assert_eq!(f.eval(&[2.0]), [0.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn gt(self, b: impl Into<Self>) -> Condition {
        Condition(trace::binary(Binary::Lt, b.into(), self))
    }

    /// `self ≥ b`
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].ge(2.0).to_scalar()]);
    /// assert_eq!(f.eval(&[2.0]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn ge(self, b: impl Into<Self>) -> Condition {
        Condition(trace::binary(Binary::Le, b.into(), self))
    }

    /// `self = b`; false for NaN.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].eq(2.0).to_scalar()]);
    /// assert_eq!(f.eval(&[2.0]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn eq(self, b: impl Into<Self>) -> Condition {
        let b = b.into();
        self.le(b).and(self.ge(b))
    }

    /// `a` where the condition holds, else `b`. See [`Condition::select`].
    ///
    /// ```
    /// use gradreel::scalar::{Program, Scalar};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Scalar::select(x[0].lt(0.0), -x[0], x[0])]);
    /// assert_eq!(f.eval(&[-3.0]), [3.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn select(condition: Condition, a: impl Into<Self>, b: impl Into<Self>) -> Self {
        condition.select(a, b)
    }
}

impl Condition {
    /// `a` where the condition holds, else `b`.
    ///
    /// Both are computed; one is kept. The cotangent of the other is set to 0 *before* it is multiplied with anything,
    /// but 0 times an infinite derivative is still NaN: keep `ln`, `sqrt` and divisions in the branch not taken
    /// away from their poles by making their *argument* safe first, as in
    ///
    /// ```
    /// # use gradreel::scalar::{Program, Scalar};
    /// fn safe_ln(x: Scalar) -> Scalar {
    ///     let inside = x.gt(1e-12);
    ///     inside.select(inside.select(x, 1.0).ln(), 0.0)
    /// }
    /// let program = Program::trace("safe_ln", &["x"], &["y"], |x| vec![safe_ln(x[0])]);
    /// assert_eq!(program.vjp().eval(&[0.0, 1.0]), [0.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn select(self, a: impl Into<Scalar>, b: impl Into<Scalar>) -> Scalar {
        trace::select(self.0, a.into(), b.into())
    }

    /// Both hold.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].gt(0.0).and(x[0].lt(1.0)).to_scalar()]);
    /// assert_eq!(f.eval(&[0.5]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }

    /// At least one holds.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].lt(0.0).or(x[0].gt(1.0)).to_scalar()]);
    /// assert_eq!(f.eval(&[0.5]), [0.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn or(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    /// It does not hold.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].lt(0.0).not().to_scalar()]);
    /// assert_eq!(f.eval(&[0.5]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    #[allow(clippy::should_implement_trait)]
    pub fn not(self) -> Self {
        Self(1.0 - self.0)
    }

    /// 1 where it holds, else 0.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![x[0].ge(0.0).to_scalar()]);
    /// assert_eq!(f.eval(&[0.5]), [1.0]);
    /// ```
    #[must_use]
    pub fn to_scalar(self) -> Scalar {
        self.0
    }

    /// The condition "`x` is not 0"; for values already known to be 0 or 1.
    pub(super) fn from_mask(x: Scalar) -> Self {
        Self(x)
    }
}
