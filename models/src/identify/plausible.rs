//! What is plausible before anything was seen: where to look for a material, and a penalty on leaving that range.

use faer::Mat;

use crate::identify::fall::Fallen;
use crate::identify::lean;
use crate::identify::uncertainty::prior::{PRIMES, limits, radical_inverse};
use crate::identify::unknowns::Unknown;
use crate::identify::{Free, Unknowns};
use crate::physics::{Law, Map, Parameter, width};

/// What a quarter of the plausible range beyond its end costs, as a loss.
const PENALTY: f64 = 0.01;

/// A penalty that is nothing within the plausible range of every free parameter and grows with the square of the distance
/// from it: `0.01 (4 e/range)²`, with the excess `e` in decades for magnitudes and in the parameter's unit for others.
///
/// It decides only where the clip does not: bare of it, a parameter that the motion hardly shows could wander off. Where the
/// noise of the clip is known, a parameter is pulled to the middle of its range besides, as weakly as the clip shows it well:
/// `½ noise z²` with `z` in standard deviations from the middle, the prior of a most probable estimate. So is the velocity to that
/// of a fall, along each of the three directions in which that is known independently.
#[derive(Clone)]
pub(crate) struct Plausible<'a> {
    pub law: &'a Law,
    pub free: Free,
    /// The noise of the loss along each free unknown's coordinate, for the velocity along the directions of the fall; empty where
    /// it is not known.
    pub noise: Vec<f64>,
    /// What a fall says of the velocity.
    fall: Option<&'a Fallen>,
}

/// A sum of penalties, its gradient and its curvature.
struct Penalty {
    total: f64,
    gradient: Vec<f64>,
    curvature: Vec<Vec<f64>>,
}

impl Penalty {
    fn none(count: usize) -> Self {
        Self { total: 0.0, gradient: vec![0.0; count], curvature: vec![vec![0.0; count]; count] }
    }

    /// Adds `½ noise z²`, where `rates` are the coordinates that move `z` and how fast each does.
    fn pull(&mut self, noise: f64, z: f64, rates: &[(usize, f64)]) {
        self.total += 0.5 * noise * z * z;
        for &(a, rate) in rates {
            self.gradient[a] += noise * z * rate;
            rates.iter().for_each(|&(b, other)| self.curvature[a][b] += noise * rate * other);
        }
    }
}

/// What materials usually have, middle and standard deviation on the scale of [`even`]: of a multiple of another parameter, its ratio.
fn usual(parameter: &Parameter) -> [f64; 2] {
    let [middle, deviation] = parameter.usual;
    [if parameter.map == Map::Log10 { middle.log10() } else { middle }, deviation]
}

/// The parameter on the scale on which its range is even, the ends of the range there, and `d scale/d value`.
fn even(parameter: &Parameter, value: f64) -> (f64, [f64; 2], f64) {
    match parameter.map {
        Map::Log10 => (value.log10(), parameter.prior.map(f64::log10), 1.0 / (value * std::f64::consts::LN_10)),
        _ => (value, parameter.prior, 1.0),
    }
}

impl<'a> Plausible<'a> {
    /// What is plausible of the free unknowns, without a pull.
    pub fn new(law: &'a Law, free: Free) -> Self {
        Self { law, free, noise: Vec::new(), fall: None }
    }

    /// The same with what a fall says of the velocity.
    #[must_use]
    pub fn after(mut self, fall: Option<&'a Fallen>) -> Self {
        self.fall = fall;
        self
    }

    /// The same with a pull, where the noise of the loss is this.
    #[must_use]
    pub fn pulling(mut self, noise: Vec<f64>) -> Self {
        self.noise = noise;
        self
    }

    /// Where the free unknowns are that the fall tells of, in its order.
    fn told(&self) -> Vec<usize> {
        let list = self.free.list(self.law);
        let place = |unknown: Unknown| list.iter().position(|other| *other == unknown);
        let all = (0..3).map(Unknown::Velocity).chain([Unknown::DISTANCE]);
        all.take(self.fall.map_or(0, Fallen::count)).filter_map(place).collect()
    }

