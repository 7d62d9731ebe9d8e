//! Gradient checks: the tape's derivative against central differences in `f64`.
//!
//! [`gradcheck`] takes any function of variables, with an op, a material or a whole renderer inside. The result is
//! contracted with fixed pseudo-random weights to a single number, so that every output element counts.
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
#[derive(Debug, Clone)]
pub struct GradCheck {
    /// Step of the central difference, relative to `max(1, |x|)` unless a scale is given.
    pub step: f64,
    /// Largest accepted relative error.
    pub tolerance: f64,
    /// At most so many entries of each input are perturbed, spread evenly.
    pub entries: usize,
}

impl Default for GradCheck {
    fn default() -> Self {
        Self { step: 1e-6, tolerance: 1e-6, entries: 200 }
    }
}

/// The outcome of a gradient check, one row per input. Prints as a table.
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
#[derive(Debug, Clone)]
pub struct GradRow {
    /// Name of the input.
    pub input: String,
    /// Number of entries perturbed.
    pub entries: usize,
    /// Largest absolute difference.
    pub max_abs: f64,
    /// Largest relative difference beyond what rounding of the loss explains: to the larger of both numbers at the entry,
    /// and at least 1e-3 of the largest gradient entry of the input.
    pub max_rel: f64,
    /// Where the largest relative difference is.
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
        let size: f64 = result.value()?.to_vec()?.iter().map(|y| y.abs()).sum();
        // the loss is rounded by some ε of what it is a sum of, and the difference divides that by twice the step
        let noise = if size.is_finite() { f64::EPSILON * size / self.step } else { 0.0 };
        let gradients = contract(&result).backward()?;
        let value = |values: &[Tensor]| -> Result<f64> {
            let tape = Tape::new();
            let inputs: Vec<_> = values.iter().map(|x| tape.constant(x.clone())).collect();
            contract(&function(&tape, &inputs)?).item()
        };
        let mut values: Vec<_> = inputs.iter().map(|(_, x)| x.clone()).collect();
        let mut rows = Vec::new();
        for (i, (input, x)) in inputs.iter().enumerate() {
            let gradient = gradients.wrt(&leaves[i])?.slice::<f64>().to_vec();
            let picked = spread(x.len(), self.entries);
            let mut differences = Vec::with_capacity(picked.len());
            for &entry in &picked {
                let step = self.step * x.slice::<f64>()[entry].abs().max(1.0);
                let mut at = |sign: f64| {
                    let mut moved = x.slice::<f64>().to_vec();
                    moved[entry] += sign * step;
                    values[i] = Tensor::from_vec(moved, x.shape());
                    value(&values)
                };
                differences.push((at(1.0)? - at(-1.0)?) / (2.0 * step));
            }
            values[i] = x.clone();
            rows.push(self.row(input, x, &picked, &gradient, &differences, noise));
        }
        Ok(GradReport { name: name.to_owned(), settings: self.clone(), rows })
    }

    /// As [`GradCheck::function`], one order higher: compares the gradient of the gradient with central differences of
    /// the gradient. `function` is differentiated twice, so that each op in it must be able to.
    ///
    /// # Errors
    /// As [`GradCheck::function`]; [`ErrorKind::Unsupported`] when an op cannot be differentiated twice.
    pub fn gradient(
        &self,
        name: &str,
        inputs: &[(&str, Tensor)],
        function: impl Fn(&Tape, &[Var]) -> Result<Var>,
    ) -> Result<GradReport> {
        // one number made of all gradients
        let slopes = |tape: &Tape, leaves: &[Var]| -> Result<Var> {
            let refs: Vec<&Var> = leaves.iter().collect();
            let mut total = tape.constant(Tensor::scalar(0.0, DType::F64));
            for x in leaves {
                // so that what is linear in an input has a gradient of zero, not none
                total = &total + &(&x.sum_all() * 0.0);
            }
            for slope in contract(&(function(tape, leaves)?)).gradients_of(&refs)? {
                total = &total + &contract(&slope);
            }
            Ok(total)
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

    fn row(
        &self,
        input: &str,
        x: &Tensor,
        picked: &[usize],
        gradient: &[f64],
        differences: &[f64],
        noise: f64,
    ) -> GradRow {
        let scale = gradient.iter().chain(differences).fold(0.0f64, |m, g| m.max(g.abs()));
        let mut row = GradRow {
            input: input.to_owned(),
            entries: picked.len(),
            max_abs: 0.0,
            max_rel: 0.0,
            at: Vec::new(),
            tape: 0.0,
            difference: 0.0,
            passed: true,
        };
        for (&entry, &difference) in picked.iter().zip(differences) {
            let tape = gradient[entry];
            let abs = (tape - difference).abs();
            let beyond = if abs <= noise { 0.0 } else { abs - noise };
            let rel = beyond / tape.abs().max(difference.abs()).max(1e-3 * scale).max(1e-9);
            row.max_abs = row.max_abs.max(abs);
            if rel > row.max_rel || rel.is_nan() || row.at.is_empty() {
                (row.max_rel, row.at, row.tape, row.difference) = (rel, x.shape().index(entry), tape, difference);
            }
            if rel.is_nan() {
                break;
            }
        }
        row.passed = row.max_rel <= self.tolerance;
        row
    }
}

impl GradReport {
    /// Whether every input is within the tolerance.
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
    let weights: Vec<f64> = Key::new(0x6772_6164).uniform(y.len()).map(|u| 0.5 + u).collect();
    let weights = Tensor::from_vec(weights, y.shape()).cast(y.dtype()).and_then(|w| w.to_device(&y.device()));
    match weights {
        Ok(weights) => (y * &y.tape().constant(weights)).sum_all(),
        Err(fault) => {
            y.tape().keep_fault(fault);
            y.sum_all()
        }
    }
}

/// At most `count` indices spread evenly over `0..len`.
fn spread(len: usize, count: usize) -> Vec<usize> {
    if len <= count { (0..len).collect() } else { (0..count).map(|i| i * len / count).collect() }
}
