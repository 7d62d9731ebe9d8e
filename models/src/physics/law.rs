//! A traced material: the scalar programs that a substep runs over blocks of particles.

use std::cell::Cell;
use std::sync::{Arc, OnceLock};

use gradreel::scalar::{Lanes, Mat3, Program, Scalar};

use super::gpu::LawKernels;
use super::material::{Given, History, Material, Point};
use super::parameters::{Map, Parameter};
use super::row::Number;
use super::state::{BLOCK, F, HISTORY};
use super::values::Values;
use super::wgsl_law::WgslLaw;

/// Largest number of parameters of a material.
pub(crate) const PARAMETER_LIMIT: usize = 128;

/// Largest number of history variables of a material.
pub(crate) const HISTORY_LIMIT: usize = 27;

/// Inputs before the parameters: F 9, C 9, substep, stress scale, mass.
const FIXED: usize = 21;
/// Outputs before the history: projected deformation gradient 9, affine matrix 9.
const OUTPUTS: usize = 18;
/// Upper bound of the number of inputs or outputs of any program.
const SLOTS: usize = FIXED + PARAMETER_LIMIT + OUTPUTS + 2 * HISTORY_LIMIT;

/// A material together with its scalar programs.
///
/// - `law`: `F, C, dt, parameters, history ↦ F′, τ, history′`, for studying a material by itself;
/// - `forward`: `F, C, dt, s, m, parameters, history ↦ F′, A, history′`, the per-particle part of a substep before the
///   transfer: `F_trial = (I + dt C) F`, the return map, and `A = m C − s τ` with `s = dt V₀ 4/dx²`;
/// - `reverse`: its vector-Jacobian product with respect to `F, C, m`, the parameters and the history;
/// - `tangent`: its Jacobian-vector product.
#[derive(Debug, Clone)]
pub struct Law {
    material: Arc<dyn Material>,
    parameters: Vec<Parameter>,
    history: Vec<History>,
    elastic: bool,
    law: Program,
    forward: Program,
    reverse: Program,
    /// Built on first use.
    tangent: Arc<OnceLock<Program>>,
    /// Built on first use.
    kernels: Arc<OnceLock<LawKernels>>,
    /// The history at rest of each particle, in the caller's order.
    starts: Option<Arc<[Vec<f64>]>>,
}

/// A place of a body where checks look at a law whose history varies in space: nowhere in particular.
pub(super) const SOMEWHERE: [f64; 3] = [0.03, 0.02, -0.01];

