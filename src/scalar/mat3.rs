//! 3×3 matrices of scalars: deformation gradients, stresses, rotations.

use std::ops::{Add, Mul, Neg, Sub};

use super::{Scalar, Vec3};

/// A 3×3 matrix of [`Scalar`]s, as rows.
///
/// ```
/// use gradreel::scalar::{Mat3, Program};
///
/// const F: [&str; 9] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22"];
/// let program = Program::trace("volume", &F, &["j"], |f| vec![Mat3::from_slice(f).det()]);
/// assert_eq!(program.eval(&[2.0_f64, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 4.0]), [24.0]);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Mat3(pub [[Scalar; 3]; 3]);

impl Mat3 {
    /// The identity.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![(Mat3::eye() * x[0]).trace()]);
    /// assert_eq!(f.eval(&[2.0]), [6.0]);
    /// ```
    pub fn eye() -> Self {
        Self::diag(Vec3::new(1.0, 1.0, 1.0))
    }

    /// All zeros.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![(Mat3::zero() + Mat3::eye() * x[0]).trace()]);
    /// assert_eq!(f.eval(&[2.0]), [6.0]);
    /// ```
    pub fn zero() -> Self {
        Self([[Scalar::from(0.0); 3]; 3])
    }

    /// The matrix with `d` on its diagonal and zeros elsewhere.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![Mat3::diag(Vec3::new(x[0], 2.0, 3.0)).det()]);
    /// assert_eq!(f.eval(&[4.0]), [24.0]);
    /// ```
    pub fn diag(d: Vec3) -> Self {
        let mut m = Self::zero();
        for i in 0..3 {
            m.0[i][i] = d[i];
        }
        m
    }

    /// The first nine values of a slice, row by row.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    /// let f = Program::trace("trace", &names, &["y"], |x| vec![Mat3::from_slice(x).trace()]);
    /// assert_eq!(f.eval(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]), [15.0]);
    /// ```
    ///
    /// # Panics
    /// If there are fewer.
    #[track_caller]
    pub fn from_slice(x: &[Scalar]) -> Self {
        assert!(x.len() >= 9, "Mat3::from_slice: {} values, 9 wanted", x.len());
        Self([[x[0], x[1], x[2]], [x[3], x[4], x[5]], [x[6], x[7], x[8]]])
    }

    /// The nine values row by row, as a traced function returns them.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    /// let f = Program::trace("scaled", &["x"], &names, |x| (Mat3::eye() * x[0]).to_vec());
    /// assert_eq!(f.eval(&[2.0])[4], 2.0);
    /// ```
    pub fn to_vec(self) -> Vec<Scalar> {
        self.0.as_flattened().to_vec()
    }

    /// `f` of each entry.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.map(|entry| entry.square()).trace()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [14.0]);
    /// ```
    pub fn map(self, mut f: impl FnMut(Scalar) -> Scalar) -> Self {
        Self(self.0.map(|row| row.map(&mut f)))
    }

    /// Row `i`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.row(1).norm_squared()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [4.0]);
    /// ```
    pub fn row(self, i: usize) -> Vec3 {
        Vec3(self.0[i])
    }

    /// Column `j`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.column(1).norm_squared()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [4.0]);
    /// ```
    pub fn column(self, j: usize) -> Vec3 {
        self.t().row(j)
    }

