//! Checks of a single particle: stress, projection and their derivatives.

use gradreel::scalar::Program;

use super::MaterialCheck;
use crate::physics::law::Law;

/// A 3×3 matrix, row by row.
pub(super) type Matrix = [f64; 9];

pub(super) const IDENTITY: Matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
const STILL: Matrix = [0.0; 9];
/// A generic velocity gradient \[1/s\].
const STIRRED: Matrix = [0.3, -0.2, 0.1, 0.4, 0.2, -0.5, -0.1, 0.6, -0.3];
/// Substep \[s\].
const DT: f64 = 1e-4;
/// Density \[kg/m³\].
pub(super) const DENSITY: f64 = 1000.0;

/// A material at the initial values of its parameters, and its stress scale.
pub(super) struct Subject<'a> {
    law: &'a Law,
    vjp: Program,
    /// The P-wave modulus `ρ c²` \[Pa\].
    pub modulus: f64,
}

impl<'a> Subject<'a> {
    pub fn new(law: &'a Law) -> Self {
        let values = law.start_values();
        Self { law, vjp: law.program().vjp(), modulus: law.wave_speed(&values, DENSITY).powi(2) * DENSITY }
    }

    /// `F, C, dt, parameters, history`
    pub fn inputs(&self, f: Matrix, c: Matrix) -> Vec<f64> {
        let parameters = self.law.parameters().iter().map(|p| p.start);
        let history = self.law.history().iter().map(|variable| variable.start);
        f.into_iter().chain(c).chain([DT]).chain(parameters).chain(history).collect()
    }

    /// `F′, τ, history′`, with stresses in units of the modulus.
    fn respond(&self, inputs: &[f64]) -> Vec<f64> {
        let mut found = self.law.program().eval(inputs);
        found[9..18].iter_mut().for_each(|tau| *tau /= self.modulus);
        found
    }

    fn stress(&self, f: Matrix, c: Matrix) -> Matrix {
        std::array::from_fn({
            let found = self.respond(&self.inputs(f, c));
            move |k| found[9 + k]
        })
    }

    /// The stress in units of the modulus, of a particle at rest otherwise.
    pub fn still_stress(&self, f: Matrix) -> Matrix {
        self.stress(f, STILL)
    }

    /// The largest relative error of the derivative at a state, and the input of which it is.
    fn gradient_error(&self, f: Matrix) -> (f64, String) {
        let x = self.inputs(f, STIRRED);
        let weights: Vec<f64> = (0..18 + self.law.history().len()).map(|k| (1.0 + 0.7 * k as f64).sin()).collect();
        let objective = |x: &[f64]| -> f64 { self.respond(x).iter().zip(&weights).map(|(y, weight)| y * weight).sum() };
        let scaled = weights.iter().enumerate();
        let cotangents = scaled.map(|(k, w)| if (9..18).contains(&k) { w / self.modulus } else { *w });
        let gradient = self.vjp.eval(&x.iter().copied().chain(cotangents).collect::<Vec<_>>());
        let here = objective(&x);
        let mut worst = (0.0, String::new());
        for k in (0..x.len()).filter(|&k| k != 18) {
            // Scaled by the typical magnitude of the input.
            let usual = if k < 18 { 1.0 } else { x[k].abs().max(1e-2) };
            let step = 1e-5 * usual;
            let shifted = |by: f64| {
                let mut x = x.clone();
                x[k] += by;
                objective(&x)
            };
            let (after, before) = (shifted(step), shifted(-step));
            let sides = [(after - before) / (2.0 * step), (after - here) / step, (here - before) / step];
            let error = |difference: f64| (gradient[k] - difference).abs() * usual / (1.0 + difference.abs() * usual);
            // A one-sided difference is only first-order accurate.
            let off = sides.into_iter().zip([1.0, 1e-2, 1e-2]).map(|(side, trust)| error(side) * trust);
            let off = off.fold(f64::INFINITY, f64::min);
            // NaN counts as the worst.
            if off.is_nan() || off > worst.0 {
                worst = (off, format!("at {}", self.law.program().inputs()[k]));
            }
        }
        worst
    }

    /// The logarithmic stretch at which a body extended at constant volume yields, if between 1e-6 and 1.
    fn yield_stretch(&self) -> Result<f64, &'static str> {
        let flows = |stretch: f64| {
            let f = drawn(stretch);
            let found = self.respond(&self.inputs(f, STILL));
            f.iter().zip(&found).any(|(a, b)| (a - b).abs() > 1e-9)
        };
        let (mut low, mut high) = (1e-6, 1.0);
        if flows(low) {
            return Err("it flows at once");
        }
        if !flows(high) {
            return Err("it does not yield");
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if flows(middle) { high = middle } else { low = middle }
        }
        Ok(high)
    }
}