impl Law {
    /// Traces a material.
    ///
    /// # Panics
    ///
    /// If it declares more than 128 parameters or 27 history variables (three matrices), evolves a different number of them, or relates a
    /// parameter to one that does not exist or is itself related to a third ([`Parameter::usually_times`]).
    #[track_caller]
    pub fn of(material: impl Material) -> Self {
        let (parameters, mut history) = (material.parameters(), material.history());
        if let Some(start) = material.rest(SOMEWHERE) {
            let (found, wanted) = (start.len(), history.len());
            assert!(found == wanted, "{}: {found} history variables at rest, {wanted} are declared", material.name());
            history.iter_mut().zip(start).for_each(|(variable, start)| variable.start = start);
        }
        for (what, count, limit) in
            [("parameters", parameters.len(), PARAMETER_LIMIT), ("history variables", history.len(), HISTORY_LIMIT)]
        {
            assert!(count <= limit, "{}: {count} {what}, the limit is {limit}", material.name());
        }
        for parameter in &parameters {
            let Some(other) = parameter.times else { continue };
            let base = parameters.iter().find(|p| p.name == other && p.times.is_none());
            let magnitudes = parameter.map == Map::Log10 && base.is_some_and(|base| base.map == Map::Log10);
            assert!(magnitudes, "{}: {} is no multiple of {other}", material.name(), parameter.name);
        }
        let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
        let remembered: Vec<&str> = history.iter().map(|variable| variable.name).collect();
        let matrix = |name: &str| (0..9).map(move |k| format!("{name}{}{}", k / 3, k % 3)).collect::<Vec<_>>();
        let trace = |name: &str, between: &[&str], second: &str, f: &dyn Fn(&[Scalar]) -> Vec<Scalar>| {
            let inputs = [matrix("f"), matrix("c")].concat();
            let inputs: Vec<&str> = inputs
                .iter()
                .map(String::as_str)
                .chain(between.iter().chain(&names).chain(&remembered).copied())
                .collect();
            let evolved = remembered.iter().map(|name| format!("{name}_new"));
            let outputs: Vec<String> = matrix("f_new").into_iter().chain(matrix(second)).chain(evolved).collect();
            let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
            Program::trace(&format!("{}_{name}", material.name()), &inputs, &outputs, f)
        };
        let given = |dt: Scalar, values: &[Scalar]| {
            let mut named = names.iter().chain(&remembered).copied().zip(values.iter().copied());
            Given { values: named.by_ref().take(names.len()).collect(), history: named.collect(), dt }
        };
        let elastic = Cell::new(false);
        let law = trace("law", &["dt"], "tau", &|x| {
            let (f, c) = (Mat3::from_slice(&x[..9]), Mat3::from_slice(&x[9..18]));
            let Response { f, tau, history, returned } = respond(&material, f, c, given(x[18], &x[19..]));
            elastic.set(!returned);
            [f.to_vec(), tau.to_vec(), history].concat()
        });
        let forward = trace("forward", &["dt", "scale", "mass"], "a", &|x| {
            let (f, c) = (Mat3::from_slice(&x[..9]), Mat3::from_slice(&x[9..18]));
            let Response { f, tau, history, .. } = respond(&material, f, c, given(x[18], &x[FIXED..]));
            [f.to_vec(), (c * x[20] - tau * x[19]).to_vec(), history].concat()
        });
        let wanted: Vec<usize> = (0..18).chain(20..FIXED + parameters.len() + history.len()).collect();
        let reverse = forward.vjp_wrt(&wanted);
        let elastic = elastic.get() && keeps_history(&law, &parameters, &history);
        let material = Arc::new(material);
        let (tangent, kernels) = (Arc::default(), Arc::default());
        Self { material, parameters, history, elastic, law, forward, reverse, tangent, kernels, starts: None }
    }

