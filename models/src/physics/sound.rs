//! The speed of sound of a material, computed from its stress alone.

use faer::{Mat, Side};
use gradreel::scalar::{Mat3, Program, Scalar};

use super::material::{Given, Material, Point};
use crate::vector::{EYE, product, unit};

type Matrix = [[f64; 3]; 3];

/// Strain increment of a loading path.
const STEP: f64 = 0.025;
/// Number of increments: a strain of a quarter.
const STEPS: usize = 10;
/// Substep \[s\] passed to return map and history along a path.
const DT: f64 = 1e-4;
/// Alternating optimisations of polarisation and direction of a wave.
const TURNS: usize = 6;
/// Change of `ρ c²` in a turn, as a share, after which there is no other.
const CLOSE: f64 = 1e-6;

/// The speed \[m/s\] of the fastest plane wave, over all directions and polarisations: at rest, and along paths of
/// compression, extension and shear up to a strain of a quarter, with return map and history applied along the path.
///
/// A small motion `u = a φ(n·x − c t)` of a body with deformation gradient `F` and stress `τ(F)` travels at
/// `ρ c² = a·Q(n) a`, `Q_ij = n_k n_l ∂τ_ik/∂F_jm F_lm − (τ n)_i n_j`, with the density `ρ` at rest.
pub(super) fn fastest<M: Material + ?Sized>(material: &M, values: &[f64], density: f64) -> f64 {
    let law = Probe::of(material, values);
    let starts = starts(material);
    let mut most = starts.iter().map(|rest| law.stiffness(rest)).fold(f64::NAN, f64::max);
    for (rest, path) in starts.iter().flat_map(|rest| paths().into_iter().map(move |path| (rest, path))) {
        let mut state = rest.clone();
        for step in 1..=STEPS {
            state = law.strained(&state, &path);
            let found = if step % 2 == 0 { law.stiffness(&state) } else { 0.0 };
            if !found.is_finite() {
                break; // outside the domain of the law
            }
            most = most.max(found);
        }
    }
    (most / density).sqrt()
}

/// How far from the middle of a body the history at rest is looked at \[m\].
const FAR: f64 = 0.05;

/// Particles at rest: one, or those with other histories among the middle of the body and six places around it.
fn starts<M: Material + ?Sized>(material: &M) -> Vec<State> {
    let along = |axis: usize| [FAR, -FAR].map(|far| std::array::from_fn(|k| if k == axis { far } else { 0.0 }));
    let mut found: Vec<Vec<f64>> = Vec::new();
    for place in (0..3).flat_map(along).chain([[0.0; 3]]) {
        match material.rest(place) {
            // the middle of radial fibres has no direction
            Some(history) if history.iter().all(|x| x.is_finite()) && !found.contains(&history) => found.push(history),
            _ => {}
        }
    }
    if found.is_empty() {
        found.push(material.history().iter().map(|variable| variable.start).collect());
    }
    found.into_iter().map(|history| State { f: EYE, history }).collect()
}

/// The speed \[m/s\] of the fastest plane wave at rest.
pub(super) fn at_rest<M: Material + ?Sized>(material: &M, values: &[f64], density: f64) -> f64 {
    let law = Probe::of(material, values);
    let most = starts(material).iter().map(|rest| law.stiffness(rest)).fold(f64::NAN, f64::max);
    (most / density).sqrt()
}

/// Increments `I + E` of the displacement gradient: isotropic, along each axis, and shear in each plane.
fn paths() -> Vec<Matrix> {
    let mut all = Vec::new();
    for by in [-STEP, STEP] {
        all.push(EYE.map(|row| row.map(|e| e * (1.0 + by))));
        for axis in 0..3 {
            let (mut stretched, mut sheared) = (EYE, EYE);
            stretched[axis][axis] += by;
            sheared[axis][(axis + 1) % 3] += by;
            all.extend([stretched, sheared]);
        }
    }
    all
}

/// The state of a particle on a path.
#[derive(Clone)]
struct State {
    f: Matrix,
    history: Vec<f64>,
}

/// A law with given parameters.
struct Probe {
    /// `F, history ↦ F′, history′` from a trial deformation gradient.
    response: Program,
    /// `F, history ↦ τ`
    stress: Program,
    /// Its Jacobian-vector product.
    tangent: Program,
}

