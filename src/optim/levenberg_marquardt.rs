//! Levenberg–Marquardt: Gauss–Newton steps within a region of trust (Levenberg 1944, Marquardt 1963, Moré 1978), with the
//! damping of Nielsen (1999, *Damping parameter in Marquardt's method*, IMM-REP-1999-05).

use faer::Mat;

use crate::{Error, ErrorKind, Result};

/// Least squares `½ Σ rᵢ(x)²` for a few parameters and any number of residuals.
///
/// The caller supplies residuals and the columns `∂r/∂xⱼ` of their Jacobian, by forward mode for instance. Columns are scaled
/// by their largest norm so far, so that parameters may have any units. Steps solve
/// `min ‖J h + r‖² + μ ‖D h‖²` by QR, which squares no condition number. Bounds are the caller's: fit an unconstrained
/// number and map it.
///
/// ```
/// use gradreel::optim::{LevenbergMarquardt, Residuals};
///
/// // y = a exp(b t) through exact points of a = 2, b = −1.5
/// let t: Vec<f64> = (0..20).map(|i| 0.1 * f64::from(i)).collect();
/// let y: Vec<f64> = t.iter().map(|t| 2.0 * (-1.5 * t).exp()).collect();
/// let fit = LevenbergMarquardt::default().minimise(&[1.0, 0.0], &mut |x, _| {
///     let model = |t: &f64| x[0] * (x[1] * t).exp();
///     Ok(Residuals {
///         values: t.iter().zip(&y).map(|(t, y)| model(t) - y).collect(),
///         columns: vec![t.iter().map(|t| (x[1] * t).exp()).collect(), t.iter().map(|t| t * model(t)).collect()],
///     })
/// })?;
/// assert!((fit.point[0] - 2.0).abs() < 1e-9 && (fit.point[1] + 1.5).abs() < 1e-9, "{fit:?}");
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct LevenbergMarquardt {
    /// Evaluations of the residuals at most.
    pub evaluations: usize,
    /// Stops when the cosine between the residuals and every column of the Jacobian is below this.
    pub gradient_tolerance: f64,
    /// Stops when a step is shorter than this, relative to the point, in scaled parameters.
    pub step_tolerance: f64,
    /// Stops when a step lowers the cost by less than this share.
    pub value_tolerance: f64,
    /// The first damping, relative to the scaled `JᵀJ`, whose diagonal is 1.
    pub damping: f64,
    /// Directions count as undetermined when the scaled Jacobian stretches them by less than this, relative to the most: about
    /// the relative accuracy of the columns.
    pub rank_tolerance: f64,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self {
            evaluations: 200,
            gradient_tolerance: 1e-10,
            step_tolerance: 1e-12,
            value_tolerance: 1e-14,
            damping: 1e-3,
            rank_tolerance: 1e-10,
        }
    }
}

/// Residuals at a point.
///
/// ```
/// use gradreel::optim::Residuals;
/// // r = (x, 2 x) at x = 3
/// let residuals = Residuals { values: vec![3.0, 6.0], columns: vec![vec![1.0, 2.0]] };
/// assert_eq!(residuals.columns.len(), 1);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Residuals {
    /// `rᵢ`.
    pub values: Vec<f64>,
    /// `∂r/∂xⱼ`, one column per parameter. May be empty when only the values were asked for.
    pub columns: Vec<Vec<f64>>,
}

/// Why the search ended.
///
/// ```
/// use gradreel::optim::{LevenbergMarquardt, Residuals};
/// // through the points (0, 1), (1, 3), (2, 5)
/// let fit = LevenbergMarquardt::default().minimise(&[0.0, 0.0], &mut |x, _| {
///     let values = (0..3).map(|t| x[0] + x[1] * f64::from(t) - f64::from(1 + 2 * t)).collect();
///     Ok(Residuals { values, columns: vec![vec![1.0; 3], vec![0.0, 1.0, 2.0]] })
/// })?;
/// println!("{:?}", fit.stop);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The residuals are orthogonal to the Jacobian, or zero: a stationary point.
    Gradient,
    /// The last step was negligible.
    Step,
    /// The last step lowered the cost by a negligible share.
    Value,
    /// No step of any length lowers the cost: the limit of precision, or a Jacobian that does not belong to the residuals.
    Stalled,
    /// The evaluations are used up; the point is not a minimum.
    Evaluations,
}

