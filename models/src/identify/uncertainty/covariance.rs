//! The posterior of one hypothesis: normal equations under a covariance of what errs together, times the prior.

use faer::Mat;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::prior::Prior;

/// The likelihood of a hypothesis around a point, to second order: what [`Problem::linearise`](crate::identify::Problem) found there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Expansion {
    /// Coordinates of the free unknowns.
    pub x: Vec<f64>,
    /// The mean of `ln L` over the frames, its gradient and its curvature as Gauss and Newton see it.
    pub log_loss: f64,
    pub gradient: Vec<f64>,
    pub curvature: Vec<Vec<f64>>,
    /// Pictures that count.
    pub pictures: usize,
}

/// A normal posterior, and how probable its hypothesis is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Laplace {
    pub mean: Vec<f64>,
    pub covariance: Vec<Vec<f64>>,
    /// `log p(y | h)`, but for a constant that all hypotheses share.
    pub log_evidence: f64,
}

impl Expansion {
    /// Laplace's approximation under `Σ = σ² I + B Bᵀ` with an unknown `σ` and columns `B = J D^{1/2}`: what errs together acts as if the
    /// unknowns were off by `N(0, D)`.
    ///
    /// With `n` independent residuals a frame of unknown deviation the likelihood is `Π L^{−n/2}`, so that near `x` its logarithm is
    /// `−½ Σ n ln L − gᵀu − ½ uᵀΛu` with `g = Σ n ∇L/2L` and `Λ = Σ n C/2L`. Integrated over `N(0, D)` (Woodbury's identity) these become `(I + ΛD)⁻¹ g` and
    /// `(I + ΛD)⁻¹ Λ`, which are finite also where no picture tells anything; the prior adds its own. They make the covariance and the
    /// evidence. The mean is the most probable place without them, `x − (Λ + P⁻¹)⁻¹ (g + P⁻¹ (x − m))`: what errs together widens what
    /// is known, and does not move it towards the prior.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] when the expansion is not finite.
    pub fn posterior(&self, prior: &Prior<'_>, discrepancy: &[Vec<f64>], residuals: f64) -> Result<Laplace> {
        let n = self.x.len();
        let count = residuals * self.pictures as f64;
        let share = 0.5 * count;
        let lambda = Mat::from_fn(n, n, |i, j| share * self.curvature[i][j]);
        let gradient = Mat::from_fn(n, 1, |i, _| share * self.gradient[i]);
        let d = Mat::from_fn(n, n, |i, j| discrepancy.iter().map(|column| column[i] * column[j]).sum::<f64>());
        let mixed = (Mat::<f64>::identity(n, n) + &lambda * &d).partial_piv_lu();
        let (lambda, lambda_bare, reduced) = (mixed.solve(&lambda), lambda, mixed.solve(&gradient));
        let off = Mat::from_fn(n, 1, |i, _| prior.mean[i] - self.x[i]);
        let pull = &prior.precision * &off;
        let precision = Mat::from_fn(n, n, |i, j| {
            // symmetric but for rounding
            0.5 * (lambda[(i, j)] + lambda[(j, i)]) + prior.precision[(i, j)]
        });
        let right = Mat::from_fn(n, 1, |i, _| pull[(i, 0)] - reduced[(i, 0)]);
        let bare = Mat::from_fn(n, n, |i, j| lambda_bare[(i, j)] + prior.precision[(i, j)]);
        let mode = bare.partial_piv_lu().solve(Mat::from_fn(n, 1, |i, _| pull[(i, 0)] - gradient[(i, 0)]));
        let solver = precision.partial_piv_lu();
        let moved = solver.solve(&right);
        let covariance = solver.inverse();
        let dot = |a: &Mat<f64>, b: &Mat<f64>| (0..n).map(|i| a[(i, 0)] * b[(i, 0)]).sum::<f64>();
        let explained = &d * &reduced;
        let log_det = |matrix: f64| matrix.abs().max(f64::MIN_POSITIVE).ln();
        let log_evidence = -share * self.log_loss - 0.5 * log_det(mixed_determinant(&mixed))
            + 0.5 * dot(&gradient, &explained)
            - 0.5 * dot(&off, &pull)
            - 0.5 * prior.log_determinant()
            - 0.5 * log_det(mixed_determinant(&solver))
            + 0.5 * dot(&right, &moved);
        let finite = log_evidence.is_finite() && (0..n).all(|i| covariance[(i, i)] > 0.0 && mode[(i, 0)].is_finite());
        if !finite {
            return Err(Error::new(ErrorKind::NonFinite, "the posterior of a hypothesis is not finite").at("posterior"));
        }
        Ok(Laplace {
            mean: (0..n).map(|i| self.x[i] + mode[(i, 0)]).collect(),
            covariance: (0..n).map(|i| (0..n).map(|j| covariance[(i, j)]).collect()).collect(),
            log_evidence,
        })
    }

    /// The curvature of the likelihood along one coordinate, the others following it as the posterior expects, `uᵀΛu`.
    pub fn along(&self, laplace: &Laplace, k: usize, residuals: f64) -> f64 {
        let share = 0.5 * residuals * self.pictures as f64;
        let u: Vec<f64> = laplace.covariance.iter().map(|row| row[k] / laplace.covariance[k][k]).collect();
        let n = u.len();
        share
            * (0..n)
                .flat_map(|i| (0..n).map(move |j| (i, j)))
                .map(|(i, j)| u[i] * self.curvature[i][j] * u[j])
                .sum::<f64>()
    }
}

