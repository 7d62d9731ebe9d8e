//! A material, traced: the programs that a substep runs over blocks of particles.

use std::sync::Arc;

use gradreel::scalar::{Lanes, Mat3, Program, Scalar};

use super::material::{Given, Material, Point};
use super::parameters::Parameter;
use super::row::Number;
use super::state::{BLOCK, F};

/// Most parameters a material may have.
pub(crate) const PARAMETER_LIMIT: usize = 16;

/// Inputs before the parameters: F 9, C 9, substep, stress scale, mass.
const FIXED: usize = 21;
/// Outputs: projected deformation gradient 9, affine matrix 9.
const OUTPUTS: usize = 18;
/// Upper bound of what any of the programs takes or returns.
const SLOTS: usize = FIXED + PARAMETER_LIMIT + OUTPUTS;

/// A material together with its scalar programs.
///
/// - `law`: `F, C, dt, parameters ↦ F′, τ`, for looking at a material by itself;
/// - `forward`: `F, C, dt, s, m, parameters ↦ F′, A`, all that happens to one particle before the transfer:
///   `F_trial = (I + dt C) F`, the return map, and `A = m C − s τ` with `s = dt V₀ 4/dx²`;
/// - `reverse`: its vector-Jacobian product with respect to `F, C, m` and the parameters.
#[derive(Debug, Clone)]
pub struct Law {
    material: Arc<dyn Material>,
    parameters: Vec<Parameter>,
    law: Program,
    forward: Program,
    reverse: Program,
}

impl Law {
    /// Traces a material.
    ///
    /// # Panics
    ///
    /// If it declares more than 16 parameters.
    #[track_caller]
    pub fn of(material: impl Material) -> Self {
        let parameters = material.parameters();
        let limit = PARAMETER_LIMIT;
        assert!(
            parameters.len() <= limit,
            "{}: {} parameters, the limit is {limit}",
            material.name(),
            parameters.len()
        );
        let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
        let matrix = |name: &str| (0..9).map(move |k| format!("{name}{}{}", k / 3, k % 3)).collect::<Vec<_>>();
        let trace = |name: &str, between: &[&str], second: &str, f: &dyn Fn(&[Scalar]) -> Vec<Scalar>| {
            let inputs = [matrix("f"), matrix("c")].concat();
            let outputs = [matrix("f_new"), matrix(second)].concat();
            let inputs: Vec<&str> =
                inputs.iter().map(String::as_str).chain(between.iter().chain(&names).copied()).collect();
            let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
            Program::trace(&format!("{}_{name}", material.name()), &inputs, &outputs, f)
        };
        let given = |dt: Scalar, values: &[Scalar]| Given {
            values: names.iter().copied().zip(values.iter().copied()).collect(),
            dt,
        };
        let law = trace("law", &["dt"], "tau", &|x| {
            let (f, tau) =
                respond(&material, Mat3::from_slice(&x[..9]), Mat3::from_slice(&x[9..18]), &given(x[18], &x[19..]));
            [f.to_vec(), tau.to_vec()].concat()
        });
        let forward = trace("forward", &["dt", "scale", "mass"], "a", &|x| {
            let c = Mat3::from_slice(&x[9..18]);
            let (f, tau) = respond(&material, Mat3::from_slice(&x[..9]), c, &given(x[18], &x[FIXED..]));
            [f.to_vec(), (c * x[20] - tau * x[19]).to_vec()].concat()
        });
        let wanted: Vec<usize> = (0..18).chain(20..FIXED + parameters.len()).collect();
        let reverse = forward.vjp_wrt(&wanted);
        Self { material: Arc::new(material), parameters, law, forward, reverse }
    }

    /// The material's name.
    pub fn name(&self) -> &str {
        self.material.name()
    }

