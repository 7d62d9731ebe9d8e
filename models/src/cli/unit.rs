//! Numbers with units as typed by users: `100kPa`, `0.5 MPa`, `1.2Pa s`, `30°`, `950 kg/m3`.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use gradreel::{Error, ErrorKind, Result};

use crate::identify::no_such_parameter;
use crate::physics::Law;

/// A unit as a multiple of SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    /// Factor to SI units.
    factor: f64,
    /// Exponents of metre, kilogram, second and radian.
    dimension: [i32; 4],
}

const NUMBER: Unit = Unit { factor: 1.0, dimension: [0; 4] };

/// Units that take a prefix.
const WITH_PREFIX: [(&str, f64, [i32; 4]); 12] = [
    ("m", 1.0, [1, 0, 0, 0]),
    ("g", 1e-3, [0, 1, 0, 0]),
    ("s", 1.0, [0, 0, 1, 0]),
    ("Pa", 1.0, [-1, 1, -2, 0]),
    ("bar", 1e5, [-1, 1, -2, 0]),
    ("N", 1.0, [1, 1, -2, 0]),
    ("J", 1.0, [2, 1, -2, 0]),
    ("Hz", 1.0, [0, 0, -1, 0]),
    ("rad", 1.0, [0, 0, 0, 1]),
    ("P", 0.1, [-1, 1, -1, 0]),
    ("L", 1e-3, [3, 0, 0, 0]),
    ("l", 1e-3, [3, 0, 0, 0]),
];

/// Units without prefixes.
const WITHOUT_PREFIX: [(&str, f64, [i32; 4]); 6] = [
    ("deg", PI / 180.0, [0, 0, 0, 1]),
    ("°", PI / 180.0, [0, 0, 0, 1]),
    ("min", 60.0, [0, 0, 1, 0]),
    ("%", 0.01, [0; 4]),
    ("1", 1.0, [0; 4]),
    ("-", 1.0, [0; 4]),
];

const PREFIXES: [(&str, f64); 10] = [
    ("G", 1e9),
    ("M", 1e6),
    ("k", 1e3),
    ("d", 1e-1),
    ("c", 1e-2),
    ("m", 1e-3),
    ("µ", 1e-6),
    ("μ", 1e-6),
    ("u", 1e-6),
    ("n", 1e-9),
];

impl Unit {
    /// Parses a product of units: `Pa s`, `Pa·s`, `kg/m³`, `m s^-2`.
    fn read(text: &str) -> Option<Self> {
        let mut product = NUMBER;
        let (mut sign, mut part) = (1, String::new());
        for letter in text.trim().chars().chain([' ']) {
            if !matches!(letter, '/' | '·' | '*' | '.' | ' ') {
                part.push(letter);
                continue;
            }
            if !part.is_empty() {
                product = product.times(Self::power(&part)?, sign);
                (sign, part) = (1, String::new());
            }
            if letter == '/' {
                sign = -1;
            }
        }
        (sign == 1).then_some(product)
    }

    /// Parses one unit with its exponent: `m3`, `m^3`, `m³`, `s-1`.
    fn power(text: &str) -> Option<Self> {
        if let Some(unit) = Self::named(text) {
            return Some(unit);
        }
        let digits = "⁰¹²³⁴⁵⁶⁷⁸⁹";
        let plain = |letter: char| match digits.chars().position(|digit| digit == letter) {
            Some(digit) => char::from(b'0' + digit as u8),
            None if letter == '⁻' || letter == '−' => '-',
            None => letter,
        };
        let text: String = text.chars().map(plain).collect();
        let at = text.find(|letter: char| letter.is_ascii_digit() || matches!(letter, '^' | '-' | '+'))?;
        let exponent: i32 = text[at..].trim_start_matches('^').parse().ok()?;
        let unit = Self::named(&text[..at])?;
        (1..=9).contains(&exponent.abs()).then(|| NUMBER.times(unit, exponent))
    }

    fn named(name: &str) -> Option<Self> {
        let find = |list: &[(&str, f64, [i32; 4])], name: &str| {
            let found = list.iter().find(|(known, ..)| *known == name)?;
            Some(Self { factor: found.1, dimension: found.2 })
        };
        find(&WITHOUT_PREFIX, name).or_else(|| find(&WITH_PREFIX, name)).or_else(|| {
            PREFIXES.iter().find_map(|(prefix, factor)| {
                let unit = find(&WITH_PREFIX, name.strip_prefix(prefix)?)?;
                Some(Self { factor: factor * unit.factor, ..unit })
            })
        })
    }

    fn times(self, other: Self, exponent: i32) -> Self {
        let dimension = [0, 1, 2, 3].map(|k| self.dimension[k] + exponent * other.dimension[k]);
        Self { factor: self.factor * other.factor.powi(exponent), dimension }
    }
}

/// A number with its optional unit, as typed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Amount {
    value: f64,
    unit: String,
}

impl Amount {
    /// Parses `5`, `1e5`, `100kPa` or `100 kPa`.
    pub fn read(text: &str) -> std::result::Result<Self, String> {
        let text = text.trim();
        let ends = text.char_indices().map(|(at, letter)| at + letter.len_utf8()).rev();
        let number = ends.filter_map(|end| Some((end, text[..end].parse().ok()?))).next();
        let (end, value) = number.ok_or_else(|| format!("`{text}` is not a number, with or without a unit"))?;
        Ok(Self { value, unit: text[end..].trim().to_owned() })
    }