impl Probe {
    fn of<M: Material + ?Sized>(material: &M, values: &[f64]) -> Self {
        let remembered = material.history();
        let names: Vec<String> = (0..9)
            .map(|k| format!("f{}{}", k / 3, k % 3))
            .chain(remembered.iter().map(|variable| variable.name.to_owned()))
            .collect();
        let inputs: Vec<&str> = names.iter().map(String::as_str).collect();
        let given = |history: &[Scalar]| {
            let parameters = material.parameters();
            Given {
                values: parameters.iter().map(|p| p.name).zip(values.iter().map(|&value| value.into())).collect(),
                history: remembered.iter().map(|variable| variable.name).zip(history.iter().copied()).collect(),
                dt: DT.into(),
            }
        };
        let point = |x: &[Scalar]| {
            let f = Mat3::from_slice(&x[..9]);
            Point { f, previous: f, c: Mat3::zero() }
        };
        let response = Program::trace("response", &inputs, &inputs, |x| {
            let (trial, given) = (point(x), given(&x[9..]));
            let f = material.return_map(&trial, &given).unwrap_or(trial.f);
            [f.to_vec(), material.evolve(&trial, &given)].concat()
        });
        let stress =
            Program::trace("stress", &inputs, &inputs[..9], |x| material.stress(&point(x), &given(&x[9..])).to_vec());
        let tangent = stress.jvp();
        Self { response, stress, tangent }
    }

    /// The particle after an increment.
    fn strained(&self, state: &State, increment: &Matrix) -> State {
        let trial = product(*increment, state.f);
        let mut found = self.response.eval(&[trial.as_flattened(), &state.history].concat());
        let history = found.split_off(9);
        State { f: std::array::from_fn(|i| std::array::from_fn(|j| found[3 * i + j])), history }
    }

    /// The largest `ρ c²` \[Pa\] of a plane wave; NaN where the stress is undefined.
    fn stiffness(&self, state: &State) -> f64 {
        let here = [state.f.as_flattened(), &state.history].concat();
        let tau = self.stress.eval(&here);
        // moduli[i][k][j][l] belongs to (a⊗n)_ik (a⊗n)_jl
        let mut moduli = [[[[0.0; 3]; 3]; 3]; 3];
        for (j, l) in (0..9).map(|k| (k / 3, k % 3)) {
            let mut change = vec![0.0; here.len()];
            change[3 * j..3 * j + 3].copy_from_slice(&state.f[l]);
            let slope = self.tangent.eval(&[&here[..], &change].concat());
            for (i, k) in (0..9).map(|m| (m / 3, m % 3)) {
                let turned = if k == j { tau[3 * i + l] } else { 0.0 };
                moduli[i][k][j][l] = slope[3 * i + k] - turned;
            }
        }
        if moduli.as_flattened().as_flattened().as_flattened().iter().any(|m| !m.is_finite()) {
            return f64::NAN;
        }
        // for a fixed direction the optimal polarisation is an eigenvector, and vice versa
        directions().into_iter().fold(0.0, |most: f64, start| {
            let (mut n, mut found) = (start, 0.0);
            for _ in 0..TURNS {
                let before = found;
                let (_, a) = largest(&|i, j| twice(&|k, l| moduli[i][k][j][l], n));
                (found, n) = largest(&|k, l| twice(&|i, j| moduli[i][k][j][l], a));
                if (found - before).abs() <= CLOSE * found.abs() {
                    break;
                }
            }
            most.max(found)
        })
    }
}

/// Unit vectors along the axes, the face diagonals and the space diagonals.
fn directions() -> Vec<[f64; 3]> {
    let all = (0..27).map(|k| [k / 9, k / 3 % 3, k % 3].map(|digit| f64::from(digit) - 1.0));
    // one of each opposite pair
    all.skip(14).map(unit).collect()
}

/// `Σ m(p, q) v_p v_q`
fn twice(m: &dyn Fn(usize, usize) -> f64, v: [f64; 3]) -> f64 {
    (0..9).map(|k| m(k / 3, k % 3) * v[k / 3] * v[k % 3]).sum()
}

/// The largest eigenvalue of the symmetric part of a matrix, and its eigenvector.
fn largest(m: &dyn Fn(usize, usize) -> f64) -> (f64, [f64; 3]) {
    let symmetric = Mat::from_fn(3, 3, |i, j| 0.5 * (m(i, j) + m(j, i)));
    match symmetric.self_adjoint_eigen(Side::Lower) {
        // eigenvalues are in ascending order
        Ok(found) => (found.S()[2], [0, 1, 2].map(|i| found.U()[(i, 2)])),
        Err(_) => (f64::NAN, [0.0; 3]),
    }
}
