//! What is known of the unknowns before any pixel is seen: a normal distribution in the coordinates of a search.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;
use serde::{Deserialize, Serialize};

use super::normal;
use crate::identify::model::depth_shear;
use crate::identify::model::fall::Fallen;
use crate::identify::model::unknowns::{Unknown, unit};
use crate::identify::{Free, Unknowns};
use crate::physics::{Law, Map, Parameter, width};

/// A velocity that no fall has shown \[m/s\] and a spin \[rad/s\]: standard deviations.
const SPEED: f64 = 5.0;
const SPIN: f64 = 20.0;

/// Coefficient of friction between two dry solids: median, and standard deviation in decades. Of tabulated pairs nine in ten are
/// between 0.13 (PTFE, polished wood) and 1.2 (rubber on concrete).
pub(crate) const FRICTION: [f64; 2] = [0.4, 0.3];

/// Mean and factor of a prior, as a file has them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Normal {
    pub mean: Vec<f64>,
    pub factor: Vec<Vec<f64>>,
}

/// The prior of the free unknowns, `N(m, L Lᵀ)`: that of the law's parameters ([`Parameter::usual`]), of the ground's
/// height and of the body's modes, and for a single camera what the free fall says of velocity and distance.
#[derive(Debug, Clone)]
pub(crate) struct Prior<'a> {
    pub law: &'a Law,
    pub free: Free,
    pub mean: Vec<f64>,
    factor: Mat<f64>,
    pub precision: Mat<f64>,
}

/// Mean and standard deviation of a parameter on the scale on which its prior is normal: decades, or its own unit.
fn usual(parameter: &Parameter) -> [f64; 2] {
    let [mean, deviation] = parameter.usual;
    [if parameter.map == Map::Log10 { mean.log10() } else { mean }, deviation]
}

/// How fast a parameter changes with its search coordinate, on that scale.
fn scale(parameter: &Parameter, value: f64) -> f64 {
    let slope = match parameter.map {
        Map::Log10 => 1.0,
        map => map.derivative(map.raw(value)),
    };
    (slope * unit(parameter)).abs().max(f64::MIN_POSITIVE)
}

impl<'a> Prior<'a> {
    /// The prior of what is free; velocity and spin are about those of `at` unless a fall tells more.
    pub fn of(law: &'a Law, free: Free, at: &Unknowns, fall: Option<&Fallen>) -> Self {
        let list = free.list(law);
        let all = law.parameters();
        let base = |unknown: Unknown| match unknown {
            Unknown::Parameter(k) => all[k].times.and_then(|other| all.iter().position(|base| base.name == other)),
            _ => None,
        };
        // means: parameters that are multiples of another one follow it
        let is_free = |k: usize| list.contains(&Unknown::Parameter(k));
        let own = |k: usize| if is_free(k) { all[k].usual[0] } else { at.parameters[k] };
        let value = |k: usize| match base(Unknown::Parameter(k)).filter(|_| is_free(k)) {
            Some(base) => all[k].usual[0] * own(base),
            None => own(k),
        };
        let means = Unknowns {
            velocity: fall.map_or(at.velocity, |fall| fall.middle),
            parameters: (0..all.len()).map(value).collect(),
            contact: 0.0,
            friction: FRICTION[0],
            depth: [0.0; 4],
            ..at.clone()
        };
        let mean = means.coordinates(law, free);
        let deviation = |unknown| match unknown {
            Unknown::Velocity(_) => SPEED / means.slope(law, unknown),
            Unknown::Spin(_) => SPIN / means.slope(law, unknown),
            Unknown::Contact => width(free.contact().range()),
            Unknown::Friction => FRICTION[1],
            Unknown::Depth(axis) => width(depth_shear::range_of(axis)),
            Unknown::Parameter(k) => usual(&all[k])[1] / scale(&all[k], means.parameters[k]),
        };
        let told: Vec<usize> = {
            let place = |unknown: &Unknown| list.iter().position(|other| other == unknown);
            fall.map_or(&[][..], |fall| &fall.unknowns[..]).iter().filter_map(place).collect()
        };
        let of_fall = |i: usize| told.iter().position(|place| *place == i);
        let in_coordinates = |i: usize| match list[i] {
            Unknown::Parameter(k) => scale(&all[k], means.parameters[k]),
            _ => 1.0,
        };
        let factor = Mat::from_fn(list.len(), list.len(), |i, k| match (of_fall(i), of_fall(k), fall) {
            (Some(a), Some(along), Some(fall)) => fall.step(along)[a] / means.slope(law, list[i]),
            _ if i == k => deviation(list[k]),
            _ if base(list[i]).is_some_and(|base| list[k] == Unknown::Parameter(base)) => {
                deviation(list[k]) * in_coordinates(k) / in_coordinates(i)
            }
            _ => 0.0,
        });
        Self::with(law, free, mean, factor)
    }

