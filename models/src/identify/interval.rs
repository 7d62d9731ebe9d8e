//! How sure an estimate is: intervals from the curvature of the loss and from how the pictures disagree about it.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::identify::fall::Fallen;
use crate::identify::plausible::Plausible;
use crate::identify::profile::Valley;
use crate::identify::unknowns::Unknown;
use crate::identify::{Free, Linearised, Unknowns};
use crate::physics::{Law, Map, NINETY};
use crate::video::Flight;

/// What is known of one unknown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Name of the parameter, or `velocity_x`, `spin_x` and so on, `contact`, `lean_right`, `lean_up`, `farther`.
    pub name: String,
    /// Ends of the interval that holds the truth in nine of ten cases, in the unknown's unit.
    pub interval_90: [f64; 2],
    /// Whether the clip says clearly more than what is plausible of any such material: whether the interval is at most a
    /// third as wide as the plausible range (in decades for magnitudes).
    pub determined: bool,
}

/// Intervals of 90 % for the free unknowns at a minimum of the loss.
///
/// Residuals of neighbouring pixels are not independent: what is left is the error of shape, grid and light, alike over a
/// whole picture, and in all pictures of a camera or of a moment. So the covariance is the *cluster-robust sandwich*
/// `C⁻¹ M C⁻¹` with the curvature `C` and the scatter `M` of the parts that cameras, and that frames, have in the gradient:
/// `M = Σ_cameras s sᵀ n/(n−1) + Σ_frames s sᵀ m/(m−1)` (Cameron, Gelbach and Miller 2011, without the term for their overlap,
/// on the safe side). Pixels are no smooth functions, and a loss may stay low farther than its curvature says: `wider` is how many times
/// farther it does along each parameter, and scales its deviation. Each vector of `bias`, a column of `B`, is a further deviation that is the same in all pictures, such as that of the
/// grid, in which the coordinates go together: `K = C⁻¹ M C⁻¹ + B Bᵀ`. What is plausible beforehand, and what the flight of an object that a single camera saw says of its velocity, is
/// added as a prior of covariance `P`, `Σ = (K⁻¹ + P⁻¹)⁻¹`, so that a direction that no picture shows keeps
/// the width of what is plausible; of a parameter with bounds no interval leaves its prior range. Student's t for as many degrees of freedom as there are clusters of the rarer kind, less one.
///
/// # Errors
/// [`ErrorKind::NonFinite`] when the derivatives, or the flight's covariance, are not finite.
pub fn intervals(
    at: &Unknowns,
    law: &Law,
    free: Free,
    linearised: &Linearised,
    wider: &[f64],
    bias: &[Vec<f64>],
    flight: Option<&Flight>,
) -> Result<Vec<Interval>> {
    let list = free.list(law);
    let n = list.len();
    let fall = flight.map(|flight| Fallen::of(flight, free.distance())).transpose()?;
    let plausible = Plausible::new(law, free).after(fall.as_ref());
    let prior = plausible.deviations(at);
    let deviations = Known::of(linearised, plausible.factor(at))?.but(wider, bias).deviations()?;
    let student = student(clusters(linearised));
    let x = at.coordinates(law, free);
    let end = |k: usize, sign: f64| {
        let mut x = x.clone();
        x[k] += sign * student * deviations[k];
        list[k].of(&at.moved(law, free, &x))
    };
    let interval = |k: usize| Interval {
        name: list[k].name(law),
        interval_90: within(law, list[k], at, [end(k, -1.0), end(k, 1.0)]),
        determined: student * deviations[k] <= NINETY * prior[k] / 3.0,
    };
    Ok((0..n).map(interval).collect())
}

/// The ends of an interval of an unknown: what bounds a parameter bounds what is known of it, unless the estimate itself lies beyond.
pub(super) fn within(law: &Law, unknown: Unknown, at: &Unknowns, [low, high]: [f64; 2]) -> [f64; 2] {
    match unknown {
        Unknown::Parameter(p) if law.parameters()[p].map != Map::Log10 => {
            let ([least, most], value) = (law.parameters()[p].prior, at.parameters[p]);
            [low.max(least.min(value)), high.min(most.max(value))]
        }
        _ => [low, high],
    }
}

