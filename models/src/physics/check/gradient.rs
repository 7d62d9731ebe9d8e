//! Gradient check of a material: the derivative of its traced law against central differences in `f64`.

use std::rc::Rc;

use gradreel::ops::{Map, uniform};
use gradreel::scalar::{Program, Scalar};
use gradreel::{GradCheck, GradReport, Op, Result, Tensor, Var};

use crate::physics::law::Law;

/// Number of states checked: random ones around rest, and a pure compression, in which all principal stretches
/// coincide.
const STATES: usize = 12;
/// The substep \[s\] at the states; also the unit of its variation.
const DT: f64 = 1e-3;

impl Law {
    /// Checks the derivative of projected deformation and stress with respect to deformation gradient, velocity
    /// gradient and every parameter; in the last state all principal stretches coincide. The substep is varied in units
    /// of a millisecond, since a central difference over a larger step would include curvature of the law. For more
    /// checks, see [`check_material`](crate::physics::check_material).
    ///
    /// ```
    /// use gradreel_models::physics::materials;
    ///
    /// let report = materials::find("neo_hookean").unwrap().gradcheck()?;
    /// println!("{report}");
    /// assert!(report.passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// Propagates errors of [`GradCheck::function`].
    pub fn gradcheck(&self) -> Result<GradReport> {
        self.gradcheck_of(|whole| Rc::new(Map::new(whole)))
    }

    /// The check of the op that `op` builds from the program.
    fn gradcheck_of(&self, op: impl FnOnce(Program) -> Rc<dyn Op>) -> Result<GradReport> {
        let program = self.program();
        let names: Vec<&str> = program.inputs().iter().map(String::as_str).collect();
        let fixed = names.iter().position(|name| *name == "dt").unwrap_or(names.len());
        // stresses are of the order of the P-wave modulus ρ c²; F is of order 1
        let values = self.start_values();
        let stiffness = self.wave_speed(&values, 1.0).powi(2);
        let starts: Vec<f64> = values.into_iter().chain(self.history().iter().map(|variable| variable.start)).collect();
        let whole = Program::trace(&format!("{}_contracted", self.name()), &names, &["y"], |x| {
            let mut x = x.to_vec();
            if let Some(dt) = x.get_mut(fixed) {
                *dt *= DT;
            }
            let outputs = program.apply(&x);
            let sum = outputs.iter().enumerate().fold(Scalar::from(0.0), |sum, (i, y)| {
                let scale = if (9..18).contains(&i) { 1.0 / stiffness } else { 1.0 };
                sum + *y * (scale * (0.6 + 0.1 * i as f64))
            });
            vec![sum]
        });
        let mut inputs: Vec<(&str, Tensor)> = Vec::new();
        for (i, name) in names.iter().enumerate() {
            let values = match i {
                0..9 => {
                    let compressed = if i % 4 == 0 { 0.97 } else { 0.0 };
                    perturbed(i, compressed, 0.15)
                }
                9..18 => perturbed(i, 0.0, 2.0),
                _ if i == fixed => vec![1.0; STATES],
                _ => vec![starts[i - fixed - 1]; STATES],
            };
            inputs.push((name, Tensor::from_vec(values, [STATES])));
        }
        let op = op(whole);
        // velocity gradients act through the short substep: a step of about ∛ε keeps rounding errors below the
        // tolerance
        let check = GradCheck { step: 1e-5, ..GradCheck::default() };
        check.function(self.name(), &inputs, |tape, vars| tape.apply(op.clone(), &vars.iter().collect::<Vec<&Var>>()))
    }
}

/// `centre` with uniform noise of this size; the last entry without.
fn perturbed(seed: usize, centre: f64, size: f64) -> Vec<f64> {
    let noise = uniform(seed as u64 + 1, [STATES], -size..size);
    let mut values: Vec<f64> = noise.slice::<f64>().iter().map(|n| centre + n).collect();
    values[STATES - 1] = centre;
    values
}

#[cfg(test)]
mod tests {
    use gradreel::{Backward, Forward, Operands, Reads, Spec};

    use super::*;
    use crate::physics::materials;

    /// An op whose derivative with respect to one input is wrong by a relative error.
    #[derive(Debug)]
    struct Wrong {
        map: Map,
        input: usize,
        share: f64,
    }

    impl Op for Wrong {
        fn name(&self) -> &str {
            "wrong"
        }

        fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
            self.map.infer(inputs)
        }

        fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
            self.map.forward_cpu(inputs)
        }

        fn reads(&self, wanted: &[bool]) -> Reads {
            self.map.reads(wanted)
        }

        fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
            let mut found = self.map.vjp(cx)?;
            if let Some(wrong) = &mut found[self.input] {
                *wrong = &*wrong * (1.0 + self.share);
            }
            Ok(found)
        }
    }

    #[test]
    fn right_derivatives_pass_and_wrong_ones_are_named() {
        for law in materials::all() {
            let report = law.gradcheck().unwrap();
            assert!(report.passed(), "{report}");
        }
        for (name, input) in ["snow", "viscoplastic"].iter().flat_map(|name| [(name, 0), (name, 18), (name, 19)]) {
            let law = materials::find(name).unwrap();
            let report = law.gradcheck_of(|whole| Rc::new(Wrong { map: Map::new(whole), input, share: 1e-4 })).unwrap();
            let wrong: Vec<usize> = (0..report.rows.len()).filter(|&row| !report.rows[row].passed).collect();
            assert_eq!(wrong, [input], "{report}");
        }
    }
}