    fn with(law: &'a Law, free: Free, mean: Vec<f64>, factor: Mat<f64>) -> Self {
        let covariance = &factor * factor.transpose();
        let precision = covariance.partial_piv_lu().inverse();
        Self { law, free, mean, factor, precision }
    }

    /// The prior that a file has.
    pub fn read(law: &'a Law, free: Free, normal: &Normal) -> Self {
        let n = normal.mean.len();
        Self::with(law, free, normal.mean.clone(), Mat::from_fn(n, n, |i, j| normal.factor[i][j]))
    }

    /// Mean and factor, for a file.
    pub fn written(&self) -> Normal {
        let n = self.mean.len();
        let factor = (0..n).map(|i| (0..n).map(|j| self.factor[(i, j)]).collect()).collect();
        Normal { mean: self.mean.clone(), factor }
    }

    /// Standard deviation of each coordinate.
    pub fn deviations(&self) -> Vec<f64> {
        let n = self.mean.len();
        (0..n).map(|i| (0..n).map(|k| self.factor[(i, k)].powi(2)).sum::<f64>().sqrt()).collect()
    }

    /// The logarithm of the determinant of the covariance.
    pub fn log_determinant(&self) -> f64 {
        2.0 * self.factor.determinant().abs().max(f64::MIN_POSITIVE).ln()
    }

    /// `½ (x − m)ᵀ P⁻¹ (x − m)` and its gradient `P⁻¹ (x − m)`.
    pub fn cost(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let n = x.len();
        let off = Mat::from_fn(n, 1, |i, _| x[i] - self.mean[i]);
        let slope = &self.precision * &off;
        let slope: Vec<f64> = (0..n).map(|i| slope[(i, 0)]).collect();
        (0.5 * (0..n).map(|i| off[(i, 0)] * slope[i]).sum::<f64>(), slope)
    }

    /// How far a coordinate is from its mean along the prior's own directions, in standard deviations.
    #[cfg(test)]
    pub fn standard(&self, x: &[f64]) -> Vec<f64> {
        let n = x.len();
        let off = Mat::from_fn(n, 1, |i, _| x[i] - self.mean[i]);
        let z = faer::linalg::solvers::Solve::solve(&self.factor.partial_piv_lu(), &off);
        (0..n).map(|i| z[(i, 0)]).collect()
    }

    /// The longest step of a search in each coordinate: half the standard deviation of a parameter's range taken as a 90 %
    /// interval, 0.2 m/s, 2 rad/s.
    pub fn longest_step(&self, at: &Unknowns) -> Vec<f64> {
        let deviations = self.deviations();
        let longest = |(i, unknown)| match unknown {
            Unknown::Velocity(_) => 0.2 / at.slope(self.law, unknown),
            Unknown::Spin(_) => 2.0 / at.slope(self.law, unknown),
            Unknown::Contact | Unknown::Friction | Unknown::Depth(_) => 0.5 * deviations[i],
            Unknown::Parameter(k) => {
                let parameter = &self.law.parameters()[k];
                let range = match parameter.map {
                    Map::Log10 => parameter.prior.map(f64::log10),
                    _ => parameter.prior,
                };
                0.5 * width(range) / scale(parameter, at.parameters[k])
            }
        };
        self.free.list(self.law).into_iter().enumerate().map(longest).collect()
    }