/// What was found.
///
/// ```
/// use gradreel::optim::{LevenbergMarquardt, Residuals};
/// // through the points (0, 1), (1, 3), (2, 5)
/// let fit = LevenbergMarquardt::default().minimise(&[0.0, 0.0], &mut |x, _| {
///     let values = (0..3).map(|t| x[0] + x[1] * f64::from(t) - f64::from(1 + 2 * t)).collect();
///     Ok(Residuals { values, columns: vec![vec![1.0; 3], vec![0.0, 1.0, 2.0]] })
/// })?;
/// assert!((fit.point[1] - 2.0).abs() < 1e-9);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Fit {
    /// The parameters.
    pub point: Vec<f64>,
    /// The residuals there.
    pub residuals: Vec<f64>,
    /// `½ Σ rᵢ²`.
    pub cost: f64,
    /// Why the search ended.
    pub stop: Stop,
    /// Evaluations of the residuals used.
    pub evaluations: usize,
    /// Evaluations of the Jacobian used, among those.
    pub jacobians: usize,
    /// The variance of one residual, `Σ rᵢ² / (m − rank)`; none when there are no more residuals than determined directions.
    pub variance: Option<f64>,
    /// Row-major covariance of the parameters, `variance · (JᵀJ)⁻¹`, within the determined directions. With no variance it is
    /// `(JᵀJ)⁻¹` alone.
    pub covariance: Vec<Vec<f64>>,
    /// Unit vectors in the space of the parameters along which the residuals do not change to first order.
    pub undetermined: Vec<Vec<f64>>,
}

impl Fit {
    /// The standard deviation of each parameter: infinite for one that takes part in an undetermined direction, NaN without a
    /// variance.
    ///
    /// ```
    /// use gradreel::optim::{LevenbergMarquardt, Residuals};
    /// // through the points (0, 1), (1, 3), (2, 5)
    /// let fit = LevenbergMarquardt::default().minimise(&[0.0, 0.0], &mut |x, _| {
    ///     let values = (0..3).map(|t| x[0] + x[1] * f64::from(t) - f64::from(1 + 2 * t)).collect();
    ///     Ok(Residuals { values, columns: vec![vec![1.0; 3], vec![0.0, 1.0, 2.0]] })
    /// })?;
    /// assert!(fit.standard_errors().iter().all(|error| *error < 1e-6));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn standard_errors(&self) -> Vec<f64> {
        let takes_part = |i: usize| self.undetermined.iter().any(|direction| direction[i].abs() > 1e-6);
        let error = |i: usize| match self.variance {
            _ if takes_part(i) => f64::INFINITY,
            Some(_) => self.covariance[i][i].sqrt(),
            None => f64::NAN,
        };
        (0..self.point.len()).map(error).collect()
    }
}

/// The function: residuals at a point, with their Jacobian where the flag says so.
type Model<'a> = dyn FnMut(&[f64], bool) -> Result<Residuals> + 'a;