    /// The penalty, its gradient and its curvature in the coordinates of the free unknowns.
    pub fn penalty(&self, at: &Unknowns) -> (f64, Vec<f64>, Vec<Vec<f64>>) {
        let (list, told) = (self.free.list(self.law), self.told());
        let noise_of = |i: usize| self.noise.get(i).copied().unwrap_or(0.0);
        let mut sum = Penalty::none(list.len());
        for (i, &unknown) in list.iter().enumerate() {
            let (value, [low, high], slope) = match unknown {
                Unknown::Parameter(k) => even(&self.law.parameters()[k], at.parameters[k]),
                Unknown::Contact => (at.contact, self.free.contact().range(), 1.0),
                Unknown::Lean(axis) if !told.contains(&i) => (at.lean[axis], lean::range_of(axis), 1.0),
                Unknown::Velocity(_) | Unknown::Spin(_) | Unknown::Lean(_) => continue,
            };
            let base = self.base(unknown);
            let [middle, deviation] = match unknown {
                Unknown::Parameter(k) => usual(&self.law.parameters()[k]),
                _ => [0.5 * (low + high), width([low, high])],
            };
            let middle = middle + base.map_or(0.0, |base| even(&self.law.parameters()[base], at.parameters[base]).0);
            let quarter = 0.25 * (high - low);
            let excess = ((value - high).max(0.0) + (value - low).min(0.0)) / quarter;
            let rate = slope * at.slope(self.law, unknown) / quarter;
            sum.total += PENALTY * excess * excess;
            sum.gradient[i] += 2.0 * PENALTY * excess * rate;
            sum.curvature[i][i] += if excess == 0.0 { 0.0 } else { 2.0 * PENALTY * rate * rate };
            let moved_by_base = base.and_then(|base| {
                let there = list.iter().position(|other| *other == Unknown::Parameter(base))?;
                Some((there, -self.scale(at, base) / deviation))
            });
            let rates: Vec<(usize, f64)> = [(i, rate * quarter / deviation)].into_iter().chain(moved_by_base).collect();
            sum.pull(noise_of(i), (value - middle) / deviation, &rates);
        }
        if let Some(fall) = self.fall {
            for (k, z) in fall.standard(at.velocity, at.farther()).into_iter().enumerate().take(told.len()) {
                let rates = told.iter().zip(fall.rate(k)).map(|(&j, rate)| (j, rate * at.slope(self.law, list[j])));
                sum.pull(noise_of(told[k]), z, &rates.collect::<Vec<_>>());
            }
        }
        (sum.total, sum.gradient, sum.curvature)
    }

    /// The parameter of which an unknown one is usually a multiple.
    fn base(&self, unknown: Unknown) -> Option<usize> {
        let Unknown::Parameter(k) = unknown else { return None };
        let parameters = self.law.parameters();
        parameters[k].times.and_then(|other| parameters.iter().position(|base| base.name == other))
    }

    /// The standard deviation of each free unknown's coordinate before the clip was seen: that of what materials have
    /// ([`Parameter::usual`]; of a multiple of another parameter if that one is known); a velocity may be 5 m/s, a spin 20 rad/s.
    pub fn deviations(&self, at: &Unknowns) -> Vec<f64> {
        let deviation = |unknown| match unknown {
            Unknown::Velocity(_) => 5.0 / at.slope(self.law, unknown),
            Unknown::Spin(_) => 20.0 / at.slope(self.law, unknown),
            Unknown::Contact => width(self.free.contact().range()),
            Unknown::Lean(axis) => width(lean::range_of(axis)),
            Unknown::Parameter(k) => {
                let [_, deviation] = usual(&self.law.parameters()[k]);
                deviation / self.scale(at, k)
            }
        };
        self.free.list(self.law).into_iter().map(deviation).collect()
    }

    /// How fast a parameter moves with its coordinate, on the scale of [`even`].
    fn scale(&self, at: &Unknowns, parameter: usize) -> f64 {
        let (_, _, slope) = even(&self.law.parameters()[parameter], at.parameters[parameter]);
        (slope * at.slope(self.law, Unknown::Parameter(parameter))).abs().max(f64::MIN_POSITIVE)
    }