    /// The same law for the particles of a body, of which the places are known, relative to its middle \[m\]: what the
    /// history starts from there stays with each particle ([`Material::rest`]). A rollout of a law that was not placed
    /// takes the places of the particles at its start, around their mean. Nothing changes for a law that is alike everywhere.
    ///
    /// ```
    /// use gradreel_models::physics::{Law, WgslLaw};
    ///
    /// let text = "struct Parameters {
    ///         /// Bulk modulus below K [Pa], log10, 1e3 to 1e6
    ///         below: f32,
    ///         /// Bulk modulus above K [Pa], log10, 1e3 to 1e6
    ///         above: f32,
    ///     }
    ///     struct History {
    ///         /// Share of the upper region [-]
    ///         upper: f32,
    ///     }
    ///     fn rest(place: vec3<f32>) -> History {
    ///         return History(select(0.0, 1.0, place.y > 0.0));
    ///     }
    ///     fn stress(point: Point, p: Parameters, h: History) -> mat3x3<f32> {
    ///         return mix(p.below, p.above, h.upper) * (trace(point.f) - 3.0) * identity();
    ///     }";
    /// let law = Law::of(WgslLaw::parse("layers.wgsl", text)?).placed(&[[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]);
    /// assert_eq!(law.history_at(1), [1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn placed(&self, places: &[[f64; 3]]) -> Self {
        let starts: Option<Vec<Vec<f64>>> = places.iter().map(|&place| self.material.rest(place)).collect();
        Self { starts: starts.filter(|_| self.varies()).map(Arc::from), ..self.clone() }
    }

    /// Whether the history at rest depends on the place ([`Material::rest`]).
    pub fn varies(&self) -> bool {
        self.material.rest(SOMEWHERE).is_some()
    }

    /// The history at rest of a particle: as it was placed, or else as [`History::start`] has it.
    ///
    /// # Panics
    ///
    /// If the law was placed for fewer particles.
    pub fn history_at(&self, particle: usize) -> Vec<f64> {
        match &self.starts {
            Some(starts) => starts[particle].clone(),
            None => self.history.iter().map(|variable| variable.start).collect(),
        }
    }

    /// How the particles of a body start that are here: as they were placed, or by their places around their mean. `labels` are
    /// their indices in the caller's order.
    pub(crate) fn starts_of(&self, positions: &[[f64; 3]], labels: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
        match &self.starts {
            Some(_) => labels.take(positions.len()).map(|label| self.history_at(label)).collect(),
            None => {
                let here = self.placed(&places(positions));
                (0..positions.len()).map(|p| here.history_at(p)).collect()
            }
        }
    }

    /// Reads and traces a law written in WGSL.
    ///
    /// # Errors
    ///
    /// Those of [`WgslLaw::read`].
    pub fn read(path: impl AsRef<std::path::Path>) -> gradreel::Result<Self> {
        WgslLaw::read(path).map(Self::of)
    }

    /// Where its parameters start, in SI units.
    pub(crate) fn start_values(&self) -> Vec<f64> {
        self.parameters().iter().map(|parameter| parameter.start).collect()
    }

    /// The text of its file, for a law written in WGSL ([`Material::text`]).
    pub fn text(&self) -> Option<&str> {
        self.material.text()
    }

    /// The material's name.
    pub fn name(&self) -> &str {
        self.material.name()
    }

    /// The fittable parameters, in order.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The history variables of each particle, in order.
    pub fn history(&self) -> &[History] {
        &self.history
    }

    /// Whether the material is elastic: it has no return map ([`Material::return_map`]), and its history, if any, stays as it is.
    ///
    /// ```
    /// use gradreel_models::physics::materials;
    ///
    /// assert!(materials::find("neo_hookean").unwrap().is_elastic());
    /// assert!(!materials::find("von_mises").unwrap().is_elastic());
    /// ```
    pub fn is_elastic(&self) -> bool {
        self.elastic
    }

    /// Whether an elastic law derives from an energy; see [`Material::stores_energy`].
    pub fn stores_energy(&self) -> bool {
        self.material.stores_energy()
    }

    /// The speed of sound at rest \[m/s\], from the derivative of the stress.
    pub(crate) fn speed_at_rest(&self, values: &[f64], density: f64) -> f64 {
        super::sound::at_rest(&*self.material, values, density)
    }

    /// Whether inverted material has a finite stress; see [`Material::survives_inversion`].
    pub fn survives_inversion(&self) -> bool {
        self.material.survives_inversion()
    }

    /// An upper estimate of the speed of sound \[m/s\]; see [`Material::wave_speed`].
    pub fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        self.material.wave_speed(values, density)
    }

    /// The speed that decides the substep on a grid of spacing `dx` \[m\]: the speed of sound, more where the stress has a viscous
    /// part.
    ///
    /// The shortest wave of a grid has the angular frequency `ω = 2 c/dx`. Explicit steps with the viscous stress of the step
    /// before are stable while `dt ω² (dt + 2 t) < 4` with the relaxation time `t`, that is with `c (ζ + √(1 + ζ²))` in place of
    /// `c`, `ζ = t c/dx`.
    ///
    /// ```
    /// use gradreel_models::physics::materials;
    ///
    /// let law = materials::find("kelvin_voigt").unwrap();
    /// let speed = |time: f64| law.wave_speed_on(&[1e5, 0.3, time], 1000.0, 0.02);
    /// assert!((speed(1e-9) / law.wave_speed(&[1e5, 0.3, 1e-9], 1000.0) - 1.0).abs() < 1e-5);
    /// assert!(speed(2e-3) > 2.0 * speed(1e-9));
    /// ```
    pub fn wave_speed_on(&self, values: &[f64], density: f64, dx: f64) -> f64 {
        let sound = self.material.wave_speed(values, density);
        let damping = self.material.relaxation_time(values) * sound / dx;
        sound * (damping + damping.hypot(1.0))
    }

    /// `F (9), C (9), dt, parameters, history ↦ F′ (9), τ (9), history′`, row by row; `F′` is the projection of
    /// `(I + dt C) F`.
    pub fn program(&self) -> &Program {
        &self.law
    }

    /// `F, C, dt, s, m, parameters, history ↦ F′, A, history′`
    pub(crate) fn forward(&self) -> &Program {
        &self.forward
    }

    /// The vector-Jacobian product of [`Law::forward`] with respect to `F, C, m`, parameters and history.
    pub(crate) fn reverse(&self) -> &Program {
        &self.reverse
    }

    /// Its GPU kernels.
    pub(crate) fn kernels(&self) -> &LawKernels {
        self.kernels.get_or_init(|| LawKernels::of(self))
    }

    /// Runs the forward program over a run of particles: reads `F, C` and history of `now`, writes `F` and history of
    /// `next` and the affine matrices (9 arrays).
    pub(crate) fn advance<T: Number>(&self, now: &[T], with: &Run<'_, T>, next: &mut [T], affine: &mut [T]) {
        let inputs = self.inputs(now, with);
        let (f, history) = next[F * BLOCK..].split_at_mut(9 * BLOCK);
        let into = arrays(f, 9).chain(arrays(affine, 9)).chain(arrays(history, self.history.len()));
        let mut outputs = cut(into, with);
        self.forward.run(with.len, &inputs[..self.input_count()], &mut outputs[..OUTPUTS + self.history.len()]);
    }

    /// Runs the reverse program. `cotangent` holds the cotangents of a whole state, `affine` that of `A`; those of `F`,
    /// `C`, mass, parameters and history are written to `out`, one array each.
    pub(crate) fn pull_back<T: Number>(
        &self,
        now: &[T],
        with: &Run<'_, T>,
        cotangent: &[T],
        affine: &[T],
        out: &mut [T],
    ) {
        let mut inputs = self.inputs(now, with);
        let (count, outputs) = (self.input_count(), OUTPUTS + self.history.len());
        let (f, history) = cotangent[F * BLOCK..].split_at(9 * BLOCK);
        let rows = f.chunks_exact(BLOCK).chain(affine.chunks_exact(BLOCK).take(9)).chain(history.chunks_exact(BLOCK));
        for (slot, row) in inputs[count..count + outputs].iter_mut().zip(rows) {
            *slot = Lanes::Each(&row[with.first..][..with.len]);
        }
        let count_out = self.cotangent_count();
        let mut results = cut(arrays(out, count_out), with);
        self.reverse.run(with.len, &inputs[..count + outputs], &mut results[..count_out]);
    }

    /// Runs the tangent program. `direction` holds the tangents of mass and parameters, `tangent` those of a state, of
    /// which `F`, `C` and history are read. Those of `F`, `A` and history after the substep are written to `out`, one
    /// array each.
    pub(crate) fn push_forward<T: Number>(
        &self,
        now: &[T],
        with: &Run<'_, T>,
        tangent: &[T],
        direction: &Run<'_, T>,
        out: &mut [T],
    ) {
        const SLOTS: usize = 2 * (FIXED + PARAMETER_LIMIT + HISTORY_LIMIT);
        let count = self.input_count();
        let mut inputs = [Lanes::Same(T::ZERO); SLOTS];
        inputs[..count].copy_from_slice(&self.inputs(now, with)[..count]);
        inputs[count..2 * count].copy_from_slice(&self.inputs(tangent, direction)[..count]);
        let outputs = OUTPUTS + self.history.len();
        let mut results = cut(arrays(out, outputs), with);
        let program = self.tangent.get_or_init(|| self.forward.jvp());
        program.run(with.len, &inputs[..2 * count], &mut results[..outputs]);
    }

    /// Number of arrays that [`Law::push_forward`] writes.
    pub(crate) fn tangent_count(&self) -> usize {
        OUTPUTS + self.history.len()
    }

    /// Number of arrays that [`Law::pull_back`] writes.
    pub(crate) fn cotangent_count(&self) -> usize {
        19 + self.parameters.len() + self.history.len()
    }

    fn input_count(&self) -> usize {
        FIXED + self.parameters.len() + self.history.len()
    }

    fn inputs<'a, T: Number>(&self, now: &'a [T], with: &Run<'a, T>) -> [Lanes<'a, T>; SLOTS] {
        let mut inputs = [Lanes::Same(T::ZERO); SLOTS];
        let array = |component: usize| Lanes::Each(&now[component * BLOCK + with.first..][..with.len]);
        for k in 0..9 {
            inputs[k] = array(F + k);
            inputs[9 + k] = array(super::state::C + k);
        }
        inputs[18] = Lanes::Same(with.dt);
        inputs[19] = Lanes::Same(with.stress_scale);
        inputs[20] = with.mass;
        let mut rest = FIXED;
        for values in with.parameters {
            inputs[rest] = values.run(with.particle, with.len);
            rest += 1;
        }
        for k in 0..self.history.len() {
            inputs[rest + k] = array(HISTORY + k);
        }
        inputs
    }
}