impl LevenbergMarquardt {
    /// Minimises from `start`. `model(x, jacobian)` gives the residuals at `x`, and their Jacobian when it is asked for (it may
    /// always give both). A trial where residuals or derivatives are not finite is stepped back from.
    ///
    /// ```
    /// use gradreel::optim::{LevenbergMarquardt, Residuals};
    /// // through the points (0, 1), (1, 3), (2, 5)
    /// let fit = LevenbergMarquardt::default().minimise(&[0.0, 0.0], &mut |x, _| {
    ///     let values = (0..3).map(|t| x[0] + x[1] * f64::from(t) - f64::from(1 + 2 * t)).collect();
    ///     Ok(Residuals { values, columns: vec![vec![1.0; 3], vec![0.0, 1.0, 2.0]] })
    /// })?;
    /// assert!((fit.point[0] - 1.0).abs() < 1e-9 && (fit.point[1] - 2.0).abs() < 1e-9);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] when residuals or derivatives at the start are not finite;
    /// [`ErrorKind::Shape`] when the numbers of residuals or columns change; what `model` returns.
    pub fn minimise(&self, start: &[f64], model: &mut Model<'_>) -> Result<Fit> {
        let n = start.len();
        let mut x = start.to_vec();
        let mut at = model(&x, true)?;
        let m = at.values.len();
        check(&at, m, n, true)?;
        if !at.values.iter().all(|r| r.is_finite()) {
            return Err(not_finite("residual", &x));
        }
        if !finite(&at.columns) {
            return Err(not_finite("derivative", &x));
        }
        let (mut evaluations, mut jacobians) = (1, 1);
        let mut cost = half_square(&at.values);
        let mut scale = vec![0.0f64; n];
        let (mut damping, mut growth) = (self.damping, 2.0);
        let stop = 'search: loop {
            for (scale, column) in scale.iter_mut().zip(&at.columns) {
                *scale = scale.max((2.0 * half_square(column)).sqrt());
            }
            let qr = Triangle::of(&at, &scale);
            if qr.cosine(&at, &scale) <= self.gradient_tolerance {
                break Stop::Gradient;
            }
            loop {
                if evaluations >= self.evaluations {
                    break 'search Stop::Evaluations;
                }
                // in scaled parameters
                let step = qr.damped_step(damping);
                let moved = norm(&step);
                let size = x.iter().zip(&scale).map(|(x, s)| (x * s).powi(2)).sum::<f64>().sqrt();
                if moved <= self.step_tolerance * (size + self.step_tolerance) {
                    break 'search Stop::Step;
                }
                let trial: Vec<f64> =
                    x.iter().zip(&step).zip(&scale).map(|((x, h), s)| x + h / unit_if_zero(*s)).collect();
                if trial == x {
                    break 'search Stop::Step;
                }
                let next = model(&trial, false)?;
                check(&next, m, n, false)?;
                evaluations += 1;
                let new_cost = half_square(&next.values);
                let gain = (cost - new_cost) / qr.predicted(&step, damping);
                let better = new_cost.is_finite() && cost > new_cost && gain > 0.0;
                // where there is no derivative the search could not go on
                let next = match better {
                    true if next.columns.len() == n => Some(next),
                    true => Some(model(&trial, true)?),
                    false => None,
                };
                if let Some(next) = &next {
                    check(next, m, n, true)?;
                }
                if let Some(next) = next.filter(|next| finite(&next.columns)) {
                    let little = cost - new_cost <= self.value_tolerance * cost;
                    // never so little that rounding decides along undetermined directions
                    damping = (damping * (1.0f64 / 3.0).max(1.0 - (2.0 * gain - 1.0).powi(3))).max(1e-16);
                    growth = 2.0;
                    (x, cost, at) = (trial, new_cost, next);
                    jacobians += 1;
                    if little {
                        break 'search Stop::Value;
                    }
                    break;
                }
                damping *= growth;
                growth *= 2.0;
                if damping > 1e30 {
                    break 'search Stop::Stalled;
                }
            }
        };
        self.report(x, at, stop, [evaluations, jacobians])
    }

    /// Covariance and undetermined directions from the singular values of the scaled Jacobian.
    fn report(&self, point: Vec<f64>, at: Residuals, stop: Stop, [evaluations, jacobians]: [usize; 2]) -> Result<Fit> {
        let (n, m) = (point.len(), at.values.len());
        let scale: Vec<f64> = at.columns.iter().map(|column| (2.0 * half_square(column)).sqrt()).collect();
        let qr = Triangle::of(&at, &scale);
        let r = Mat::from_fn(n, n, |i, j| qr.r[i][j]);
        let svd = r.svd().map_err(|e| {
            Error::new(ErrorKind::NonFinite, "no singular values of the Jacobian").found(format!("{e:?}"))
        })?;
        let (s, v) = (svd.S().column_vector(), svd.V());
        let largest = (0..n).map(|k| s[k]).fold(0.0, f64::max);
        let is_determined = |k: usize| s[k] > self.rank_tolerance * largest;
        // column k of V in the parameters' own units
        let direction = |k: usize| (0..n).map(|i| v[(i, k)] / unit_if_zero(scale[i])).collect::<Vec<f64>>();
        let mut undetermined = Vec::new();
        let mut covariance = vec![vec![0.0; n]; n];
        let mut rank = 0;
        for k in 0..n {
            let d = direction(k);
            if !is_determined(k) {
                let len = norm(&d);
                undetermined.push(d.into_iter().map(|d| d / len).collect());
                continue;
            }
            rank += 1;
            for i in 0..n {
                for j in 0..n {
                    covariance[i][j] += d[i] * d[j] / (s[k] * s[k]);
                }
            }
        }
        let cost = half_square(&at.values);
        let variance = (m > rank).then(|| 2.0 * cost / (m - rank) as f64);
        covariance.iter_mut().flatten().for_each(|c| *c *= variance.unwrap_or(1.0));
        let residuals = at.values;
        Ok(Fit { point, residuals, cost, stop, evaluations, jacobians, variance, covariance, undetermined })
    }
}