    /// Limits of a search in each coordinate ([`limits`]).
    pub fn limits(&self) -> Vec<[f64; 2]> {
        limits(self.law, self.free)
    }

    /// How many unknowns [`Prior::points`] varies.
    pub fn varied(&self) -> usize {
        self.free.list(self.law).iter().filter(|unknown| varies(unknown)).count()
    }

    /// `count` points that follow the prior of the parameters and of the body's modes (Halton 1960, through the normal
    /// quantiles), each parameter within its plausible range; other unknowns are those of `start`.
    pub fn points(&self, start: &Unknowns, count: usize) -> Vec<Unknowns> {
        let (list, deviations) = (self.free.list(self.law), self.deviations());
        let point = |index: usize| {
            let mut bases = PRIMES.iter().cycle();
            let z: Vec<f64> = list
                .iter()
                .map(|unknown| match varies(unknown) {
                    true => normal::quantile(0.03 + 0.94 * radical_inverse(index + 1, *bases.next().expect("endless"))),
                    false => 0.0,
                })
                .collect();
            let here = start.coordinates(self.law, self.free);
            let limits = self.limits();
            let along = |i: usize| match list[i] {
                // the fall's own directions mix it with the velocity, which stays
                Unknown::PITCH => deviations[i] * z[i],
                _ => (0..z.len()).map(|k| self.factor[(i, k)] * z[k]).sum::<f64>(),
            };
            let x = (0..z.len()).map(|i| match varies(&list[i]) {
                true => (self.mean[i] + along(i)).clamp(limits[i][0], limits[i][1]),
                false => here[i],
            });
            let mut point = start.moved(self.law, self.free, &x.collect::<Vec<_>>());
            for (k, parameter) in self.law.parameters().iter().enumerate() {
                if list.contains(&Unknown::Parameter(k)) {
                    // of a range that ends where its map ends, nothing is put there
                    let [low, high] = parameter.prior;
                    let inside = 0.03 * (high - low);
                    let [low, high] =
                        if parameter.map == Map::Log10 { [low, high] } else { [low + inside, high - inside] };
                    point.parameters[k] = point.parameters[k].clamp(low, high);
                }
            }
            point
        };
        (0..count).map(point).collect()
    }
}

/// Limits of a search in each coordinate: two decades beyond the plausible range; of bounded parameters nine tenths of
/// the way to where their slope vanishes.
pub(crate) fn limits(law: &Law, free: Free) -> Vec<[f64; 2]> {
    let limit = |unknown| match unknown {
        Unknown::Velocity(_) | Unknown::Spin(_) => [f64::NEG_INFINITY, f64::INFINITY],
        Unknown::Contact => free.contact().range().map(|end| 1.5 * end),
        // from ice to what hardly slips at all
        Unknown::Friction => [-3.0, 1.0],
        Unknown::Depth(axis) => depth_shear::range_of(axis).map(|end| 1.5 * end),
        Unknown::Parameter(k) => {
            let p = &law.parameters()[k];
            match p.map {
                Map::Log10 => [p.prior[0].log10() - 2.0, p.prior[1].log10() + 2.0],
                Map::Linear => {
                    let range = p.prior[1] - p.prior[0];
                    [p.prior[0] - range, p.prior[1] + range].map(|value| value / unit(p))
                }
                Map::Bounded { low, high } => [-0.9, 0.9].map(|far: f64| far * (high - low) / unit(p)),
            }
        }
    };
    free.list(law).into_iter().map(limit).collect()
}

/// Parameters, the depth shear and the pitch: what a search starts from many values of.
fn varies(unknown: &Unknown) -> bool {
    matches!(unknown, Unknown::Parameter(_) | Unknown::Friction | Unknown::Depth(0 | 1 | 3))
}

/// A base of [`radical_inverse`] for each dimension of a Halton sequence.
pub(crate) const PRIMES: [usize; 12] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37];

