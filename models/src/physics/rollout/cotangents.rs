//! Conversion of a simulation's cotangents to those of the inputs of a rollout.

use gradreel::{Backward, Result, Tensor, Var};

use super::{Rollout, finite, total};
use crate::physics::collider::Contact;
use crate::physics::row::Number;
use crate::physics::values::ValueGradients;

impl Rollout {
    /// The gradients of all inputs, in the caller's order of particles and summed for shared inputs; `start` holds the
    /// cotangents of initial positions and velocities.
    pub(super) fn hand_back<T: Number>(
        &self,
        cx: &Backward<'_>,
        inputs: &[Tensor],
        order: &[u32],
        start: [Vec<[T; 3]>; 2],
        values: ValueGradients<T>,
    ) -> Result<Vec<Option<Var>>> {
        let mut cotangents: Vec<Vec<T>> = start.into_iter().map(Vec::into_flattened).collect();
        cotangents.push(values.density);
        if self.gravity {
            cotangents.push(values.gravity.map(T::from_f64).to_vec());
        }
        if self.friction {
            let all = values.friction.iter().map(|&g| T::from_f64(g));
            let rough = self.world.colliders.iter().map(|c| matches!(c.contact, Contact::Friction(_)));
            let all: Vec<T> = all.zip(rough).map(|(g, rough)| if rough { g } else { T::ZERO }).collect();
            cotangents.push(if inputs[self.friction_at()].len() == 1 { total(&all, 1) } else { all });
        }
        cotangents.extend(values.parameters);
        let (tape, device) = (cx.input(0).tape(), cx.gradient().device());
        let mut gradients = Vec::with_capacity(inputs.len());
        for (index, (cotangent, input)) in cotangents.into_iter().zip(inputs).enumerate() {
            let name = format!("gradient of {}", self.input_names()[index]);
            let of_world = (3..self.inputs_of_world()).contains(&index);
            let width = if index < 2 || (index == 3 && self.gravity) { 3 } else { 1 };
            let gradient = if of_world || (input.len() == cotangent.len() && input.len() <= width) {
                cotangent
            } else if input.len() == width {
                total(&cotangent, width)
            } else {
                let mut back = vec![T::ZERO; cotangent.len()];
                for (p, &label) in order.iter().enumerate() {
                    back[label as usize * width..][..width].copy_from_slice(&cotangent[p * width..][..width]);
                }
                back
            };
            finite(&name, &gradient, width)?;
            gradients.push(Some(tape.constant(Tensor::from_vec(gradient, input.shape()).to_device(&device)?)));
        }
        Ok(gradients)
    }
}