/// All single-particle checks.
pub(super) fn checks(law: &Law) -> Vec<MaterialCheck> {
    let subject = Subject::new(law);
    let rest = subject.stress(IDENTITY, STILL).iter().fold(0.0_f64, |most, tau| worse(most, tau.abs()));
    let mut checks = vec![
        MaterialCheck { name: "no stress at rest", found: rest, allowed: 1e-12, note: String::new() },
        frame_indifference(&subject),
        symmetry(&subject),
    ];
    let turned = |stretches: [f64; 3]| {
        let [a, b, c] = stretches;
        let stretch = [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c];
        times(times(rotation(0.4, 1.1), stretch), rotation(1.0, 2.0))
    };
    let mut gradient = |name: &'static str, states: &[Matrix]| {
        let errors = states.iter().map(|&f| subject.gradient_error(f));
        let (found, note) = errors.fold((0.0, String::new()), |most, one| if one.0 <= most.0 { most } else { one });
        checks.push(MaterialCheck { name, found, allowed: 1e-6, note });
    };
    gradient("gradient at rest", &[IDENTITY, rotation(0.3, -0.8)]);
    gradient(
        "gradient at repeated stretches",
        &[turned([1.02, 1.02, 0.97]), turned([0.97; 3]), turned([1.01, 0.98, 0.98])],
    );
    gradient("gradient under large stretch", &[turned([1.6, 1.1, 0.7]), turned([2.5, 0.9, 0.5])]);
    match subject.yield_stretch() {
        Ok(stretch) => {
            gradient("gradient just before yield", &[drawn(0.98 * stretch)]);
            gradient("gradient just after yield", &[drawn(1.02 * stretch)]);
        }
        Err(why) => checks.push(MaterialCheck::skipped("gradient on both sides of yield", why)),
    }
    checks.push(inversion(&subject));
    checks
}

fn frame_indifference(subject: &Subject<'_>) -> MaterialCheck {
    let states = [
        IDENTITY,
        drawn(0.01),
        times(rotation(0.2, 0.9), drawn(0.3)),
        [1.1, 0.2, -0.1, 0.05, 0.9, 0.15, -0.2, 0.1, 1.05],
    ];
    let mut found = 0.0;
    for f in states {
        let r = rotation(0.8, -1.9);
        let back = transposed(r);
        let (tau, turned) = (subject.stress(f, STIRRED), subject.stress(times(r, f), times(times(r, STIRRED), back)));
        let size = tau.iter().fold(1.0_f64, |most, tau| most.max(tau.abs()));
        for (a, b) in turned.iter().zip(times(times(r, tau), back)) {
            found = worse(found, (a - b).abs() / size);
        }
    }
    MaterialCheck { name: "frame indifference", found, allowed: 1e-11, note: String::new() }
}

/// The stress is symmetric: the body gains no spin from within.
fn symmetry(subject: &Subject<'_>) -> MaterialCheck {
    let sheared = [1.1, 0.2, -0.1, 0.05, 0.9, 0.15, -0.2, 0.1, 1.05];
    let mut found = 0.0;
    for f in [drawn(0.01), times(rotation(0.2, 0.9), drawn(0.3)), sheared] {
        let tau = subject.stress(f, STIRRED);
        let size = tau.iter().fold(1.0_f64, |most, tau| most.max(tau.abs()));
        for (a, b) in tau.iter().zip(transposed(tau)) {
            found = worse(found, (a - b).abs() / size);
        }
    }
    MaterialCheck { name: "symmetry of the stress", found, allowed: 1e-11, note: String::new() }
}

/// Inverted and collapsed particles: the response is finite, or NaN if the material declares so.
fn inversion(subject: &Subject<'_>) -> MaterialCheck {
    let diagonal = |a: f64, b: f64, c: f64| [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c];
    let states = [
        diagonal(1.0, 1.0, -0.9),
        diagonal(-1.0, -1.0, -1.0),
        times(rotation(0.5, 0.3), diagonal(1.2, -0.4, 0.9)),
        diagonal(1.0, 1.0, -1.0),
    ];
    let survives = subject.law.survives_inversion();
    let wrong = states.iter().filter(|&&f| {
        let found = subject.respond(&subject.inputs(f, STILL));
        found.iter().all(|y| y.is_finite()) != survives
    });
    let note = if survives { "finite" } else { "refused with NaN" };
    MaterialCheck { name: "inverted input", found: wrong.count() as f64, allowed: 0.0, note: note.to_owned() }
}

/// The larger value; NaN counts as the largest.
fn worse(a: f64, b: f64) -> f64 {
    if b <= a { a } else { b }
}

/// Extended along x by `eˢ` at constant volume, with unequal lateral stretches.
fn drawn(stretch: f64) -> Matrix {
    [stretch.exp(), 0.0, 0.0, 0.0, (-0.3 * stretch).exp(), 0.0, 0.0, 0.0, (-0.7 * stretch).exp()]
}

/// Rotation by these angles about z, then x.
fn rotation(a: f64, b: f64) -> Matrix {
    let about_z = [a.cos(), -a.sin(), 0.0, a.sin(), a.cos(), 0.0, 0.0, 0.0, 1.0];
    let about_x = [1.0, 0.0, 0.0, 0.0, b.cos(), -b.sin(), 0.0, b.sin(), b.cos()];
    times(about_x, about_z)
}

fn times(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|k| (0..3).map(|i| a[k / 3 * 3 + i] * b[3 * i + k % 3]).sum())
}

fn transposed(a: Matrix) -> Matrix {
    std::array::from_fn(|k| a[k % 3 * 3 + k / 3])
}