    /// What was known before the clip was seen, the fall in it apart: a matrix `L` of which `L Lᵀ` is the covariance of the free
    /// unknowns' coordinates, and whose column `k` is one standard deviation of what [`Plausible::noise`] counts as the `k`-th.
    pub fn factor(&self, at: &Unknowns) -> Mat<f64> {
        let (list, deviations, told) = (self.free.list(self.law), self.deviations(at), self.told());
        let of_fall = |unknown: usize| told.iter().position(|i| *i == unknown);
        let is_multiple =
            |i: usize, k: usize| self.base(list[i]).is_some_and(|base| list[k] == Unknown::Parameter(base));
        let scale = |i: usize| match list[i] {
            Unknown::Parameter(k) => self.scale(at, k),
            _ => 1.0,
        };
        Mat::from_fn(list.len(), list.len(), |i, k| match (of_fall(i), of_fall(k), self.fall) {
            (Some(a), Some(along), Some(fall)) => fall.step(along)[a] / at.slope(self.law, list[i]),
            _ if i == k => deviations[k],
            _ if is_multiple(i, k) => deviations[k] * scale(k) / scale(i),
            _ => 0.0,
        })
    }

    /// The coordinates of the free unknowns that are expected before the clip is seen: the middles of the plausible ranges, and the
    /// velocity of a fall (or the one at hand, where none was seen).
    pub fn expected(&self, at: &Unknowns) -> Vec<f64> {
        let (all, list) = (self.law.parameters(), self.free.list(self.law));
        let middle = |k: usize| match list.contains(&Unknown::Parameter(k)) {
            true => all[k].usual[0],
            false => at.parameters[k],
        };
        let times = |k: usize| self.base(Unknown::Parameter(k)).filter(|_| list.contains(&Unknown::Parameter(k)));
        let velocity = self.fall.map_or(at.velocity, |fall| fall.middle);
        let parameters = (0..all.len()).map(|k| middle(k) * times(k).map_or(1.0, middle)).collect();
        Unknowns { velocity, spin: at.spin, parameters, ..Unknowns::default() }.coordinates(self.law, self.free)
    }

    /// How far a step may move each free unknown's coordinate: half the deviation of which the range of a parameter is an interval of
    /// 90 %, 0.2 m/s, 2 rad/s.
    pub fn longest_step(&self, at: &Unknowns) -> Vec<f64> {
        let longest = |(unknown, deviation): (Unknown, f64)| match unknown {
            Unknown::Velocity(_) => 0.2 / at.slope(self.law, unknown),
            Unknown::Spin(_) => 2.0 / at.slope(self.law, unknown),
            Unknown::Contact | Unknown::Lean(_) => 0.5 * deviation,
            Unknown::Parameter(k) => {
                let (_, [low, high], _) = even(&self.law.parameters()[k], at.parameters[k]);
                0.5 * width([low, high]) / self.scale(at, k)
            }
        };
        self.free.list(self.law).into_iter().zip(self.deviations(at)).map(longest).collect()
    }

    /// Where a search may go at most, in the coordinates of the free unknowns ([`limits`]).
    pub fn limits(&self) -> Vec<[f64; 2]> {
        limits(self.law, self.free)
    }

    /// `count` points spread evenly over the inner nine tenths of the plausible range of the free parameters (Halton 1960);
    /// other unknowns are as in `start`.
    pub fn points(&self, start: &Unknowns, count: usize) -> Vec<Unknowns> {
        let point = |index: usize| {
            let mut point = start.clone();
            let parameters = self.free.list(self.law).into_iter().filter_map(|unknown| match unknown {
                Unknown::Parameter(k) => Some(k),
                Unknown::Velocity(_) | Unknown::Spin(_) | Unknown::Contact | Unknown::Lean(_) => None,
            });
            for (k, base) in parameters.zip(PRIMES) {
                let parameter = &self.law.parameters()[k];
                let (_, [low, high], _) = even(parameter, at_least_tiny(parameter.start));
                let value = low + (high - low) * (0.05 + 0.9 * radical_inverse(index + 1, base));
                point.parameters[k] = if parameter.map == Map::Log10 { 10f64.powf(value) } else { value };
            }
            point
        };
        (0..count).map(point).collect()
    }
}