/// The valleys along which the loss is to be looked at before [`intervals`] believes its curvature; nothing for unknowns that are no
/// parameters, and for those that the pictures do not tell.
///
/// # Errors
/// As [`intervals`].
pub(super) fn valleys(
    at: &Unknowns,
    law: &Law,
    free: Free,
    linearised: &Linearised,
    flight: Option<&Flight>,
) -> Result<Vec<Option<Valley>>> {
    let fall = flight.map(|flight| Fallen::of(flight, free.distance())).transpose()?;
    let plausible = Plausible::new(law, free).after(fall.as_ref());
    let known = Known::of(linearised, plausible.factor(at))?;
    let student = student(clusters(linearised));
    let valley = |(k, unknown): (usize, Unknown)| {
        let (flat, end) = (known.inverse[(k, k)], student * known.covariance[(k, k)].max(0.0).sqrt());
        let told = matches!(unknown, Unknown::Parameter(_)) && end > 0.0 && end < NINETY && flat > 0.0;
        if !told {
            return None;
        }
        Some(Valley { way: known.along(k), end, rise: end * end / (2.0 * flat), farthest: NINETY })
    };
    Ok(free.list(law).into_iter().enumerate().map(valley).collect())
}

/// The noise of the loss along each free unknown's coordinate, for the velocity along the directions of the fall,
/// `(C⁻¹ M C⁻¹)_kk / (C⁻¹)_kk` with curvature and scatter as for [`intervals`]: a loss of so much noise that is curved like this one
/// leaves an unknown as unsure as the pictures do.
/// Nowhere less than that of the clip as a whole, `tr M / tr C` in units of what is plausible.
///
/// # Errors
/// As [`intervals`].
pub(super) fn noise(plausible: &Plausible<'_>, at: &Unknowns, linearised: &Linearised) -> Result<Vec<f64>> {
    let known = Known::of(linearised, plausible.factor(at))?;
    let of = |k: usize| (known.covariance[(k, k)] / known.inverse[(k, k)]).max(known.noise);
    Ok((0..linearised.gradient.len()).map(of).collect())
}

/// The most probable coordinates of the free unknowns near the minimum `at` of a loss, `x + K (K + P)⁻¹ (m − x)` with what is
/// expected beforehand, `m`, and the covariances of [`intervals`].
///
/// # Errors
/// As [`intervals`].
pub(super) fn most_probable(
    plausible: &Plausible<'_>,
    at: &Unknowns,
    linearised: &Linearised,
    bias: &[Vec<f64>],
) -> Result<Vec<f64>> {
    let known = Known::of(linearised, plausible.factor(at))?.but(&vec![1.0; linearised.gradient.len()], bias);
    known.pulled_to(plausible, at)
}

/// The same where only the deviations `own` of coordinates, which no picture knows of, are weighed with what is expected; other
/// unknowns follow a parameter as the curvature has it.
///
/// # Errors
/// As [`intervals`].
pub(super) fn more_usual(
    plausible: &Plausible<'_>,
    at: &Unknowns,
    linearised: &Linearised,
    own: &[f64],
) -> Result<Vec<f64>> {
    let known = Known::of(linearised, plausible.factor(at))?;
    let unsure = own.iter().enumerate().filter(|(_, own)| **own > 0.0);
    let following = |(k, own): (usize, &f64)| {
        let way = known.along(k);
        way.iter().map(|moved| own * moved / way[k]).collect()
    };
    let bias: Vec<Vec<f64>> = unsure.map(following).collect();
    known.but(&vec![0.0; own.len()], &bias).pulled_to(plausible, at)
}

/// What the clip alone tells of the unknowns, in units in which the prior's covariance is the unit matrix, so that everything is of
/// one kind.
struct Known {
    /// A standard deviation of the prior in each column.
    prior: Mat<f64>,
    /// The inverse of the curvature; directions that no picture shows at all have a huge one.
    inverse: Mat<f64>,
    /// The sandwich of the curvature and the scatter, and what was added to it ([`Known::but`]).
    covariance: Mat<f64>,
    /// Directions that no picture shows.
    unseen: Vec<Vec<f64>>,
    /// Trace of the scatter over that of the curvature.
    noise: f64,
}

