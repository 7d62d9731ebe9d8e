//! Material parameters: names, units, priors, and maps to unconstrained search variables.

/// A smooth map between an unconstrained number and a physical value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Map {
    /// `value = 10^raw`: positive quantities known to an order of magnitude.
    Log10,
    /// `value = raw`: quantities of any sign and of order 1.
    Linear,
    /// `value = r/2 · tanh(2 raw/r) + low + r/2` with `r = high − low`: quantities between two limits.
    Bounded {
        /// Lower limit, never reached.
        low: f64,
        /// Upper limit, never reached.
        high: f64,
    },
}

impl Map {
    /// The physical value of an unconstrained number.
    pub fn value(self, raw: f64) -> f64 {
        match self {
            Self::Log10 => 10_f64.powf(raw),
            Self::Linear => raw,
            Self::Bounded { low, high } => {
                let half = (high - low) / 2.0;
                half * (raw / half).tanh() + low + half
            }
        }
    }

    /// The unconstrained number of a physical value; NaN for a value outside the map's range.
    pub fn raw(self, value: f64) -> f64 {
        match self {
            Self::Log10 => value.log10(),
            Self::Linear => value,
            Self::Bounded { low, high } => {
                let half = (high - low) / 2.0;
                half * ((value - low - half) / half).atanh()
            }
        }
    }

    /// `d value / d raw`
    pub fn derivative(self, raw: f64) -> f64 {
        match self {
            Self::Log10 => std::f64::consts::LN_10 * self.value(raw),
            Self::Linear => 1.0,
            Self::Bounded { low, high } => 1.0 - (2.0 * raw / (high - low)).tanh().powi(2),
        }
    }
}

/// A material parameter: name, unit, map and prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// The name in files and errors, for example `young`.
    pub name: &'static str,
    /// The symbol in plots, for example `E`.
    pub symbol: &'static str,
    /// The SI unit, for example `Pa`; `-` if it has none.
    pub unit: &'static str,
    /// The map to the unconstrained variable.
    pub map: Map,
    /// A plausible initial value, in `unit`.
    pub start: f64,
    /// The range of plausible values, in `unit`.
    pub prior: [f64; 2],
    /// The prior: mean in `unit`, and standard deviation, in decades for parameters fitted as logarithms and in `unit`
    /// otherwise. By default `prior` is taken as a 90 % interval; [`Parameter::usually`] overrides it.
    pub usual: [f64; 2],
    /// The name of the parameter relative to which the mean of `usual` is given ([`Parameter::usually_times`]).
    pub times: Option<&'static str>,
    /// For parameters that only the compression of an impact constrains: the bulk modulus at rest as a multiple of the
    /// parameter ([`Parameter::told_by_compression`]).
    pub by_compression: Option<f64>,
}

/// Half width of a 90 % interval, in standard deviations.
pub(crate) const NINETY: f64 = 1.645;

impl Parameter {
    /// Young's modulus `young` \[Pa\] and Poisson's ratio `poisson`: the parameters of an isotropic elastic solid.
    pub fn elastic() -> [Self; 2] {
        [
            Self::log10("young", "E", "Pa", [1e3, 1e7]),
            Self::bounded("poisson", "ν", "-", [-0.45, 0.45], [0.0, 0.45]).usually(0.30, 0.11),
        ]
    }

    /// Sets a prior narrower than the plausible range, with mean and standard deviation. Example: Poisson's ratio,
    /// tabulated over materials from cork to rubber (metals, glass, plastics, foam, concrete, clay, sand), is 0.30 ±
    /// 0.11.
    #[must_use]
    pub fn usually(self, middle: f64, deviation: f64) -> Self {
        Self { usual: [middle, deviation], ..self }
    }

    /// Sets a prior relative to another parameter: a ratio, and a standard deviation in decades. Both are fitted as
    /// logarithms.
    #[must_use]
    pub fn usually_times(self, other: &'static str, ratio: f64, decades: f64) -> Self {
        Self { usual: [ratio, decades], times: Some(other), ..self }
    }

    /// Marks the bulk modulus of a fluid, which is constrained only by the compression of an impact: the stiffer the
    /// fluid, the weaker the constraint. The bulk modulus at rest is `times` the parameter.
    #[must_use]
    pub fn told_by_compression(self, times: f64) -> Self {
        Self { by_compression: Some(times), ..self }
    }

