//! JSON integers, which some programs write as `36.0`.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};

/// A number of type `T`.
struct Whole<T>(T);

impl<'de, T: TryFrom<u64>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(json: D) -> Result<Self, D::Error> {
        struct Number<T>(PhantomData<T>);
        impl<T: TryFrom<u64>> Visitor<'_> for Number<T> {
            type Value = Whole<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number, not below 0")
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Whole<T>, E> {
                let wrong = |_| E::invalid_value(Unexpected::Unsigned(number), &self);
                T::try_from(number).map(Whole).map_err(wrong)
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Whole<T>, E> {
                // beyond 2^53 a float does not identify an integer
                match number.fract() == 0.0 && (0.0..=9_007_199_254_740_992.0).contains(&number) {
                    true => self.visit_u64(number as u64),
                    false => Err(E::invalid_value(Unexpected::Float(number), &self)),
                }
            }
        }
        json.deserialize_any(Number(PhantomData))
    }
}

/// One number.
pub(super) fn one<'de, D: Deserializer<'de>, T: TryFrom<u64>>(json: D) -> Result<T, D::Error> {
    Whole::deserialize(json).map(|Whole(number)| number)
}

/// A number or none.
pub(super) fn maybe<'de, D: Deserializer<'de>, T: TryFrom<u64>>(json: D) -> Result<Option<T>, D::Error> {
    Ok(Option::deserialize(json)?.map(|Whole(number)| number))
}

/// A list of numbers.
pub(super) fn many<'de, D: Deserializer<'de>, T: TryFrom<u64>>(json: D) -> Result<Vec<T>, D::Error> {
    Ok(Vec::deserialize(json)?.into_iter().map(|Whole(number)| number).collect())
}

/// Numbers by their names.
pub(super) fn named<'de, D: Deserializer<'de>, T: TryFrom<u64>>(json: D) -> Result<BTreeMap<String, T>, D::Error> {
    Ok(BTreeMap::deserialize(json)?.into_iter().map(|(name, Whole(number))| (name, number)).collect())
}
