//! The interface of a material: parameters, stress, return map and wave speed of one particle.

use std::fmt::Debug;
use std::ops::Index;

use gradreel::scalar::{Mat3, Scalar};

use super::parameters::Parameter;
use super::sound;

/// A constitutive law.
///
/// The functions are called once with symbolic scalars and traced to scalar programs (see [`super::Law`]); derivatives
/// are generated. Each material has its own file. Listing it in [`super::materials`] adds it to the tests; a custom
/// material needs no entry.
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
    /// The name in files, errors and tables, in `snake_case`.
    fn name(&self) -> &str;

    /// The fittable parameters, in the order in which a rollout takes their values.
    fn parameters(&self) -> Vec<Parameter>;

    /// Kirchhoff stress `τ` \[Pa\] of a particle, after the return map.
    fn stress(&self, point: &Point, given: &Given) -> Mat3;

    /// The return map: the deformation gradient that replaces the trial `point.f`; `None` if the law has none.
    fn return_map(&self, point: &Point, given: &Given) -> Option<Mat3> {
        let _ = (point, given);
        None
    }

    /// The history variables of a particle, such as hardening; none by default.
    fn history(&self) -> Vec<History> {
        Vec::new()
    }

    /// The history of a particle that is at this place of the body at rest \[m\], relative to the middle of the body, in the
    /// order of [`Material::history`]; `None` if all particles start alike. The direction of fibres and the region with a
    /// stiffness of its own are such history; it is constant in derivatives. Whether it is `Some` must not depend on the
    /// place.
    fn rest(&self, place: [f64; 3]) -> Option<Vec<f64>> {
        let _ = place;
        None
    }

    /// The new history variables, in order, for the trial deformation gradient `point.f`; unchanged by default. `given`
    /// holds the previous values by name; in [`Material::stress`] it holds the new ones.
    fn evolve(&self, point: &Point, given: &Given) -> Vec<Scalar> {
        let _ = point;
        given.history.iter().map(|(_, value)| *value).collect()
    }

    /// An upper estimate of the speed of sound \[m/s\], for the time step; `values` are in the order of
    /// [`Material::parameters`], `density` in kg/m³.
    ///
    /// By default the speed of the fastest plane wave, over all directions and polarisations, from the derivative of
    /// the stress: at rest, and in compression, extension and shear up to a strain of a quarter, along which
    /// [`Material::return_map`] and [`Material::evolve`] are applied. Viscous stress is ignored. This takes some
    /// milliseconds; a formula is faster.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        sound::fastest(self, values, density)
    }

    /// The time \[s\] by which stress that follows the rate of deformation runs ahead of the elastic one; 0 if the law has no
    /// such stress. It takes shorter substeps ([`Law::wave_speed_on`](super::Law::wave_speed_on)).
    fn relaxation_time(&self, values: &[f64]) -> f64 {
        let _ = values;
        0.0
    }

    /// The text of its file, for a law that was read from one; it travels with a run.
    fn text(&self) -> Option<&str> {
        None
    }

    /// Whether the stress of an elastic law is the derivative of an energy; a law that says so is checked for it.
    fn stores_energy(&self) -> bool {
        true
    }

    /// Whether the stress is finite for inverted material (`det F < 0`); if not, it must be NaN there, which a rollout
    /// reports.
    fn survives_inversion(&self) -> bool {
        true
    }
}

/// A history variable: a value that each particle carries through the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct History {
    /// The name in [`Given`].
    pub name: &'static str,
    /// The SI unit, `-` if it has none.
    pub unit: &'static str,
    /// Its value at rest, where [`Material::rest`] does not say.
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
