//! Parameters of a law, drawn from its priors.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use gradreel::{Error, ErrorKind, Key, Result};

use crate::identify::normal::below;
use crate::identify::{Config, MaterialConfig};
use crate::physics::{Map, Parameter};

/// Values by name, and the logarithm of each one's density on the scale of its fit.
type Drawn = (BTreeMap<String, f64>, BTreeMap<String, f64>);

/// The settings of a family.
pub(super) fn named(family: &str) -> MaterialConfig {
    MaterialConfig { name: family.to_owned(), ..MaterialConfig::default() }
}

/// A value on the scale of its fit: decades for magnitudes.
pub(super) fn scale(parameter: &Parameter, value: f64) -> f64 {
    if parameter.map == Map::Log10 { value.log10() } else { value }
}

/// How fast that changes with the value.
pub(super) fn slope(parameter: &Parameter, value: f64) -> f64 {
    if parameter.map == Map::Log10 { 1.0 / (value * std::f64::consts::LN_10) } else { 1.0 }
}

/// Draws the free parameters of a law, each from a normal distribution cut off at the ends of its plausible range; held ones
/// are at their values.
///
/// # Errors
/// As [`Config::law`]; [`ErrorKind::Input`] where a range holds next to nothing of the distribution.
pub(super) fn draw(config: &Config, key: Key) -> Result<Drawn> {
    let law = config.law()?;
    let (held, start) = (config.held(&law)?, config.starting_values(&law)?);
    let (mut values, mut densities) = Drawn::default();
    // multiples of another parameter come after it
    let all = law.parameters().iter().zip(start).enumerate();
    let mut order: Vec<(usize, (&Parameter, f64))> = all.collect();
    order.sort_by_key(|(_, (parameter, _))| parameter.times.is_some());
    for (k, (parameter, start)) in order {
        if held.contains(&parameter.name) {
            values.insert(parameter.name.to_owned(), start);
            continue;
        }
        let base = parameter.times.and_then(|other| values.get(other)).copied().unwrap_or(1.0);
        let [middle, deviation] = parameter.usual;
        let middle = scale(parameter, middle * base);
        let [low, high] = parameter.prior.map(|end| scale(parameter, end));
        let mut normals = key.fold(k as u64).normal(1000);
        let drawn = normals.find(|z| (low..=high).contains(&(middle + deviation * z))).ok_or_else(|| {
            Error::new(ErrorKind::Input, "a prior lies outside the plausible range").at(parameter.name)
        })?;
        let x = middle + deviation * drawn;
        let [low, high] = [low, high].map(|end| below((end - middle) / deviation));
        let density = -0.5 * drawn * drawn - (deviation * TAU.sqrt()).ln() - (high - low).ln();
        let value = if parameter.map == Map::Log10 { 10f64.powf(x) } else { x };
        values.insert(parameter.name.to_owned(), value);
        densities.insert(parameter.name.to_owned(), density);
    }
    Ok((values, densities))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::FAMILIES;

    #[test]
    fn draws_are_of_the_prior() {
        for (family, _) in FAMILIES {
            let config = Config { material: named(family), ..Config::default() };
            let law = config.law().unwrap();
            let held = config.held(&law).unwrap();
            for parameter in law.parameters() {
                let all: Vec<Drawn> = (0..300).map(|n| draw(&config, Key::new(n)).unwrap()).collect();
                let values: Vec<f64> = all.iter().map(|(values, _)| values[parameter.name]).collect();
                let [low, high] = parameter.prior;
                if held.contains(&parameter.name) {
                    assert!(values.iter().all(|value| *value == values[0]) && !all[0].1.contains_key(parameter.name));
                    continue;
                }
                assert!(values.iter().all(|value| (low..=high).contains(value)), "{family}: {}", parameter.name);
                let middle = values.iter().map(|value| scale(parameter, *value)).sum::<f64>() / values.len() as f64;
                let [least, most] = [low, high].map(|end| scale(parameter, end));
                assert!(least < middle && middle < most, "{family}: {}: {middle}", parameter.name);
                let Some(base) = parameter.times else { continue };
                // of a ratio, the median is that of its prior where the ends of the range cut off as little on both sides
                let [ratio, deviation] = [parameter.usual[0].log10(), parameter.usual[1]];
                let whole = |v: &&BTreeMap<String, f64>| {
                    let middle = v[base].log10() + ratio;
                    middle - 1.5 * deviation > least && middle + 1.5 * deviation < most
                };
                let values = all.iter().map(|(values, _)| values).filter(whole);
                let mut ratios: Vec<f64> = values.map(|v| (v[parameter.name] / v[base]).log10()).collect();
                ratios.sort_by(f64::total_cmp);
                assert!(ratios.len() > 60, "{family}: {} of {}", ratios.len(), parameter.name);
                let off = (ratios[ratios.len() / 2] - ratio) / deviation;
                assert!(off.abs() < 0.4, "{family}: {} is {off} deviations from its ratio", parameter.name);
            }
        }
    }

    /// The density integrates to one: the mean of `1/density` over draws is the length of the range.
    #[test]
    fn densities_are_those_of_the_draws() {
        let config = Config { material: named("elastic"), ..Config::default() };
        let lengths: f64 =
            (0..4000).map(|n| (-draw(&config, Key::new(n)).unwrap().1["young"]).exp()).sum::<f64>() / 4000.0;
        assert!((lengths - 4.0).abs() < 0.3, "{lengths} decades of 1e3 to 1e7 Pa");
    }
}
