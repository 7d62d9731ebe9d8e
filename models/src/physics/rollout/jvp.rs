//! A rollout in forward mode.

use gradreel::{DType, Device, Error, ErrorKind, Op, Result, Spec, Tensor};

use super::{Rollout, finite, start, triples};
use crate::physics::forward::Tangent;
use crate::physics::row::Number;
use crate::physics::state::{State, V};
use crate::physics::substep::Simulation;
use crate::physics::trajectory::Trajectory;
use crate::physics::values::Values;

impl Rollout {
    /// Simulates, and differentiates along several directions at once in forward mode.
    ///
    /// `inputs` are those of the op, in order. A direction has a tangent of the same shape for each of them, `None`
    /// where it is zero. Returns the positions `[frames, n, 3]` \[m\] and their tangents, one per direction. A
    /// direction costs about two to three rollouts; memory does not grow with the number of substeps.
    /// [`Rollout::remat`] is not used.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel_models::physics::{Rollout, Schedule, World, materials};
    ///
    /// let numbers = |values: &[f64]| Tensor::from_vec(values.to_vec(), [values.len()]);
    /// let fall = Rollout {
    ///     world: World::new(0.02),
    ///     laws: vec![materials::find("neo_hookean").unwrap()],
    ///     material_of: None,
    ///     gravity: true,
    ///     friction: false,
    ///     schedule: Schedule { frames: 2, frame_dt: 0.01, substeps: 20 },
    ///     remat: None,
    /// };
    /// let inputs = [
    ///     Tensor::from_vec(vec![0.1, 0.2, 0.3], [1, 3]),
    ///     numbers(&[0.0, -1.0, 0.0]),
    ///     numbers(&[1000.0]),
    ///     numbers(&[0.0, -9.8, 0.0]),
    ///     numbers(&[1e5]),
    ///     numbers(&[0.3]),
    /// ];
    /// // Faster downwards by 1 m/s: after 0.01 s, 0.01 m lower.
    /// let mut faster = vec![None; 6];
    /// faster[1] = Some(numbers(&[0.0, -1.0, 0.0]));
    /// let (motion, changes) = fall.jvp(&inputs, &[faster])?;
    /// assert_eq!(motion.dims(), changes[0].dims());
    /// assert!((changes[0].to_vec()?[4] + 0.01).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As a [`rollout`](super::rollout()); [`ErrorKind::Shape`] for tangents of the wrong shape,
    /// [`ErrorKind::NonFinite`] for tangents that are or become non-finite; [`ErrorKind::Unsupported`] for tensors on a
    /// GPU.
    pub fn jvp(&self, inputs: &[Tensor], directions: &[Vec<Option<Tensor>>]) -> Result<(Tensor, Vec<Tensor>)> {
        let specs: Vec<Spec> = inputs.iter().map(|input| Spec::new(input.dims(), input.dtype())).collect();
        self.infer(&specs)?;
        let tangents = directions.iter().flatten().flatten();
        if let Some(stray) = inputs.iter().chain(tangents).find(|tensor| tensor.device() != Device::Cpu) {
            return Err(Error::new(ErrorKind::Unsupported, "forward mode of a rollout runs on the CPU only")
                .found(format!("a tensor on {}", stray.device()))
                .fix("move inputs and tangents there with to_device(&Device::Cpu), or use reverse mode"));
        }
        for (index, direction) in directions.iter().enumerate() {
            let fault = |what: &str| Error::new(ErrorKind::Shape, what).at(format!("direction {index} of a rollout"));
            if direction.len() != inputs.len() {
                let fault = fault("a direction has another number of tangents than there are inputs");
                return Err(fault.found(direction.len()).wanted(format!("{:?}", self.input_names())));
            }
            for (k, (tangent, input)) in direction.iter().zip(inputs).enumerate() {
                let Some(tangent) = tangent else { continue };
                if tangent.dims() != input.dims() || tangent.dtype() != input.dtype() {
                    return Err(fault("a tangent does not fit its input")
                        .at(self.input_names()[k])
                        .found(format!("{:?} {}", tangent.dims(), tangent.dtype()))
                        .wanted(format!("{:?} {}", input.dims(), input.dtype())));
                }
            }
        }
        match inputs[0].dtype() {
            DType::F64 => self.jvp_of::<f64>(inputs, directions),
            _ => self.jvp_of::<f32>(inputs, directions),
        }
    }

