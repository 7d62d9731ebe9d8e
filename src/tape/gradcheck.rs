//! Gradient checks: the tape's derivative against central differences in `f64`.
//!
//! [`gradcheck`] takes any function of variables, with an op, a material or a whole renderer inside. The result is
//! contracted with fixed pseudo-random weights to a single number, so that every output element counts. Differences are
//! taken output by output before that: what an entry does not reach cancels exactly and lends it no rounding.
//!
//! ```
//! use gradreel::{Tensor, gradcheck};
//!
//! let x = Tensor::from_vec(vec![0.3f64, -1.2, 4.0], [3]);
//! let report = gradcheck("x tanh(x)", &[("x", x)], |_, v| Ok(&v[0] * &v[0].tanh()))?;
//! println!("{report}");
//! assert!(report.passed());
//! # Ok::<(), gradreel::Error>(())
//! ```

use std::fmt;

use crate::random::Key;
use crate::tape::{Tape, Var};
use crate::{DType, Error, ErrorKind, Result, Tensor};

/// How a gradient check is done.
///
/// ```
/// use gradreel::{GradCheck, Tensor};
/// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
/// let check = GradCheck { tolerance: 1e-8, ..GradCheck::default() };
/// assert!(check.function("sin", &[("x", x)], |_, x| Ok(x[0].sin().sum_all()))?.passed());
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct GradCheck {
    /// Step of the central difference, relative to `max(1, |x|)` unless a scale is given.
    pub step: f64,
    /// Largest accepted relative error.
    pub tolerance: f64,
    /// At most so many entries of each input are perturbed one by one, spread evenly; all others together, along a random
    /// direction.
    pub entries: usize,
}

impl Default for GradCheck {
    fn default() -> Self {
        Self { step: 1e-6, tolerance: 1e-6, entries: 200 }
    }
}

/// The outcome of a gradient check, one row per input. Prints as a table.
///
/// ```
/// use gradreel::{Tensor, gradcheck};
/// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
/// let report = gradcheck("sin", &[("x", x)], |_, x| Ok(x[0].sin().sum_all()))?;
/// assert_eq!(report.rows.len(), 1);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct GradReport {
    /// What was checked.
    pub name: String,
    /// How.
    pub settings: GradCheck,
    /// One row per input.
    pub rows: Vec<GradRow>,
}

/// What a gradient check found for one input.
///
/// ```
/// use gradreel::{Tensor, gradcheck};
/// let x = Tensor::from_vec(vec![0.3], [1]);
/// let report = gradcheck("sin", &[("x", x)], |_, x| Ok(x[0].sin()))?;
/// println!("{:?}", report.rows[0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct GradRow {
    /// Name of the input.
    pub input: String,
    /// Number of entries perturbed one by one.
    pub entries: usize,
    /// Largest absolute difference.
    pub max_abs: f64,
    /// Largest relative difference beyond what rounding of the outputs that the entry reaches explains: to the larger of
    /// both numbers at the entry, and at least 1e-6 of the largest gradient entry of the input. Rounding explains at most
    /// 1e-5 of that largest entry, unless all of the gradient is below the rounding.
    pub max_rel: f64,
    /// Where the largest relative difference is; empty for the entries perturbed together.
    pub at: Vec<usize>,
    /// The tape's derivative there.
    pub tape: f64,
    /// The central difference there.
    pub difference: f64,
    /// Whether it is within the tolerance.
    pub passed: bool,
}

/// Checks a function with the default settings; see [`GradCheck::function`].
///
/// ```
/// use gradreel::{Tensor, gradcheck};
/// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
/// let report = gradcheck("sin", &[("x", x)], |_, x| Ok(x[0].sin().sum_all()))?;
/// println!("{report}");
/// assert!(report.passed());
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// As [`GradCheck::function`].
pub fn gradcheck(
    name: &str,
    inputs: &[(&str, Tensor)],
    function: impl Fn(&Tape, &[Var]) -> Result<Var>,
) -> Result<GradReport> {
    GradCheck::default().function(name, inputs, function)
}