fn mixed_determinant(lu: &faer::linalg::solvers::PartialPivLu<f64>) -> f64 {
    let u = lu.U();
    (0..u.nrows()).map(|i| u[(i, i)]).product()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::{Free, Unknowns};
    use crate::physics::materials;

    fn expansion(x: [f64; 2], gradient: [f64; 2], curvature: [[f64; 2]; 2]) -> Expansion {
        let curvature = curvature.map(|row| row.to_vec()).to_vec();
        Expansion { x: x.to_vec(), log_loss: -3.0, gradient: gradient.to_vec(), curvature, pictures: 10 }
    }

    /// Against the posterior of a datum `x̂ ~ N(x, K)` with `K = Λ⁻¹ + D`, written out.
    #[test]
    fn a_discrepancy_adds_to_the_covariance_of_what_the_pictures_say() {
        let law = materials::find("neo_hookean").unwrap();
        let start = Unknowns { parameters: vec![1e5, 0.3], ..Unknowns::default() };
        let prior = Prior::of(&law, Free::Material, &start, None);
        let x = [4.6, prior.mean[1]];
        // ten pictures, two residuals each: Λ = 10 C
        let found = expansion(x, [0.0; 2], [[4.0, 0.0], [0.0, 9.0]]);
        let discrepancy = vec![vec![0.2, 0.0], vec![0.0, 0.1]];
        let laplace = found.posterior(&prior, &discrepancy, 2.0).unwrap();
        for (k, (curvature, own)) in [(4.0, 0.2f64), (9.0, 0.1)].into_iter().enumerate() {
            let wide = 1.0 / (10.0 * curvature) + own * own;
            let before = prior.deviations()[k].powi(2);
            let variance = 1.0 / (1.0 / wide + 1.0 / before);
            approx::assert_relative_eq!(laplace.covariance[k][k], variance, max_relative = 1e-9);
            // the discrepancy does not move it
            let told = 10.0 * curvature;
            let mean = (x[k] * told + prior.mean[k] / before) / (told + 1.0 / before);
            approx::assert_relative_eq!(laplace.mean[k], mean, max_relative = 1e-9);
        }
        // evidence: how probable such a datum is under prior and covariance, and how well it is fitted
        let datum: f64 = (0..2)
            .map(|k| {
                let (curvature, own) = [(4.0, 0.2), (9.0, 0.1)][k];
                let (data, d): (f64, f64) = (1.0 / (10.0 * curvature), own * own);
                let whole = data + d + prior.deviations()[k].powi(2);
                0.5 * (data / whole).ln() - 0.5 * (x[k] - prior.mean[k]).powi(2) / whole
            })
            .sum();
        approx::assert_relative_eq!(laplace.log_evidence, 0.5 * 20.0 * 3.0 + datum, max_relative = 1e-9);
    }

    /// A point beside the minimum says what the minimum says.
    #[test]
    fn the_posterior_does_not_hang_on_where_it_is_expanded() {
        let law = materials::find("neo_hookean").unwrap();
        let start = Unknowns { parameters: vec![1e5, 0.3], ..Unknowns::default() };
        let prior = Prior::of(&law, Free::Material, &start, None);
        let curvature = [[4.0, 1.0], [1.0, 3.0]];
        let here = expansion([4.8, 2.0], [0.0; 2], curvature);
        let off = [0.1, -0.2];
        let gradient = [0, 1].map(|i| curvature[i][0] * off[0] + curvature[i][1] * off[1]);
        let rise = 0.5 * (off[0] * gradient[0] + off[1] * gradient[1]);
        let mut beside = expansion([4.9, 1.8], gradient, curvature);
        beside.log_loss += rise;
        let columns = vec![vec![0.3, 0.1]];
        let [a, b] = [here, beside].map(|found| found.posterior(&prior, &columns, 1.0).unwrap());
        approx::assert_relative_eq!(a.mean[..], b.mean[..], max_relative = 1e-9);
        approx::assert_relative_eq!(a.log_evidence, b.log_evidence, max_relative = 1e-9);
    }

    #[test]
    fn what_no_picture_shows_is_as_the_prior_has_it() {
        let law = materials::find("neo_hookean").unwrap();
        let start = Unknowns { parameters: vec![1e5, 0.3], ..Unknowns::default() };
        let prior = Prior::of(&law, Free::Material, &start, None);
        let blind = expansion([6.0, 2.0], [0.0; 2], [[0.0; 2]; 2]);
        let laplace = blind.posterior(&prior, &[vec![0.1, 0.0]], 1.0).unwrap();
        approx::assert_relative_eq!(laplace.mean[..], prior.mean[..], max_relative = 1e-9);
        approx::assert_relative_eq!(laplace.covariance[0][0].sqrt(), prior.deviations()[0], max_relative = 1e-9);
        let lost = Expansion { log_loss: f64::NAN, ..blind };
        assert_eq!(lost.posterior(&prior, &[], 1.0).unwrap_err().kind(), ErrorKind::NonFinite);
    }
}