    /// What can be fitted, in order.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// An upper estimate of the speed of sound \[m/s\]; see [`Material::wave_speed`].
    pub fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        self.material.wave_speed(values, density)
    }

    /// `F (9), C (9), dt, parameters ↦ F′ (9), τ (9)`, row by row; `F′` is the projection of `(I + dt C) F`.
    pub fn program(&self) -> &Program {
        &self.law
    }

    /// Runs the forward program over the first `len` particles of a block: reads `F, C` of `now`, writes `F` of `next` and
    /// the affine matrices (9 arrays).
    pub(crate) fn advance<T: Number>(&self, now: &[T], with: &Block<'_, T>, next: &mut [T], affine: &mut [T]) {
        let inputs = self.inputs(now, with);
        let into = next[F * BLOCK..].chunks_exact_mut(BLOCK).take(9).chain(affine.chunks_exact_mut(BLOCK).take(9));
        let mut outputs = cut(into, with.len);
        self.forward.run(with.len, &inputs[..self.input_count()], &mut outputs[..OUTPUTS]);
    }

    /// Runs the reverse program: cotangents of `F′` and `A` to those of `F`, `C`, mass and parameters, one array each.
    pub(crate) fn pull_back<T: Number>(&self, now: &[T], with: &Block<'_, T>, f: &[T], affine: &[T], out: &mut [T]) {
        let mut inputs = self.inputs(now, with);
        let count = self.input_count();
        let cotangents = f.chunks_exact(BLOCK).take(9).chain(affine.chunks_exact(BLOCK).take(9));
        for (slot, cotangent) in inputs[count..].iter_mut().zip(cotangents) {
            *slot = Lanes::Each(&cotangent[..with.len]);
        }
        let arrays = self.cotangent_count();
        let mut outputs = cut(out.chunks_exact_mut(BLOCK).take(arrays), with.len);
        self.reverse.run(with.len, &inputs[..count + OUTPUTS], &mut outputs[..arrays]);
    }

    /// Arrays that [`Law::pull_back`] writes.
    pub(crate) fn cotangent_count(&self) -> usize {
        19 + self.parameters.len()
    }

    fn input_count(&self) -> usize {
        FIXED + self.parameters.len()
    }

    fn inputs<'a, T: Number>(&self, now: &'a [T], with: &Block<'a, T>) -> [Lanes<'a, T>; SLOTS] {
        let mut inputs = [Lanes::Same(T::ZERO); SLOTS];
        for k in 0..9 {
            let array = |component: usize| Lanes::Each(&now[component * BLOCK..][..with.len]);
            inputs[k] = array(F + k);
            inputs[9 + k] = array(super::state::C + k);
        }
        inputs[18] = Lanes::Same(with.dt);
        inputs[19] = Lanes::Same(with.stress_scale);
        inputs[20] = with.mass;
        inputs[FIXED..][..self.parameters.len()].copy_from_slice(&with.parameters[..self.parameters.len()]);
        inputs
    }
}

/// What is constant for a block of particles during a rollout.
#[derive(Clone, Copy)]
pub(crate) struct Block<'a, T> {
    /// Particles in it.
    pub len: usize,
    /// Substep \[s\].
    pub dt: T,
    /// `dt V₀ 4/dx²`
    pub stress_scale: T,
    /// Particle masses \[kg\].
    pub mass: Lanes<'a, T>,
    /// Parameters in the material's order.
    pub parameters: [Lanes<'a, T>; PARAMETER_LIMIT],
}

/// Trial deformation, return map, stress.
fn respond(material: &impl Material, previous: Mat3, c: Mat3, given: &Given) -> (Mat3, Mat3) {
    let trial = Point { f: (Mat3::eye() + c * given.dt) * previous, previous, c };
    let f = material.return_map(&trial, given).unwrap_or(trial.f);
    (f, material.stress(&Point { f, ..trial }, given))
}

/// The first `len` values of each array, in a fixed number of places.
fn cut<'a, T: 'a>(mut arrays: impl Iterator<Item = &'a mut [T]>, len: usize) -> [&'a mut [T]; SLOTS] {
    std::array::from_fn(|_| arrays.next().map_or(Default::default(), |array| &mut array[..len]))
}