impl GradCheck {
    /// Compares the tape's gradient of `function` at `inputs` (all `f64`) with central differences.
    ///
    /// ```
    /// use gradreel::{GradCheck, Tensor};
    /// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
    /// let report = GradCheck::default().function("exp", &[("x", x)], |_, x| Ok(x[0].exp().sum_all()))?;
    /// assert!(report.passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Unsupported`] for an input that is not `f64`; what the function and its derivative return.
    pub fn function(
        &self,
        name: &str,
        inputs: &[(&str, Tensor)],
        function: impl Fn(&Tape, &[Var]) -> Result<Var>,
    ) -> Result<GradReport> {
        if let Some((input, x)) = inputs.iter().find(|(_, x)| x.dtype() != DType::F64) {
            return Err(Error::new(ErrorKind::Unsupported, format!("gradcheck {name}: inputs must be f64"))
                .at(input)
                .found(x.dtype()));
        }
        let tape = Tape::new();
        let leaves: Vec<_> = inputs.iter().map(|(_, x)| tape.leaf(x.clone())).collect();
        let result = function(&tape, &leaves)?;
        let weights = weights(result.len());
        let gradients = contract(&result).backward()?;
        let mut values: Vec<_> = inputs.iter().map(|(_, x)| x.clone()).collect();
        let mut rows = Vec::new();
        for (i, (input, x)) in inputs.iter().enumerate() {
            let gradient = gradients.wrt(&leaves[i])?.slice::<f64>().to_vec();
            // inputs moved along a direction, given by entries and distances
            let mut along = |direction: &[(usize, f64)]| -> Result<Difference> {
                let mut at = |sign: f64| -> Result<Vec<f64>> {
                    let mut moved = x.slice::<f64>().to_vec();
                    direction.iter().for_each(|(entry, distance)| moved[*entry] += sign * self.step * distance);
                    values[i] = Tensor::from_vec(moved, x.shape());
                    let tape = Tape::new();
                    let inputs: Vec<_> = values.iter().map(|x| tape.constant(x.clone())).collect();
                    function(&tape, &inputs)?.value()?.to_vec()
                };
                Ok(Difference::between(&at(1.0)?, &at(-1.0)?, &weights, 2.0 * self.step))
            };
            let distance = |entry: usize| x.slice::<f64>()[entry].abs().max(1.0);
            let picked = spread(x.len(), self.entries);
            let mut samples = Vec::with_capacity(picked.len() + 1);
            for &entry in &picked {
                let (distance, tape) = (distance(entry), gradient[entry]);
                let found = along(&[(entry, distance)])?.over(distance);
                samples.push(Sample { at: x.shape().index(entry), tape, found, size: 0.0 });
            }
            let signs = Key::new(0x7369_676e).uniform(x.len()).map(|u| if u < 0.5 { -1.0 } else { 1.0 });
            let rest: Vec<(usize, f64)> = (0..x.len())
                .zip(signs)
                .filter(|(entry, _)| picked.binary_search(entry).is_err())
                .map(|(entry, sign)| (entry, sign * distance(entry)))
                .collect();
            if !rest.is_empty() {
                let shares = || rest.iter().map(|(entry, distance)| gradient[*entry] * distance);
                let size = shares().map(|share| share * share).sum::<f64>().sqrt();
                samples.push(Sample { at: Vec::new(), tape: shares().sum(), found: along(&rest)?, size });
            }
            values[i] = x.clone();
            rows.push(self.row(input, picked.len(), &gradient, samples));
        }
        Ok(GradReport { name: name.to_owned(), settings: self.clone(), rows })
    }

    /// As [`GradCheck::function`], one order higher: compares the gradient of the gradient with central differences of
    /// the gradient. `function` is differentiated twice, so that each op in it must be able to.
    ///
    /// ```
    /// use gradreel::{GradCheck, Tensor};
    /// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
    /// let report = GradCheck::default().gradient("cube", &[("x", x)], |_, x| Ok((&x[0].square() * &x[0]).sum_all()))?;
    /// assert!(report.passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`GradCheck::function`]; [`ErrorKind::Unsupported`] when an op cannot be differentiated twice.
    pub fn gradient(
        &self,
        name: &str,
        inputs: &[(&str, Tensor)],
        function: impl Fn(&Tape, &[Var]) -> Result<Var>,
    ) -> Result<GradReport> {
        // all gradients, one after the other
        let slopes = |tape: &Tape, leaves: &[Var]| -> Result<Var> {
            let refs: Vec<&Var> = leaves.iter().collect();
            let found = contract(&function(tape, leaves)?).gradients_of(&refs)?;
            let flat: Vec<Var> = found.iter().map(|slope| slope.reshape([slope.len()])).collect();
            let Some((first, others)) = flat.split_first() else {
                return Ok(tape.constant(Tensor::zeros([0], DType::F64)));
            };
            let joined = first.concat(&others.iter().collect::<Vec<_>>(), 0);
            // zero times each input, whatever it holds (no number is below itself): so that what is linear in an input has
            // a gradient of zero, not none
            let zero = tape.constant(Tensor::scalar(0.0, DType::F64));
            Ok(leaves.iter().fold(joined, |all, x| &all + &x.lt(x).choose(x, &zero).sum_all()))
        };
        self.function(name, inputs, |tape, vars| {
            if vars.iter().all(Var::is_differentiable) {
                return slopes(tape, vars);
            }
            let inner = Tape::new();
            let leaves: Vec<_> = vars.iter().map(|x| inner.leaf(x.tensor().clone())).collect();
            Ok(tape.constant(slopes(&inner, &leaves)?.value()?.clone()))
        })
    }