impl Known {
    fn of(at: &Linearised, prior: Mat<f64>) -> Result<Self> {
        let n = at.gradient.len();
        let in_units = |m: &[Vec<f64>]| prior.transpose() * Mat::from_fn(n, n, |i, j| m[i][j]) * &prior;
        let curvature = in_units(&at.curvature);
        let scatter = in_units(&scatter(at));
        let eigen = curvature.self_adjoint_eigen(Side::Lower).map_err(failed)?;
        let (u, s) = (eigen.U(), eigen.S().column_vector());
        let most = (0..n).fold(0.0f64, |m, k| m.max(s[k]));
        if !(most.is_finite()) {
            return Err(Error::new(ErrorKind::NonFinite, "the curvature of the loss is not finite").at("intervals"));
        }
        // directions that no picture shows at all stand at a floor: they come out far wider than the prior
        let floor = (1e-12 * most).max(f64::MIN_POSITIVE);
        let inverse = Mat::from_fn(n, n, |i, j| (0..n).map(|k| u[(i, k)] * u[(j, k)] / s[k].max(floor)).sum::<f64>());
        let covariance = &inverse * &scatter * &inverse;
        let direction = |k: usize| (0..n).map(|i| u[(i, k)]).collect();
        let unseen = (0..n).filter(|&k| s[k] <= floor).map(direction).collect();
        let trace = |matrix: &Mat<f64>| (0..n).map(|k| matrix[(k, k)]).sum::<f64>();
        let noise = trace(&scatter) / trace(&curvature).max(f64::MIN_POSITIVE);
        Ok(Self { prior, inverse, covariance, unseen, noise })
    }

    /// The same, but each coordinate so many times less sure, and with a deviation that all pictures share.
    fn but(mut self, wider: &[f64], bias: &[Vec<f64>]) -> Self {
        let n = wider.len();
        let bias = in_units_of(&self.prior, &Mat::from_fn(n, bias.len(), |i, cause| bias[cause][i]));
        let pictures = Mat::from_fn(n, n, |i, j| wider[i] * wider[j] * self.covariance[(i, j)]);
        self.covariance = pictures + &bias * bias.transpose();
        self
    }

    /// The standard deviation of each coordinate, the prior counted in.
    fn deviations(&self) -> Result<Vec<f64>> {
        let n = self.prior.nrows();
        // (K⁻¹ + 1)⁻¹ = V diag(σ/(σ+1)) Vᵀ; directions without any score are not known, not known exactly
        let eigen = self.covariance.self_adjoint_eigen(Side::Lower).map_err(failed)?;
        let (v, sigma) = (&self.prior * eigen.U(), eigen.S().column_vector());
        let variance = |i: usize| {
            let seen: f64 = (0..n).map(|k| v[(i, k)].powi(2) * share(sigma[k])).sum();
            let along = |direction: &Vec<f64>| (0..n).map(|k| self.prior[(i, k)] * direction[k]).sum::<f64>();
            let hidden: f64 = self.unseen.iter().map(|direction| along(direction).powi(2)).sum();
            seen.max(hidden)
        };
        Ok((0..n).map(|i| variance(i).max(0.0).sqrt()).collect())
    }

    /// How the coordinates move along the valley of the loss when the `k`-th moves by a deviation of its prior.
    fn along(&self, k: usize) -> Vec<f64> {
        let flat = self.inverse[(k, k)];
        let n = self.prior.nrows();
        (0..n).map(|i| (0..n).map(|j| self.prior[(i, j)] * self.inverse[(j, k)]).sum::<f64>() / flat).collect()
    }

    /// Where the prior pulls the coordinates of unknowns.
    fn pulled_to(&self, plausible: &Plausible<'_>, at: &Unknowns) -> Result<Vec<f64>> {
        let x = at.coordinates(plausible.law, plausible.free);
        let off: Vec<f64> = plausible.expected(at).iter().zip(&x).map(|(expected, x)| expected - x).collect();
        Ok(x.iter().zip(self.pulled(&off)?).map(|(x, pull)| x + pull).collect())
    }

    /// How far the prior pulls the coordinates if its middle is `off` away: `K (K + P)⁻¹ off`.
    fn pulled(&self, off: &[f64]) -> Result<Vec<f64>> {
        let eigen = self.covariance.self_adjoint_eigen(Side::Lower).map_err(failed)?;
        let (v, sigma) = (eigen.U(), eigen.S().column_vector());
        let n = off.len();
        let along = v.transpose() * in_units_of(&self.prior, &Mat::from_fn(n, 1, |i, _| off[i]));
        let pulled = &self.prior * v * Mat::from_fn(n, 1, |k, _| share(sigma[k]) * along[(k, 0)]);
        Ok((0..n).map(|i| pulled[(i, 0)]).collect())
    }
}

