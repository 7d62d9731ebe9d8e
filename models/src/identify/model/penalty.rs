//! Range-relaxed penalties: a parameter within its plausible range is hardly penalised, one beyond it is pulled back.

use std::collections::BTreeMap;

use gradreel::Var;

use crate::identify::model::unknowns::Unknown;
use crate::identify::{Free, Unknowns};
use crate::physics::{Law, Map, Parameter};

/// Penalty of parameters by how far they are from plausible ranges.
///
/// With `u = (p − centre) / half width`, where `p` is the parameter, or its decimal logarithm if it is known to an order of
/// magnitude only: `inside u²` for `|u| ≤ 1`, `inside + 2 inside (|u| − 1) + outside (|u| − 1)²` beyond. Value and slope are
/// continuous.
///
/// ```
/// use gradreel_models::identify::RangePenalty;
/// use gradreel_models::physics::materials;
///
/// let law = materials::find("neo_hookean").unwrap();
/// let penalty = RangePenalty::default();
/// let rubber = penalty.of(&law, &[1e5, 0.3]);
/// let steel = penalty.of(&law, &[2e11, 0.3]);
/// assert!(rubber < 1e-4 && steel > 0.1);
/// assert_eq!(RangePenalty { enabled: false, ..penalty }.of(&law, &[2e11, 0.3]), 0.0);
/// ```
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RangePenalty {
    /// Whether there is a penalty at all.
    pub enabled: bool,
    /// Weight within the range; breaks ties.
    pub inside: f64,
    /// Weight beyond the range; a tenth of a half width beyond costs a hundredth of it.
    pub outside: f64,
    /// Ranges in SI units by `material.parameter`, in place of the usual ones.
    pub ranges: BTreeMap<String, [f64; 2]>,
}

impl Default for RangePenalty {
    fn default() -> Self {
        Self { enabled: true, inside: 1e-5, outside: 1e-1, ranges: BTreeMap::new() }
    }
}

/// The usual range of a parameter in SI units, if there is one.
fn usual(material: &str, parameter: &str) -> Option<[f64; 2]> {
    let decades = |low: f64, high: f64| Some([10f64.powf(low), 10f64.powf(high)]);
    match (material, parameter) {
        (_, "young") => decades(3.5, 7.0),
        (_, "poisson") => Some([0.05, 0.44]),
        ("von_mises", "yield_stress") => decades(2.5, 5.0),
        ("newtonian", "viscosity") => decades(0.0, 3.5),
        ("newtonian", "bulk") => decades(3.5, 6.5),
        ("viscoplastic", "shear") => decades(2.5, 5.0),
        ("viscoplastic", "bulk") => decades(4.0, 6.5),
        ("viscoplastic", "yield_stress") => decades(1.0, 4.0),
        ("viscoplastic", "plastic_viscosity") => decades(-1.0, 2.0),
        ("drucker_prager", "friction_angle") => Some([10.0, 55.0]),
        _ => None,
    }
}

/// Centre and half width on the parameter's own scale.
fn scale(map: Map, [low, high]: [f64; 2]) -> (f64, f64) {
    let [low, high] = if map == Map::Log10 { [low.log10(), high.log10()] } else { [low, high] };
    ((low + high) / 2.0, (high - low) / 2.0)
}

impl RangePenalty {
    /// The range of a parameter in SI units: the one given, the usual one, or else the parameter's own
    /// ([`Parameter::prior`]).
    pub fn range(&self, law: &Law, parameter: &Parameter) -> [f64; 2] {
        let given = self.ranges.get(&format!("{}.{}", law.name(), parameter.name)).copied();
        given.or_else(|| usual(law.name(), parameter.name)).unwrap_or(parameter.prior)
    }

    /// The sum of the penalties of a material's parameters (SI units, in the order of the law).
    pub fn of(&self, law: &Law, values: &[f64]) -> f64 {
        let one = |(parameter, value): (&Parameter, &f64)| {
            let (centre, half) = scale(parameter.map, self.range(law, parameter));
            let p = if parameter.map == Map::Log10 { value.log10() } else { *value };
            let u = ((p - centre) / half).abs();
            let beyond = u - 1.0;
            if beyond <= 0.0 {
                self.inside * u * u
            } else {
                self.inside + 2.0 * self.inside * beyond + self.outside * beyond * beyond
            }
        };
        if self.enabled { law.parameters().iter().zip(values).map(one).sum() } else { 0.0 }
    }

    /// The penalty, its gradient and its curvature in the coordinates of the free unknowns.
    pub fn derivatives(&self, law: &Law, at: &Unknowns, free: Free) -> (f64, Vec<f64>, Vec<Vec<f64>>) {
        let derivatives = |unknown| {
            let Unknown::Parameter(k) = unknown else { return (0.0, 0.0) };
            let (parameter, value) = (&law.parameters()[k], at.parameters[k]);
            let (centre, half) = scale(parameter.map, self.range(law, parameter));
            let (p, slope) = match parameter.map {
                Map::Log10 => (value.log10(), 1.0 / (value * std::f64::consts::LN_10)),
                _ => (value, 1.0),
            };
            let (u, rate) = ((p - centre) / half, slope * at.slope(law, unknown) / half);
            let beyond = u.abs() - 1.0;
            let (first, second) = match beyond <= 0.0 {
                true => (2.0 * self.inside * u, 2.0 * self.inside),
                false => (u.signum() * 2.0 * (self.inside + self.outside * beyond), 2.0 * self.outside),
            };
            (first * rate, second * rate * rate)
        };
        let unknowns = free.list(law).into_iter();
        let (gradient, bends): (Vec<f64>, Vec<f64>) = match self.enabled {
            true => unknowns.map(derivatives).unzip(),
            false => unknowns.map(|_| (0.0, 0.0)).unzip(),
        };
        let row = |k: usize| (0..bends.len()).map(|l| if k == l { bends[k] } else { 0.0 }).collect();
        let curvature = (0..bends.len()).map(row).collect();
        (self.of(law, &at.parameters), gradient, curvature)
    }

    /// The same of variables, `[1]` each in SI units; `None` when there is nothing to add.
    pub fn on_tape(&self, law: &Law, values: &[Var]) -> Option<Var> {
        let (inside, outside) = (self.inside, self.outside);
        let one = |(parameter, value): (&Parameter, &Var)| {
            let (centre, half) = scale(parameter.map, self.range(law, parameter));
            let p = if parameter.map == Map::Log10 { value.ln() / std::f64::consts::LN_10 } else { value.clone() };
            ((p - centre) / half).map("range_penalty", |u| {
                let size = u.abs();
                let beyond = size - 1.0;
                let far = beyond * beyond * outside + beyond * (2.0 * inside) + inside;
                beyond.gt(0.0).select(far, u * u * inside)
            })
        };
        let all = self.enabled.then(|| law.parameters().iter().zip(values).map(one).reduce(|a, b| a + b));
        all.flatten().map(|sum| sum.sum_all())
    }
}

/// Adds the gradient and the curvature of a penalty to those of a loss, where they were asked for, and returns the penalty
/// itself.
pub(in crate::identify) fn add_penalty(
    (penalty, slopes, bends): (f64, Vec<f64>, Vec<Vec<f64>>),
    gradient: &mut [f64],
    curvature: &mut [Vec<f64>],
) -> f64 {
    gradient.iter_mut().zip(slopes).for_each(|(g, slope)| *g += slope);
    let rows = curvature.iter_mut().zip(bends);
    rows.for_each(|(row, bends)| row.iter_mut().zip(bends).for_each(|(c, bend)| *c += bend));
    penalty
}