/// Consecutive particles of one material within a block, with their constants.
#[derive(Clone, Copy)]
pub(crate) struct Run<'a, T> {
    /// Index of the first one within the block.
    pub first: usize,
    /// Index of the first one among all particles.
    pub particle: usize,
    /// Number of particles.
    pub len: usize,
    /// Substep \[s\].
    pub dt: T,
    /// `dt V₀ 4/dx²`
    pub stress_scale: T,
    /// Particle masses \[kg\].
    pub mass: Lanes<'a, T>,
    /// Parameters in the material's order.
    pub parameters: &'a [Values<T>],
}

/// The response of a material at one particle.
struct Response {
    f: Mat3,
    tau: Mat3,
    history: Vec<Scalar>,
    /// Whether the law has a return map.
    returned: bool,
}

/// Trial deformation, return map, history, stress.
#[track_caller]
fn respond(material: &impl Material, previous: Mat3, c: Mat3, mut given: Given) -> Response {
    let trial = Point { f: (Mat3::eye() + c * given.dt) * previous, previous, c };
    let projected = material.return_map(&trial, &given);
    let f = projected.unwrap_or(trial.f);
    let history = material.evolve(&trial, &given);
    let (found, wanted) = (history.len(), given.history.len());
    assert!(found == wanted, "{}: {found} history variables evolve, {wanted} are declared", material.name());
    for ((_, old), new) in given.history.iter_mut().zip(&history) {
        *old = *new;
    }
    Response { f, tau: material.stress(&Point { f, ..trial }, &given), history, returned: projected.is_some() }
}