/// Columns of coordinates in units of the prior.
fn in_units_of(prior: &Mat<f64>, columns: &Mat<f64>) -> Mat<f64> {
    prior.partial_piv_lu().solve(columns)
}

fn failed(_: faer::linalg::evd::EvdError) -> Error {
    Error::new(ErrorKind::NonFinite, "no eigenvalues of the curvature of the loss").at("intervals")
}

/// `σ/(σ + 1)` for `σ` from 0 to ∞.
fn share(sigma: f64) -> f64 {
    let sigma = sigma.max(0.0);
    if sigma.is_finite() { sigma / (sigma + 1.0) } else { 1.0 }
}

/// How the parts of cameras and frames in the gradient scatter.
fn scatter(at: &Linearised) -> Vec<Vec<f64>> {
    let n = at.gradient.len();
    let mut total = vec![vec![0.0; n]; n];
    let kinds: [&dyn Fn(&crate::identify::Score) -> usize; 2] = [&|s| s.camera, &|s| s.frame];
    for kind in kinds {
        let mut sums = std::collections::BTreeMap::<usize, Vec<f64>>::new();
        for score in &at.scores {
            let sum = sums.entry(kind(score)).or_insert_with(|| vec![0.0; n]);
            sum.iter_mut().zip(&score.gradient).for_each(|(sum, g)| *sum += g);
        }
        let count = sums.len() as f64;
        if count < 2.0 {
            continue;
        }
        for part in sums.values() {
            for i in 0..n {
                for j in 0..n {
                    total[i][j] += part[i] * part[j] * count / (count - 1.0);
                }
            }
        }
    }
    total
}

/// Clusters of the rarer kind of which there are several.
fn clusters(at: &Linearised) -> usize {
    let of = |values: Vec<usize>| values.into_iter().collect::<std::collections::BTreeSet<_>>().len();
    let (cameras, frames) =
        (of(at.scores.iter().map(|s| s.camera).collect()), of(at.scores.iter().map(|s| s.frame).collect()));
    if cameras.min(frames) > 1 { cameras.min(frames) } else { cameras.max(frames) }
}