    fn jvp_of<T: Number>(
        &self,
        inputs: &[Tensor],
        directions: &[Vec<Option<Tensor>>],
    ) -> Result<(Tensor, Vec<Tensor>)> {
        let world = self.world_of::<T>(inputs)?;
        let (order, values) = self.prepare::<T>(inputs, &world)?;
        let n = order.len();
        let mut simulation = self.simulation(&world, &values, &order)?;
        let start = start::<T>(&simulation, inputs, &order)?;
        let mut tangents = Vec::with_capacity(directions.len());
        for direction in directions {
            for (tangent, name) in direction.iter().zip(self.input_names()) {
                tangent.as_ref().map_or(Ok(()), |t| finite(&format!("tangent of {name}"), t.slice::<T>(), 1))?;
            }
            tangents.push(self.tangent(&simulation, &start, direction, &order));
        }
        let mut outputs = vec![vec![[T::ZERO; 3]; self.schedule.frames * n]; 1 + directions.len()];
        rayon::scope(|_| {
            Trajectory::forward_jvp(&mut simulation, start, tangents, self.schedule, |frame, state, tangents| {
                for (p, &label) in order.iter().enumerate() {
                    let at = frame * n + label as usize;
                    outputs[0][at] = state.read(p, 0);
                    for (output, tangent) in outputs[1..].iter_mut().zip(tangents) {
                        output[at] = tangent.state.read(p, 0);
                    }
                }
            })
        })?;
        let shape = [self.schedule.frames, n, 3];
        let mut outputs = outputs.into_iter().map(|output| Tensor::from_vec(output.into_flattened(), shape));
        let motion = outputs.next().expect("the motion comes first");
        Ok((motion, outputs.collect()))
    }

    /// One direction, in grid order.
    fn tangent<T: Number>(
        &self,
        simulation: &Simulation<'_, T>,
        start: &State<T>,
        direction: &[Option<Tensor>],
        order: &[u32],
    ) -> Tangent<T> {
        let mut tangent = simulation.tangent(start);
        for (component, given) in [(0, &direction[0]), (V, &direction[1])] {
            let Some(given) = given else { continue };
            let each: Vec<[T; 3]> = triples(given);
            for (p, &label) in order.iter().enumerate() {
                let value = if given.dims().len() == 1 { each[0] } else { each[label as usize] };
                tangent.state.write(p, component, value);
            }
        }
        tangent.density = sorted(direction[2].as_ref(), order);
        if let (true, Some(given)) = (self.gravity, &direction[3]) {
            let given = given.slice::<T>();
            tangent.gravity = std::array::from_fn(|axis| given[axis].to_f64());
        }
        if let (true, Some(given)) = (self.friction, &direction[self.friction_at()]) {
            let given = given.slice::<T>();
            for (k, slot) in tangent.friction.iter_mut().enumerate() {
                *slot = given[if given.len() == 1 { 0 } else { k }].to_f64();
            }
        }
        let mut rest = direction[self.inputs_of_world()..].iter().map(|given| sorted(given.as_ref(), order));
        for parameters in &mut tangent.parameters {
            parameters.iter_mut().for_each(|slot| *slot = rest.next().expect("one tangent per input"));
        }
        tangent
    }
}

/// The tangent of a density or a parameter, in grid order.
fn sorted<T: Number>(given: Option<&Tensor>, order: &[u32]) -> Values<T> {
    let Some(given) = given else { return Values::Same(T::ZERO) };
    match given.slice::<T>() {
        &[one] if given.dims() == [1] => Values::Same(one),
        each => Values::Each(order.iter().map(|&p| each[p as usize]).collect()),
    }
}