/// The digits of `index` in `base`, mirrored at the point: 1, 2, 3, 4 → ½, ¼, ¾, ⅛ in base 2.
pub(crate) fn radical_inverse(mut index: usize, base: usize) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= base as f64;
        value += digit * (index % base) as f64;
        index /= base;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    fn at(parameters: [f64; 3]) -> Unknowns {
        Unknowns { parameters: parameters.to_vec(), ..Unknowns::default() }
    }

    /// Of a modulus that is a multiple of the yield stress: both move together, and the ratio has its own deviation.
    #[test]
    fn multiples_follow_what_they_are_multiples_of() {
        let law = materials::find("von_mises").unwrap();
        let prior = Prior::of(&law, Free::Material, &at([1e5, 0.2, 1e4]), None);
        let [young, _, stress] = law.parameters() else { panic!("three parameters") };
        let middle = stress.usual[0].log10();
        approx::assert_relative_eq!(prior.mean[2], middle, max_relative = 1e-12);
        approx::assert_relative_eq!(prior.mean[0], middle + young.usual[0].log10(), max_relative = 1e-12);
        // two deviations of the stress, the modulus with it
        let two = 2.0 * stress.usual[1];
        let moved = [prior.mean[0] + two, prior.mean[1], prior.mean[2] + two];
        approx::assert_relative_eq!(prior.cost(&moved).0, 2.0, max_relative = 1e-9);
        approx::assert_relative_eq!(prior.standard(&moved)[..], [0.0, 0.0, 2.0][..], epsilon = 1e-9);
        // of the modulus alone
        let moved = [prior.mean[0] + young.usual[1], prior.mean[1], prior.mean[2]];
        approx::assert_relative_eq!(prior.cost(&moved).0, 0.5, max_relative = 1e-9);
        let wide = young.usual[1].hypot(stress.usual[1]);
        approx::assert_relative_eq!(prior.deviations()[0], wide, max_relative = 1e-9);
    }

    #[test]
    fn the_slope_of_the_cost_is_its_derivative() {
        let law = materials::find("viscoplastic").unwrap();
        let start = Unknowns { parameters: vec![1e3, 1e5, 1e2, 1e1], ..Unknowns::default() };
        let prior = Prior::of(&law, Free::Both, &start, None);
        let x: Vec<f64> = prior.mean.iter().enumerate().map(|(k, mean)| mean + 0.3 * (k as f64 - 2.0)).collect();
        let slope = prior.cost(&x).1;
        for k in 0..x.len() {
            let cost = |step: f64| {
                let mut x = x.clone();
                x[k] += step;
                prior.cost(&x).0
            };
            let difference = (cost(1e-5) - cost(-1e-5)) / 2e-5;
            approx::assert_relative_eq!(slope[k], difference, max_relative = 1e-6, epsilon = 1e-8);
        }
        assert_eq!(Prior::read(&law, Free::Both, &prior.written()).cost(&x), prior.cost(&x));
    }

    /// Points are where the prior is: their ranks in it are even, and none lies beyond the plausible range.
    #[test]
    fn points_follow_the_prior() {
        for law in materials::all() {
            let parameters = law.parameters().iter().map(|p| p.start).collect();
            let start = Unknowns { velocity: [1.0; 3], parameters, ..Unknowns::default() };
            let prior = Prior::of(&law, Free::Material, &start, None);
            let points = prior.points(&start, 40);
            assert!(points.iter().all(|point| point.velocity == [1.0; 3]));
            for (k, parameter) in law.parameters().iter().enumerate() {
                let inside =
                    points.iter().all(|p| (parameter.prior[0]..=parameter.prior[1]).contains(&p.parameters[k]));
                assert!(inside, "{} of {}", parameter.name, law.name());
                let low = points.iter().filter(|p| p.coordinates(&law, Free::Material)[k] < prior.mean[k]).count();
                assert!((12..=28).contains(&low), "{low} of 40 {} of {} are small", parameter.name, law.name());
            }
        }
    }
}