/// Whether the history of a particle that is deformed stays as it is.
fn keeps_history(law: &Program, parameters: &[Parameter], history: &[History]) -> bool {
    let f = [1.1, 0.05, -0.02, 0.03, 0.95, 0.04, -0.06, 0.01, 1.02];
    let c = [2.0, -1.0, 0.5, 1.5, -3.0, 0.7, -0.4, 1.2, 0.9];
    let before: Vec<f64> = history.iter().map(|variable| variable.start).collect();
    let values = parameters.iter().map(|p| p.start).chain(before.iter().copied());
    let inputs: Vec<f64> = f.into_iter().chain(c).chain([1e-3]).chain(values).collect();
    law.eval(&inputs)[18..] == before[..]
}

/// The places of particles relative to their mean \[m\].
pub(crate) fn places(positions: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let count = positions.len().max(1) as f64;
    let middle: [f64; 3] = std::array::from_fn(|axis| positions.iter().map(|x| x[axis]).sum::<f64>() / count);
    positions.iter().map(|x| crate::vector::minus(*x, middle)).collect()
}

/// The first `count` arrays of a buffer.
fn arrays<T>(buffer: &mut [T], count: usize) -> impl Iterator<Item = &mut [T]> {
    buffer.chunks_exact_mut(BLOCK).take(count)
}

/// The lanes of a run in each array; unused slots are empty.
fn cut<'a, T: 'a>(mut arrays: impl Iterator<Item = &'a mut [T]>, with: &Run<'_, T>) -> [&'a mut [T]; SLOTS] {
    std::array::from_fn(|_| arrays.next().map_or(Default::default(), |array| &mut array[with.first..][..with.len]))
}