    /// `s A`
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.scale(2.0).trace()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [12.0]);
    /// ```
    #[track_caller]
    pub fn scale(self, s: impl Into<Scalar>) -> Self {
        let s = s.into();
        self.map(|x| s * x)
    }

    /// The transpose `Aᵀ`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.t().row(0).norm_squared()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [1.0]);
    /// ```
    #[must_use]
    pub fn t(self) -> Self {
        let [a, b, c] = self.0;
        Self([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]])
    }

    /// `A B`; the same as `a * b`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.matmul(Mat3::eye()).trace()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [6.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn matmul(self, b: Self) -> Self {
        let columns = b.t();
        Self([0, 1, 2].map(|i| [0, 1, 2].map(|j| self.row(i).dot(columns.row(j)))))
    }

    /// `a bᵀ`; the same as `a.outer(b)`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let v = Vec3::new(x[0], 2.0, 3.0);
    ///     vec![Mat3::outer(v, v).trace()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [14.0]);
    /// ```
    #[track_caller]
    pub fn outer(a: Vec3, b: Vec3) -> Self {
        a.outer(b)
    }

    /// `tr A`
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.trace()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [6.0]);
    /// ```
    #[track_caller]
    pub fn trace(self) -> Scalar {
        self.0[0][0] + self.0[1][1] + self.0[2][2]
    }

    /// `A : B = Σ Aᵢⱼ Bᵢⱼ`, the Frobenius product.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.ddot(Mat3::eye())]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [6.0]);
    /// ```
    #[track_caller]
    pub fn ddot(self, b: Self) -> Scalar {
        self.row(0).dot(b.row(0)) + self.row(1).dot(b.row(1)) + self.row(2).dot(b.row(2))
    }

    /// `det A`
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.det()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [6.0]);
    /// ```
    #[track_caller]
    pub fn det(self) -> Scalar {
        self.row(0).dot(self.row(1).cross(self.row(2)))
    }

    /// The cofactor matrix `det A · A⁻ᵀ`, defined for singular matrices too.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.cofactor().row(0).norm_squared()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [36.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn cofactor(self) -> Self {
        let (a, b, c) = (self.row(0), self.row(1), self.row(2));
        Self([b.cross(c).0, c.cross(a).0, a.cross(b).0])
    }

    /// `A⁻¹`; not finite for a singular matrix.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![(Mat3::eye() * x[0]).inverse().trace()]);
    /// assert_eq!(f.eval(&[4.0]), [0.75]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn inverse(self) -> Self {
        self.cofactor().t().scale(self.det().recip())
    }

    /// `(A + Aᵀ) / 2`
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let a = Mat3::diag(Vec3::new(x[0], 2.0, 3.0));
    ///     vec![a.sym().row(0).norm_squared()]
    /// });
    /// assert_eq!(f.eval(&[1.0]), [1.0]);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn sym(self) -> Self {
        (self + self.t()).scale(0.5)
    }

    /// The deviator `A − tr A / 3 · I`.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program};
    /// let f = Program::trace("f", &["x"], &["y"], |x| vec![(Mat3::eye() * x[0]).dev().trace()]);
    /// assert!(f.eval(&[4.0f64])[0].abs() < 1e-12);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn dev(self) -> Self {
        let third = self.trace() * (1.0 / 3.0);
        let mut deviator = self;
        for i in 0..3 {
            deviator.0[i][i] -= third;
        }
        deviator
    }

    #[track_caller]
    fn zip(self, b: Self, f: impl Fn(Scalar, Scalar) -> Scalar) -> Self {
        Self([0, 1, 2].map(|i| [0, 1, 2].map(|j| f(self.0[i][j], b.0[i][j]))))
    }
}

impl Add for Mat3 {
    type Output = Self;
    #[track_caller]
    fn add(self, b: Self) -> Self {
        self.zip(b, |a, b| a + b)
    }
}

impl Sub for Mat3 {
    type Output = Self;
    #[track_caller]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |a, b| a - b)
    }
}

impl Neg for Mat3 {
    type Output = Self;
    #[track_caller]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

impl Mul for Mat3 {
    type Output = Self;
    #[track_caller]
    fn mul(self, b: Self) -> Self {
        self.matmul(b)
    }
}

impl Mul<Vec3> for Mat3 {
    type Output = Vec3;
    #[track_caller]
    fn mul(self, v: Vec3) -> Vec3 {
        Vec3([0, 1, 2].map(|i| self.row(i).dot(v)))
    }
}

impl Mul<Scalar> for Mat3 {
    type Output = Self;
    #[track_caller]
    fn mul(self, s: Scalar) -> Self {
        self.scale(s)
    }
}

impl Mul<f64> for Mat3 {
    type Output = Self;
    #[track_caller]
    fn mul(self, s: f64) -> Self {
        self.scale(s)
    }
}

impl Mul<Mat3> for Scalar {
    type Output = Mat3;
    #[track_caller]
    fn mul(self, m: Mat3) -> Mat3 {
        m.scale(self)
    }
}

impl Mul<Mat3> for f64 {
    type Output = Mat3;
    #[track_caller]
    fn mul(self, m: Mat3) -> Mat3 {
        m.scale(self)
    }
}