    /// A positive parameter fitted as its decimal logarithm, starting in the logarithmic middle of `prior`.
    pub fn log10(name: &'static str, symbol: &'static str, unit: &'static str, prior: [f64; 2]) -> Self {
        let start = (prior[0] * prior[1]).sqrt();
        Self {
            name,
            symbol,
            unit,
            map: Map::Log10,
            start,
            prior,
            usual: [start, width(prior.map(f64::log10))],
            times: None,
            by_compression: None,
        }
    }

    /// A parameter of any sign, fitted without a map.
    pub fn linear(name: &'static str, symbol: &'static str, unit: &'static str, start: f64, prior: [f64; 2]) -> Self {
        let usual = [0.5 * (prior[0] + prior[1]), width(prior)];
        Self { name, symbol, unit, map: Map::Linear, start, prior, usual, times: None, by_compression: None }
    }

    /// A parameter bounded by `limits`, starting in the middle of `prior`.
    pub fn bounded(
        name: &'static str,
        symbol: &'static str,
        unit: &'static str,
        limits: [f64; 2],
        prior: [f64; 2],
    ) -> Self {
        let map = Map::Bounded { low: limits[0], high: limits[1] };
        let start = (prior[0] + prior[1]) / 2.0;
        let usual = [start, width(prior)];
        Self { name, symbol, unit, map, start, prior, usual, times: None, by_compression: None }
    }
}

/// The standard deviation of a range taken as a 90 % interval.
pub(crate) fn width([low, high]: [f64; 2]) -> f64 {
    (high - low) / (2.0 * NINETY)
}

/// Lamé's parameters `(μ, λ)` from Young's modulus and Poisson's ratio, for numbers and for traced scalars:
/// `μ = E/(2(1+ν))`, `λ = Eν/((1+ν)(1−2ν))`.
pub fn lame<S>(young: S, poisson: S) -> (S, S)
where
    S: Copy + std::ops::Mul<Output = S> + std::ops::Div<Output = S> + std::ops::Add<f64, Output = S>,
    S: std::ops::Mul<f64, Output = S>,
{
    let mu = young / ((poisson + 1.0) * 2.0);
    let lambda = young * poisson / ((poisson + 1.0) * (poisson * -2.0 + 1.0));
    (mu, lambda)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_invert_and_their_derivatives_are_right() {
        for (map, value) in [
            (Map::Log10, 3.2e5),
            (Map::Linear, -0.7),
            (Map::Bounded { low: -0.45, high: 0.45 }, 0.31),
            (Map::Bounded { low: 1.0, high: 5.0 }, 4.9),
        ] {
            let raw = map.raw(value);
            approx::assert_relative_eq!(map.value(raw), value, max_relative = 1e-12);
            let slope = (map.value(raw + 1e-6) - map.value(raw - 1e-6)) / 2e-6;
            approx::assert_relative_eq!(map.derivative(raw), slope, max_relative = 1e-8);
        }
    }

    #[test]
    fn a_range_is_an_interval_unless_more_is_known() {
        let elastic = Parameter::elastic();
        approx::assert_relative_eq!(elastic[0].usual[0], 1e5, max_relative = 1e-12);
        approx::assert_relative_eq!(elastic[0].usual[1], 2.0 / 1.645, max_relative = 1e-12);
        assert_eq!(elastic[1].usual, [0.30, 0.11]);
        assert_eq!(elastic[1].prior, [0.0, 0.45]);
    }

    #[test]
    fn the_published_form_of_poisson_ratio() {
        let map = Map::Bounded { low: -0.45, high: 0.45 };
        approx::assert_relative_eq!(map.value(0.2), 0.45 * (0.2_f64 / 0.45).tanh(), max_relative = 1e-14);
        assert!(map.raw(0.46).is_nan());
    }

    #[test]
    fn lame_parameters_of_a_known_pair() {
        let (mu, lambda) = lame(2.6, 0.3);
        approx::assert_relative_eq!(mu, 1.0, max_relative = 1e-14);
        approx::assert_relative_eq!(lambda, 1.5, max_relative = 1e-14);
    }
}
