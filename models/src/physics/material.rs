//! The contract of a material: parameters, stress, return map, wave speed, written for one particle.

use std::fmt::Debug;
use std::ops::Index;

use gradreel::scalar::{Mat3, Scalar};

use super::parameters::Parameter;
use super::sound;

/// A constitutive law.
///
/// The functions are called once with symbolic numbers and become scalar programs (see [`super::Law`]); there is no
/// derivative to write. One file is one material; entering it in [`super::materials`] gets it tested, but a material of
/// your own needs no entry.
///
/// ```
/// use gradreel::scalar::Mat3;
/// use gradreel_models::physics::{Given, Law, Material, Parameter, Point};
///
/// /// Linear elasticity without shear: `τ = κ (tr F − 3) I`.
/// #[derive(Debug)]
/// struct Foam;
///
/// impl Material for Foam {
///     fn name(&self) -> &str {
///         "foam"
///     }
///     fn parameters(&self) -> Vec<Parameter> {
///         vec![Parameter::log10("bulk", "K", "Pa", [1e3, 1e6])]
///     }
///     fn stress(&self, point: &Point, given: &Given) -> Mat3 {
///         Mat3::eye() * (given["bulk"] * (point.f.trace() - 3.0))
///     }
///     fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
///         (values[0] / density).sqrt()
///     }
/// }
///
/// assert_eq!(Law::of(Foam).name(), "foam");
/// ```
pub trait Material: Debug + Send + Sync + 'static {
    /// Its name in files, errors and tables, in `snake_case`.
    fn name(&self) -> &str;

    /// What can be fitted, in the order in which a rollout takes the values.
    fn parameters(&self) -> Vec<Parameter>;

    /// Kirchhoff stress `τ` \[Pa\] of a particle whose deformation gradient has passed through the return map.
    fn stress(&self, point: &Point, given: &Given) -> Mat3;

    /// The deformation gradient that replaces the trial `point.f`; `None` if the law has no such projection.
    fn return_map(&self, point: &Point, given: &Given) -> Option<Mat3> {
        let _ = (point, given);
        None
    }

    /// What a particle remembers besides its deformation gradient, such as hardening; nothing, unless said otherwise.
    fn history(&self) -> Vec<History> {
        Vec::new()
    }

    /// What replaces the history variables, in order, when the deformation gradient becomes the trial `point.f`; they
    /// stay as they are, unless said otherwise. `given` holds them, by name, as they were before; in
    /// [`Material::stress`] it holds the new ones.
    fn evolve(&self, point: &Point, given: &Given) -> Vec<Scalar> {
        let _ = point;
        given.history.iter().map(|(_, value)| *value).collect()
    }

    /// An upper estimate of the speed of sound \[m/s\], for the time step; `values` are in the order of
    /// [`Material::parameters`], `density` in kg/m³.
    ///
    /// Unless said otherwise the speed of the fastest plane wave, in any direction and of any polarisation, from the derivative
    /// of the stress: at rest, and where the particle is compressed, drawn out or sheared by up to a quarter, with what
    /// [`Material::return_map`] and [`Material::evolve`] make of it on the way. A viscous stress has no part in it. This takes
    /// some milliseconds; a formula is faster.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        sound::fastest(self, values, density)
    }

    /// Whether the law has a finite stress for inverted material (`det F < 0`); if not, the stress must be NaN there,
    /// which a rollout reports.
    fn survives_inversion(&self) -> bool {
        true
    }
}

/// A history variable: something that each particle carries through the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct History {
    /// The name by which [`Given`] knows it.
    pub name: &'static str,
    /// The SI unit, `-` if it has none.
    pub unit: &'static str,
    /// Its value at rest.
    pub start: f64,
}

/// The kinematic state of one particle, symbolically.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Deformation gradient: the trial one in [`Material::return_map`], the projected one in [`Material::stress`].
    pub f: Mat3,
    /// Deformation gradient at the start of the substep.
    pub previous: Mat3,
    /// Velocity gradient at the start of the substep \[1/s\].
    pub c: Mat3,
}

/// The parameters and history variables of one particle, by name, and the length of the substep.
#[derive(Debug, Clone)]
pub struct Given {
    pub(crate) values: Vec<(&'static str, Scalar)>,
    pub(crate) history: Vec<(&'static str, Scalar)>,
    /// Substep \[s\].
    pub dt: Scalar,
}

impl Index<&str> for Given {
    type Output = Scalar;

    /// # Panics
    ///
    /// If the material has declared no such parameter or history variable.
    #[track_caller]
    fn index(&self, name: &str) -> &Scalar {
        let all = || self.values.iter().chain(&self.history);
        let found = all().find(|(known, _)| *known == name);
        let names = || all().map(|(known, _)| *known).collect::<Vec<_>>();
        match found {
            Some((_, value)) => value,
            None => panic!("the material has no parameter '{name}', only {:?}", names()),
        }
    }
}