    fn row(&self, input: &str, entries: usize, gradient: &[f64], samples: Vec<Sample>) -> GradRow {
        let largest = gradient.iter().fold(0.0f64, |most, g| most.max(g.abs()));
        let largest = samples.iter().filter(|s| s.size == 0.0).fold(largest, |most, s| most.max(s.found.slope.abs()));
        let (max_abs, at) = (0.0, Vec::new());
        let mut row = GradRow {
            input: input.to_owned(),
            entries,
            max_abs,
            max_rel: -1.0,
            at,
            tape: 0.0,
            difference: 0.0,
            passed: true,
        };
        for Sample { at, tape, found, size } in samples {
            let Difference { slope, noise } = found;
            let scale = largest.max(size);
            let abs = (tape - slope).abs();
            let explained = if scale <= noise { noise } else { noise.min(EXPLAINED * scale) };
            let beyond = if abs <= explained { 0.0 } else { abs - explained };
            let rel = beyond / tape.abs().max(slope.abs()).max(size).max(SMALL * scale).max(1e-9);
            row.max_abs = row.max_abs.max(abs);
            if rel > row.max_rel || rel.is_nan() {
                (row.max_rel, row.at, row.tape, row.difference) = (rel, at, tape, slope);
            }
            if rel.is_nan() {
                break;
            }
        }
        row.max_rel = if row.max_rel < 0.0 { 0.0 } else { row.max_rel };
        row.passed = row.max_rel <= self.tolerance;
        row
    }
}

/// The share of the largest gradient entry that rounding may explain at most: a derivative that is wrong by a thousandth
/// must not pass where outputs are large.
const EXPLAINED: f64 = 1e-5;

/// The share of the largest gradient entry below which entries are compared to that share.
const SMALL: f64 = 1e-6;

/// How often an output may have been rounded, on both sides of a difference: it is the end of a few operations.
const ROUNDINGS: f64 = 4.0;

/// A central difference of a contracted result.
struct Difference {
    slope: f64,
    /// What rounding of the outputs that changed may make of it.
    noise: f64,
}

impl Difference {
    /// Of outputs at two places, contracted with these weights.
    fn between(above: &[f64], below: &[f64], weights: &[f64], distance: f64) -> Self {
        let changed = || above.iter().zip(below).zip(weights).filter(|((a, b), _)| a != b);
        let size = |a: &f64, b: &f64| a.abs().max(b.abs());
        // an output that happens to be small is the sum of terms that are not
        let typical = changed().map(|((a, b), _)| size(a, b)).sum::<f64>() / changed().count().max(1) as f64;
        let slope: f64 = changed().map(|((a, b), weight)| weight * (a - b)).sum();
        let noise: f64 = changed().map(|((a, b), weight)| weight * size(a, b).max(typical)).sum();
        let noise = if noise.is_finite() { 2.0 * ROUNDINGS * f64::EPSILON * noise } else { 0.0 };
        Self { slope: slope / distance, noise: noise / distance }
    }

    /// For a direction that was so many times as long.
    fn over(self, length: f64) -> Self {
        Self { slope: self.slope / length, noise: self.noise / length }
    }
}

/// A derivative of the tape, along one entry or several, and the difference it is compared with.
struct Sample {
    at: Vec<usize>,
    tape: f64,
    found: Difference,
    /// For several entries, the size of the derivative were its signs random.
    size: f64,
}

impl GradReport {
    /// Whether every input is within the tolerance.
    ///
    /// ```
    /// use gradreel::{Tensor, gradcheck};
    /// let x = Tensor::from_vec(vec![0.3, 1.2], [2]);
    /// assert!(gradcheck("sin", &[("x", x)], |_, x| Ok(x[0].sin().sum_all()))?.passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn passed(&self) -> bool {
        self.rows.iter().all(|row| row.passed)
    }
}

impl fmt::Display for GradReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let GradCheck { step, tolerance, .. } = self.settings;
        writeln!(f, "gradcheck {}   f64   central difference, h = {step:.0e}, tolerance {tolerance:.0e}", self.name)?;
        writeln!(f, "  {:<16} {:>8} {:>11} {:>10}   {:<14} result", "input", "entries", "max |abs|", "max rel", "at")?;
        for row in &self.rows {
            let at = format!("{:?}", row.at);
            write!(
                f,
                "  {:<16} {:>8} {:>11.1e} {:>10.1e}   {at:<14} ",
                row.input, row.entries, row.max_abs, row.max_rel
            )?;
            match row.passed {
                true => writeln!(f, "ok")?,
                false => writeln!(f, "FAIL  tape {:.6e}  difference {:.6e}", row.tape, row.difference)?,
            }
        }
        Ok(())
    }
}

/// Contracts any result with fixed weights in [0.5, 1.5) to one number.
pub(super) fn contract(y: &Var) -> Var {
    let weights = Tensor::from_vec(weights(y.len()), y.shape()).cast(y.dtype()).and_then(|w| w.to_device(&y.device()));
    match weights {
        Ok(weights) => (y * &y.tape().constant(weights)).sum_all(),
        Err(fault) => {
            y.tape().keep_fault(fault);
            y.sum_all()
        }
    }
}

fn weights(count: usize) -> Vec<f64> {
    Key::new(0x6772_6164).uniform(count).map(|u| 0.5 + u).collect()
}

/// At most `count` indices spread evenly over `0..len`.
fn spread(len: usize, count: usize) -> Vec<usize> {
    if len <= count { (0..len).collect() } else { (0..count).map(|i| i * len / count).collect() }
}