    /// Converts to a unit; a number without a unit is assumed to be in `wanted`.
    pub fn in_unit(&self, wanted: &str) -> std::result::Result<f64, String> {
        if self.unit.is_empty() {
            return Ok(self.value);
        }
        let name = if matches!(wanted, "-" | "") { "a number without a unit" } else { wanted };
        let unit =
            Unit::read(&self.unit).ok_or_else(|| format!("`{}` is not a known unit; wanted: {name}", self.unit))?;
        let target = Unit::read(wanted).unwrap_or(NUMBER);
        match unit.dimension == target.dimension {
            true if unit.factor == target.factor => Ok(self.value),
            true => Ok(self.value * (unit.factor / target.factor)),
            false => Err(format!("`{}` is no such quantity; wanted: {name}", self.unit)),
        }
    }
}

/// Parses the value of an option and converts it to a unit.
pub(super) fn number_in(text: &str, unit: &str) -> std::result::Result<f64, String> {
    Amount::read(text)?.in_unit(unit)
}

/// A material parameter with its value, as in `young=100kPa`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Named {
    name: String,
    amount: Amount,
}

impl Named {
    /// Parses a name, `=` and a number.
    pub fn read(text: &str) -> std::result::Result<Self, String> {
        let (name, amount) = text.split_once('=').ok_or("a name, `=` and a number are wanted, such as young=100kPa")?;
        Ok(Self { name: name.trim().to_owned(), amount: Amount::read(amount)? })
    }
}

/// Converts parameters of a law to the law's units; `option` names the command-line option in errors.
///
/// # Errors
/// [`ErrorKind::Input`] for an unknown or repeated parameter, or a unit of another quantity.
pub(super) fn of_law(given: &[Named], law: &Law, option: &str) -> Result<BTreeMap<String, f64>> {
    let mut values = BTreeMap::new();
    for Named { name, amount } in given {
        let Some(parameter) = law.parameters().iter().find(|p| p.name == name) else {
            return Err(no_such_parameter(law, name, option));
        };
        let refused = |found: String| {
            Error::new(ErrorKind::Input, "the value of a parameter cannot be used")
                .at(format!("{option} {name}"))
                .found(found)
        };
        let value = amount.in_unit(parameter.unit).map_err(|found| {
            let unit = if parameter.unit == "-" { String::new() } else { parameter.unit.replace(' ', "·") };
            refused(found).fix(format!("give for example `{option} {name}={}{unit}`", parameter.start))
        })?;
        if values.insert(name.clone(), value).is_some() {
            return Err(refused("two values".into()).fix("give one"));
        }
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    #[test]
    fn prefixes_products_and_powers() {
        for (text, unit, wanted) in [
            ("100kPa", "Pa", 1e5),
            ("0.5 MPa", "Pa", 5e5),
            ("2GPa", "Pa", 2e9),
            ("1e5", "Pa", 1e5),
            ("1e2kPa", "Pa", 1e5),
            ("3 bar", "Pa", 3e5),
            ("4 N/mm2", "Pa", 4e6),
            ("-5", "Pa", -5.0),
            ("1.5Pa s", "Pa s", 1.5),
            ("1.5 Pa·s", "Pa s", 1.5),
            ("20 mPa.s", "Pa s", 0.02),
            ("10P", "Pa s", 1.0),
            ("30°", "deg", 30.0),
            ("30deg", "deg", 30.0),
            ("0.5rad", "deg", 28.647_889_756_541_16),
            ("950 kg/m3", "kg/m³", 950.0),
            ("0.95g/cm³", "kg/m³", 950.0),
            ("950 kg m^-3", "kg/m³", 950.0),
            ("950 kg·m⁻³", "kg/m³", 950.0),
            ("2cm", "m", 0.02),
            ("36 m/min", "m/s", 0.6),
            ("30%", "-", 0.3),
            ("0.3", "-", 0.3),
        ] {
            let found = number_in(text, unit).unwrap_or_else(|error| panic!("{text}: {error}"));
            approx::assert_relative_eq!(found, wanted, max_relative = 1e-12);
        }
    }

    #[test]
    fn other_quantities_and_no_quantities() {
        for (text, unit, said) in [
            ("100 m", "Pa", "wanted: Pa"),
            ("100kPa", "-", "without a unit"),
            ("1 Pa", "Pa s", "wanted: Pa s"),
            ("30 Pa", "deg", "wanted: deg"),
            ("5 furlongs", "m", "not a known unit"),
            ("5 m/", "m", "not a known unit"),
            ("5 m0", "m", "not a known unit"),
            ("soft", "Pa", "not a number"),
            ("", "Pa", "not a number"),
        ] {
            let error = number_in(text, unit).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
    }

    #[test]
    fn every_parameter_takes_its_own_unit() {
        for law in materials::all() {
            for p in law.parameters() {
                let text = format!("{} {}", p.start, p.unit);
                assert_eq!(number_in(&text, p.unit), Ok(p.start), "{} of {}", p.name, law.name());
            }
        }
    }
}