/// The 95 % quantile of Student's t for `clusters − 1` degrees of freedom (Cornish and Fisher's expansion).
fn student(clusters: usize) -> f64 {
    let (z, nu) = (1.644_854_f64, clusters.saturating_sub(1).max(1) as f64);
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    z + (z.powi(3) + z) / 4.0 / nu + second / (nu * nu)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::Score;

    #[test]
    fn students_quantiles() {
        for (clusters, wanted) in [(7, 1.943), (14, 1.771), (1000, 1.646)] {
            approx::assert_relative_eq!(student(clusters), wanted, max_relative = 3e-3);
        }
    }

    /// Pictures that each measure `x` with an independent error, and `y` not at all.
    #[test]
    fn a_mean_has_the_deviation_of_a_mean_and_what_is_not_seen_keeps_its_prior() {
        let (cameras, frames) = (6, 12);
        let error = |camera: usize| (camera as f64 * 2.4).sin();
        let mean = (0..cameras).map(error).sum::<f64>() / cameras as f64;
        // loss = Σ (x + e_camera)²/2: gradient Σ (x + e), at its minimum x = −mean; each camera's error is alike in all frames
        let scores = (0..cameras * frames).map(|i| Score {
            frame: i / cameras,
            camera: i % cameras,
            gradient: vec![error(i % cameras) - mean, 0.0],
        });
        let curvature = vec![vec![(cameras * frames) as f64, 0.0], vec![0.0, 0.0]];
        let at = Linearised { loss: 1.0, gradient: vec![0.0, 0.0], curvature, scores: scores.collect() };
        let prior = || Mat::from_fn(2, 2, |i, j| if i == j { [100.0, 3.0][i] } else { 0.0 });
        let known = Known::of(&at, prior()).unwrap();
        let found = known.deviations().unwrap();
        let spread = (0..cameras).map(|c| (error(c) - mean).powi(2)).sum::<f64>() / (cameras as f64 - 1.0);
        let wanted = (spread / cameras as f64).sqrt();
        approx::assert_relative_eq!(found[0], wanted, max_relative = 1e-3);
        approx::assert_relative_eq!(found[1], 3.0, max_relative = 1e-6);
        // the same noise per curvature, which makes the deviation what it is
        let curvature = (cameras * frames) as f64;
        let of_x = known.covariance[(0, 0)] / known.inverse[(0, 0)];
        approx::assert_relative_eq!((of_x / curvature).sqrt(), wanted, max_relative = 1e-3);
        // an error that all pictures share adds its square
        let biased = Known::of(&at, prior()).unwrap().but(&[1.0; 2], &[vec![0.5, 0.0]]).deviations().unwrap();
        approx::assert_relative_eq!(biased[0], wanted.hypot(0.5), max_relative = 1e-3);
        // and a loss that stays low twice as far doubles it
        let wider = Known::of(&at, prior()).unwrap().but(&[2.0, 1.0], &[]).deviations().unwrap();
        approx::assert_relative_eq!(wider[0], 2.0 * wanted, max_relative = 1e-3);
    }

    /// What no picture knows of is weighed with what is usual, and the other unknowns follow along the valley.
    #[test]
    fn a_ratio_becomes_more_usual_along_the_valley() {
        let law = crate::physics::materials::find("neo_hookean").unwrap();
        let at = Unknowns { parameters: vec![1e5, 0.2], ..Unknowns::default() };
        let plausible = Plausible::new(&law, Free::Material);
        let scores = (0..6).map(|k| Score { frame: k, camera: k, gradient: vec![0.1, f64::from(k as u32) - 2.5] });
        // lowest along (−1, 2)
        let curvature = vec![vec![4.0, 2.0], vec![2.0, 1.0 + 1e-9]];
        let linearised = Linearised { loss: 1.0, gradient: vec![0.0; 2], curvature, scores: scores.collect() };
        let prior = plausible.deviations(&at)[1];
        let [x, expected] = [at.clone(), Unknowns { parameters: vec![1e5, 0.3], ..at.clone() }]
            .map(|unknowns| unknowns.coordinates(&law, Free::Material));
        // as sure as what is usual: half-way, along the valley, which what is expected of the modulus hardly stops
        let found = more_usual(&plausible, &at, &linearised, &[0.0, prior]).unwrap();
        let moved = [found[0] - x[0], found[1] - x[1]];
        approx::assert_relative_eq!(moved[0], -0.5 * moved[1], max_relative = 1e-4);
        approx::assert_relative_eq!(moved[1], 0.5 * (expected[1] - x[1]), max_relative = 0.03);
        // nothing unsure, nothing moved
        let same = more_usual(&plausible, &at, &linearised, &[0.0; 2]).unwrap();
        approx::assert_relative_eq!(same[1], x[1], max_relative = 1e-12);
    }

    /// Errors that go together in the pictures, and a prior of one of them: it tells of the other.
    #[test]
    fn a_pull_goes_along_with_what_the_pictures_confuse() {
        // x + y is seen well, x − y badly: residuals of two pictures that scatter
        let curvature = vec![vec![101.0, 99.0], vec![99.0, 101.0]];
        let score = |sign: f64| Score { frame: usize::from(sign > 0.0), camera: 0, gradient: vec![sign, -sign] };
        let scores = vec![score(1.0), score(-1.0)];
        let at = Linearised { loss: 1.0, gradient: vec![0.0, 0.0], curvature, scores };
        let prior = Mat::from_fn(2, 2, |i, j| if i == j { [1.0, 1e3][i] } else { 0.0 });
        let known = Known::of(&at, prior).unwrap();
        // M = 4 (1 −1; −1 1), C⁻¹ (1 −1)ᵀ = ½ (1 −1)ᵀ: K = (1 −1; −1 1), and x is as unsure as its prior
        let pulled = known.pulled(&[0.5, 0.0]).unwrap();
        approx::assert_relative_eq!(pulled[0], 0.25, max_relative = 1e-4);
        approx::assert_relative_eq!(pulled[1], -0.25, max_relative = 1e-4);
        approx::assert_relative_eq!(known.deviations().unwrap()[0], 0.5f64.sqrt(), max_relative = 1e-4);
    }
}