/// The scaled Jacobian as `Q R`, and `Qᵀ r`.
struct Triangle {
    r: Vec<Vec<f64>>,
    qr: Vec<f64>,
}

impl Triangle {
    fn of(at: &Residuals, scale: &[f64]) -> Self {
        let (n, m) = (scale.len(), at.values.len());
        let columns: Vec<(&[f64], f64)> =
            at.columns.iter().zip(scale).map(|(c, s)| (&c[..], 1.0 / unit_if_zero(*s))).collect();
        let (r, qr) = triangle(n, m, |i, j| if j < n { columns[j].0[i] * columns[j].1 } else { at.values[i] });
        Self { r, qr }
    }

    /// The largest cosine between the residuals and a column.
    fn cosine(&self, at: &Residuals, scale: &[f64]) -> f64 {
        let length = norm(&at.values);
        if length == 0.0 {
            return 0.0;
        }
        let n = scale.len();
        let cosine = |j: usize| {
            let column = norm(&at.columns[j]) / unit_if_zero(scale[j]);
            let along: f64 = (0..n).map(|i| self.r[i][j] * self.qr[i]).sum();
            if column == 0.0 { 0.0 } else { along.abs() / (column * length) }
        };
        (0..n).map(cosine).fold(0.0, f64::max)
    }

    /// `argmin ‖R h + Qᵀr‖² + μ ‖h‖²`.
    fn damped_step(&self, damping: f64) -> Vec<f64> {
        let n = self.qr.len();
        let root = damping.sqrt();
        let (r, q) = triangle(n, 2 * n, |i, j| match (i < n, j < n) {
            (true, true) => self.r[i][j],
            (true, false) => -self.qr[i],
            (false, true) => {
                if i - n == j {
                    root
                } else {
                    0.0
                }
            }
            (false, false) => 0.0,
        });
        let mut h = vec![0.0; n];
        for i in (0..n).rev() {
            let rest: f64 = (i + 1..n).map(|j| r[i][j] * h[j]).sum();
            h[i] = (q[i] - rest) / r[i][i];
        }
        h
    }

    /// How much the linear model lowers the cost: `½ hᵀ(μ h − g)`.
    fn predicted(&self, step: &[f64], damping: f64) -> f64 {
        let n = self.qr.len();
        let gradient = |j: usize| (0..n).map(|i| self.r[i][j] * self.qr[i]).sum::<f64>();
        (0..n).map(|j| 0.5 * step[j] * (damping * step[j] - gradient(j))).sum()
    }
}

/// `R` and `Qᵀ b` of the `m × n` matrix with `b` as its last column.
fn triangle(n: usize, m: usize, element: impl Fn(usize, usize) -> f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    // rows of zeros make it tall where there are few residuals; they change no product
    let matrix = Mat::from_fn(m.max(n + 1), n + 1, |i, j| if i < m { element(i, j) } else { 0.0 });
    let qr = matrix.qr();
    let whole = qr.thin_R();
    let at = |i: usize, j: usize| if i <= j { whole[(i, j)] } else { 0.0 };
    ((0..n).map(|i| (0..n).map(|j| at(i, j)).collect()).collect(), (0..n).map(|i| at(i, n)).collect())
}

fn check(at: &Residuals, m: usize, n: usize, columns: bool) -> Result<()> {
    let columns_fit = match at.columns.len() {
        0 => !columns || n == 0,
        count => count == n && at.columns.iter().all(|column| column.len() == m),
    };
    if at.values.len() == m && columns_fit {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Shape, "the residuals or their Jacobian have another size")
        .found(format!(
            "{} residuals, columns of {:?}",
            at.values.len(),
            at.columns.iter().map(Vec::len).collect::<Vec<_>>()
        ))
        .wanted(format!("{m} residuals and {n} columns of {m}")))
}

fn finite(columns: &[Vec<f64>]) -> bool {
    columns.iter().flatten().all(|derivative| derivative.is_finite())
}

fn not_finite(what: &str, x: &[f64]) -> Error {
    Error::new(ErrorKind::NonFinite, format!("least squares: a {what} is not finite")).at(format!("{x:?}"))
}

fn half_square(values: &[f64]) -> f64 {
    0.5 * values.iter().map(|v| v * v).sum::<f64>()
}

fn norm(values: &[f64]) -> f64 {
    (2.0 * half_square(values)).sqrt()
}

fn unit_if_zero(scale: f64) -> f64 {
    if scale == 0.0 { 1.0 } else { scale }
}
