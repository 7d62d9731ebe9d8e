//! Densities and material parameters, shared or per particle.

use gradreel::scalar::Lanes;
use gradreel::{Error, ErrorKind, Result};

use super::law::Law;
use super::row::Number;

/// One shared value, or one per particle.
#[derive(Debug, Clone, PartialEq)]
pub enum Values<T> {
    /// Shared by all particles.
    Same(T),
    /// One per particle.
    Each(Vec<T>),
}

impl<T: Number> Values<T> {
    /// The value of a particle.
    pub fn get(&self, particle: usize) -> T {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[particle],
        }
    }

    /// The values of `len` particles from `first` on.
    pub(crate) fn run(&self, first: usize, len: usize) -> Lanes<'_, T> {
        match self {
            Self::Same(value) => Lanes::Same(*value),
            Self::Each(values) => Lanes::Each(&values[first..][..len]),
        }
    }

    fn check(&self, name: &str, particles: usize) -> Result<()> {
        let all = match self {
            Self::Same(value) => std::slice::from_ref(value),
            Self::Each(values) => {
                assert_eq!(values.len(), particles, "{name}: one value per particle");
                values
            }
        };
        match all.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(at) => Err(Error::new(ErrorKind::NonFinite, format!("a value of '{name}' is not finite"))
                .at(format!("entry {at}"))
                .found(all[at])
                .wanted("finite numbers")),
        }
    }
}

/// Gradients with respect to density, parameters, gravity and friction: one number for a shared value, one per particle
/// for a per-particle value.
#[derive(Debug, Clone, PartialEq)]
pub struct ValueGradients<T> {
    /// Per unit of density \[1/(kg/m³)\].
    pub density: Vec<T>,
    /// Per unit of each parameter, in the material's order; materials are concatenated.
    pub parameters: Vec<Vec<T>>,
    /// Per unit of gravity \[1/(m/s²)\].
    pub gravity: [f64; 3],
    /// Per unit of each obstacle's friction coefficient; 0 for one without friction.
    pub friction: Vec<f64>,
}

/// Validates densities and parameters; returns the number of parameters.
///
/// # Errors
///
/// [`ErrorKind::NonFinite`] for a non-finite value, and [`ErrorKind::Input`] for a density that is not positive.
///
/// # Panics
///
/// If the number of parameters, or of their values, is wrong.
#[track_caller]
pub(crate) fn check_values<T: Number>(
    law: &Law,
    density: &Values<T>,
    parameters: &[Values<T>],
    particles: usize,
) -> Result<usize> {
    let wanted = law.parameters().len();
    assert!(parameters.len() == wanted, "{} takes {wanted} parameters, not {}", law.name(), parameters.len());
    density.check("density", particles)?;
    if let Some(particle) = (0..particles).find(|&p| density.get(p) <= T::ZERO) {
        return Err(Error::new(ErrorKind::Input, "the density must be positive")
            .at(format!("particle {particle}"))
            .found(format!("{} kg/m³", density.get(particle))));
    }
    for (values, parameter) in parameters.iter().zip(law.parameters()) {
        values.check(parameter.name, particles)?;
    }
    Ok(wanted)
}
