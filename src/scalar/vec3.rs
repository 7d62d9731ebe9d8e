//! Three scalars: a point, a direction, a colour.

use std::ops::{Add, Index, Mul, Neg, Sub};

use super::{Mat3, Scalar};

/// A column of three [`Scalar`]s.
///
/// ```
/// use gradreel::scalar::{Program, Vec3};
///
/// let program = Program::trace("length", &["x", "y", "z"], &["length"], |x| vec![Vec3::from_slice(x).norm()]);
/// assert_eq!(program.eval(&[2.0_f64, 3.0, 6.0]), [7.0]);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Vec3(pub [Scalar; 3]);

impl Vec3 {
    /// A vector of three values or constants.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).norm()]);
    /// assert_eq!(f.eval(&[3.0]), [5.0]);
    /// ```
    pub fn new(x: impl Into<Scalar>, y: impl Into<Scalar>, z: impl Into<Scalar>) -> Self {
        Self([x.into(), y.into(), z.into()])
    }

    /// All zeros.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![(Vec3::zero() + Vec3::new(x[0], 4.0, 0.0)).norm()]);
    /// assert_eq!(f.eval(&[3.0]), [5.0]);
    /// ```
    pub fn zero() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }

    /// The first three values of a slice.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x", "y", "z"], &["l"], |x| vec![Vec3::from_slice(x).norm()]);
    /// assert_eq!(f.eval(&[2.0, 3.0, 6.0]), [7.0]);
    /// ```
    ///
    /// # Panics
    /// If there are fewer.
    #[track_caller]
    pub fn from_slice(x: &[Scalar]) -> Self {
        assert!(x.len() >= 3, "Vec3::from_slice: {} values, 3 wanted", x.len());
        Self([x[0], x[1], x[2]])
    }

    /// The three values, as a traced function returns them.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["s"], &["x", "y", "z"], |s| Vec3::new(s[0], 1.0, 2.0).to_vec());
    /// assert_eq!(f.eval(&[3.0]), [3.0, 1.0, 2.0]);
    /// ```
    pub fn to_vec(self) -> Vec<Scalar> {
        self.0.to_vec()
    }

    /// `f` of each component.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).map(|x| x * 2.0).norm()]);
    /// assert_eq!(f.eval(&[3.0]), [10.0]);
    /// ```
    pub fn map(self, f: impl FnMut(Scalar) -> Scalar) -> Self {
        Self(self.0.map(f))
    }

    /// `s v`
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).scale(2.0).norm()]);
    /// assert_eq!(f.eval(&[3.0]), [10.0]);
    /// ```
    #[track_caller]
    pub fn scale(self, s: impl Into<Scalar>) -> Self {
        let s = s.into();
        self.map(|x| s * x)
    }

    /// `a · b`
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).dot(Vec3::new(1.0, 1.0, 1.0))]);
    /// assert_eq!(f.eval(&[3.0]), [7.0]);
    /// ```
    #[track_caller]
    pub fn dot(self, b: Self) -> Scalar {
        self[0] * b[0] + self[1] * b[1] + self[2] * b[2]
    }

    /// `a × b`
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let (a, b) = (Vec3::new(x[0], 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0));
    ///     vec![a.cross(b).norm()]
    /// });
    /// assert_eq!(f.eval(&[3.0]), [6.0]);
    /// ```
    #[track_caller]
    pub fn cross(self, b: Self) -> Self {
        let component = |i: usize, j: usize| self[i] * b[j] - self[j] * b[i];
        Self([component(1, 2), component(2, 0), component(0, 1)])
    }

    /// `a bᵀ`
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let (a, b) = (Vec3::new(x[0], 4.0, 0.0), Vec3::new(1.0, 1.0, 1.0));
    ///     vec![a.outer(b).trace()]
    /// });
    /// assert_eq!(f.eval(&[3.0]), [7.0]);
    /// ```
    #[track_caller]
    pub fn outer(self, b: Self) -> Mat3 {
        Mat3(self.0.map(|a| b.0.map(|b| a * b)))
    }

    /// `v · v`
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).norm_squared()]);
    /// assert_eq!(f.eval(&[3.0]), [25.0]);
    /// ```
    #[track_caller]
    pub fn norm_squared(self) -> Scalar {
        self.dot(self)
    }

    /// `|v|`; its derivative at 0 is not finite.
    ///
    /// ```
    /// use gradreel::scalar::{Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Vec3::new(x[0], 4.0, 0.0).norm()]);
    /// assert_eq!(f.eval(&[3.0]), [5.0]);
    /// ```
    #[track_caller]
    pub fn norm(self) -> Scalar {
        self.norm_squared().sqrt()
    }
}

impl Index<usize> for Vec3 {
    type Output = Scalar;
    fn index(&self, i: usize) -> &Scalar {
        &self.0[i]
    }
}

impl Add for Vec3 {
    type Output = Self;
    #[track_caller]
    fn add(self, b: Self) -> Self {
        Self([self[0] + b[0], self[1] + b[1], self[2] + b[2]])
    }
}

impl Sub for Vec3 {
    type Output = Self;
    #[track_caller]
    fn sub(self, b: Self) -> Self {
        Self([self[0] - b[0], self[1] - b[1], self[2] - b[2]])
    }
}

impl Neg for Vec3 {
    type Output = Self;
    #[track_caller]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

impl<S: Into<Scalar>> Mul<S> for Vec3 {
    type Output = Self;
    #[track_caller]
    fn mul(self, s: S) -> Self {
        self.scale(s)
    }
}

impl Mul<Vec3> for Scalar {
    type Output = Vec3;
    #[track_caller]
    fn mul(self, v: Vec3) -> Vec3 {
        v.scale(self)
    }
}

impl Mul<Vec3> for f64 {
    type Output = Vec3;
    #[track_caller]
    fn mul(self, v: Vec3) -> Vec3 {
        v.scale(self)
    }
}