fn at_least_tiny(value: f64) -> f64 {
    value.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::NINETY;
    use crate::physics::materials;

    #[test]
    fn penalty_and_its_derivatives() {
        let law = materials::find("von_mises").unwrap();
        let plausible = Plausible::new(&law, Free::Material);
        let at = |parameters: [f64; 3]| Unknowns { parameters: parameters.to_vec(), ..Unknowns::default() };
        assert_eq!(plausible.penalty(&at([1e5, 0.2, 1e4])).0, 0.0);
        // a decade beyond a range of four: a quarter
        approx::assert_relative_eq!(plausible.penalty(&at([1e8, 0.2, 1e4])).0, 0.01, max_relative = 1e-9);
        let pulling = Plausible::new(&law, Free::Material).pulling(vec![0.02, 0.5, 3.0]);
        // two deviations from the middle of a range of four decades, and a modulus that goes along
        let usual = |tau: f64| at([200.0 * tau, 0.2, tau]);
        let off = 1e4 * 10f64.powf(2.0 * 4.0 / (2.0 * NINETY));
        let more = pulling.penalty(&usual(off)).0 - pulling.penalty(&usual(1e4)).0;
        let beyond = plausible.penalty(&usual(off)).0;
        approx::assert_relative_eq!(more - beyond, 0.5 * 3.0 * 4.0, max_relative = 1e-9);
        // two from what is usual with that yield stress
        let more = pulling.penalty(&at([2e6 / 10f64.powf(1.4), 0.2, 1e4])).0 - pulling.penalty(&usual(1e4)).0;
        approx::assert_relative_eq!(more, 0.5 * 0.02 * 4.0, max_relative = 1e-9);
        // a ratio is pulled to what materials have, not to the middle of its range
        let of_ratio = |nu: f64| pulling.penalty(&at([1e5, nu, 1e4])).0;
        approx::assert_relative_eq!(of_ratio(0.30 - 0.11) - of_ratio(0.30), 0.5 * 0.5, max_relative = 1e-9);
        let far = at([3e8, -0.2, 20.0]);
        let x = far.coordinates(&law, Free::Material);
        for plausible in [plausible, pulling.clone()] {
            let (_, gradient, curvature) = plausible.penalty(&far);
            for k in 0..3 {
                let moved = |step: f64| {
                    let mut x = x.clone();
                    x[k] += step;
                    plausible.penalty(&far.moved(&law, Free::Material, &x))
                };
                let (plus, minus) = (moved(1e-5), moved(-1e-5));
                let slope = (plus.0 - minus.0) / 2e-5;
                approx::assert_relative_eq!(gradient[k], slope, max_relative = 1e-6);
                assert!(curvature[k][k] > 0.0);
                for l in [0, 2] {
                    // these are logarithms, in which the penalty is a parabola
                    let slope = (plus.1[l] - minus.1[l]) / 2e-5;
                    approx::assert_relative_eq!(curvature[k][l], slope, max_relative = 1e-6, epsilon = 1e-9);
                }
            }
        }
        // a deviation of each, from where all is as expected: moduli follow yield stresses
        let expected = pulling.expected(&usual(30.0));
        approx::assert_relative_eq!(
            expected[..],
            at([2e6, 0.30, 1e4]).coordinates(&law, Free::Material)[..],
            max_relative = 1e-12
        );
        let middle = at([2e6, 0.30, 1e4]);
        let factor = pulling.factor(&middle);
        for (k, noise) in [(0, 0.02), (2, 3.0)] {
            let moved: Vec<f64> = (0..3).map(|i| expected[i] + factor[(i, k)]).collect();
            let there = middle.moved(&law, Free::Material, &moved);
            let pull = pulling.penalty(&there).0 - Plausible::new(&law, Free::Material).penalty(&there).0;
            approx::assert_relative_eq!(pull, 0.5 * noise, max_relative = 1e-9);
        }
        // a yield stress that is held is known
        let held = Free::all_but(&law, &["yield_stress"], false);
        let plausible = Plausible::new(&law, held);
        approx::assert_relative_eq!(plausible.expected(&usual(30.0))[0], 6000f64.log10(), max_relative = 1e-12);
        assert_eq!(plausible.factor(&usual(30.0)).nrows(), 2);
    }

    /// What a fall says: gradient and curvature against differences, and a factor that takes one deviation along a direction to a
    /// penalty of half the noise.
    #[test]
    fn a_fall_pulls_the_velocity() {
        let law = materials::find("neo_hookean").unwrap();
        let velocity_covariance = [[0.05, 0.01, -0.02], [0.01, 0.02, 0.0], [-0.02, 0.0, 0.09]];
        let (centre, velocity, gravity) = ([0.0; 3], [1.0, -2.0, 0.5], [0.0, -9.8, 0.0]);
        let flight = crate::video::Flight {
            centre,
            velocity,
            velocity_covariance,
            velocity_with_distance: [0.002, -0.004, 0.001],
            gravity,
            frames: 4,
            distance: 2.0,
            diameter: 0.2,
            deviation: 0.05,
            scales_world: false,
        };
        let expected = Unknowns { velocity, parameters: vec![1e5, 0.2], ..Unknowns::default() };
        // alone, and with the distance, which stands last
        let with_distance = (true, Free::Both.with_distance(&law), vec![0.3, 0.1, 0.7, 0.0, 0.0, 0.4]);
        for (distance, free, noise) in [(false, Free::Both, vec![0.3, 0.1, 0.7, 0.0, 0.0]), with_distance] {
            let fall = Fallen::of(&flight, distance).unwrap();
            let plausible = Plausible::new(&law, free).after(Some(&fall)).pulling(noise.clone());
            assert_eq!(plausible.penalty(&expected).0, 0.0);
            assert_eq!(
                plausible.expected(&Unknowns { velocity: [0.0; 3], ..expected.clone() })[..3],
                [10.0, -20.0, 5.0]
            );
            let x = expected.coordinates(&law, free);
            let (count, factor) = (x.len(), plausible.factor(&expected));
            for k in plausible.told() {
                let moved: Vec<f64> = (0..count).map(|i| x[i] + factor[(i, k)]).collect();
                let penalty = plausible.penalty(&expected.moved(&law, free, &moved)).0;
                approx::assert_relative_eq!(penalty, 0.5 * noise[k], max_relative = 1e-9);
            }
            let far: Vec<f64> = x.iter().enumerate().map(|(i, x)| x + 0.3 * (i as f64 - 1.5)).collect();
            let at = |x: &[f64]| plausible.penalty(&expected.moved(&law, free, x));
            let (_, gradient, curvature) = at(&far);
            for k in 0..count {
                let moved = |step: f64| {
                    let mut x = far.clone();
                    x[k] += step;
                    at(&x)
                };
                let (plus, minus) = (moved(1e-5), moved(-1e-5));
                let slope = (plus.0 - minus.0) / 2e-5;
                approx::assert_relative_eq!(gradient[k], slope, max_relative = 1e-6, epsilon = 1e-9);
                for l in plausible.told() {
                    let slope = (plus.1[l] - minus.1[l]) / 2e-5;
                    approx::assert_relative_eq!(curvature[k][l], slope, max_relative = 1e-6, epsilon = 1e-7);
                }
            }
        }
    }

    #[test]
    fn points_fill_the_range() {
        let law = materials::find("newtonian").unwrap();
        let plausible = Plausible::new(&law, Free::Material);
        let start = Unknowns { velocity: [1.0; 3], parameters: vec![10.0, 1e5], ..Unknowns::default() };
        let points = plausible.points(&start, 16);
        for (k, parameter) in law.parameters().iter().enumerate() {
            let [low, high] = parameter.prior;
            assert!(points.iter().all(|p| (low..high).contains(&p.parameters[k])));
            // every quarter of the range has its share
            for quarter in 0..4 {
                let place = |value: f64| (value / low).log10() / (high / low).log10() * 4.0;
                let inside = points.iter().filter(|p| place(p.parameters[k]) as usize == quarter).count();
                assert!((2..=6).contains(&inside), "{inside} in quarter {quarter} of {}", parameter.name);
            }
        }
    }
}
