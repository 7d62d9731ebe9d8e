//! The backward pass: one loop over the tape from the result to the leaves.

use crate::tape::{Applied, Backward, Tape, Var, anomaly};
use crate::{Error, ErrorKind, Result, Tensor};

/// The gradients of a scalar with respect to the leaves of a tape.
pub struct Gradients {
    tape: Tape,
    by_node: Vec<Option<Tensor>>,
}

impl Gradients {
    /// The gradient with respect to a leaf.
    ///
    /// # Errors
    /// [`ErrorKind::NoGradient`] when the variable is a constant, lives on another tape, is not a leaf, or the result does
    /// not depend on it.
    pub fn wrt(&self, leaf: &Var) -> Result<&Tensor> {
        let reason = match leaf.node() {
            None => "it is a constant; make it with Tape::leaf",
            Some(_) if !self.tape.same(leaf.tape()) => "it lives on another tape",
            Some(node) => match self.by_node.get(node).and_then(Option::as_ref) {
                Some(gradient) => return Ok(gradient),
                None => "it is not a leaf, or the result does not depend on it",
            },
        };
        Err(Error::new(ErrorKind::NoGradient, "no gradient arrived at this variable")
            .at(format!("{leaf:?}"))
            .found(reason))
    }
}

impl Var {
    /// Gradients of this number with respect to every leaf behind it.
    ///
    /// # Errors
    /// [`ErrorKind::NoGradient`] when no leaf is behind it; the tape's fault; what [`crate::Op::vjp`] returns; in anomaly
    /// mode, the first non-finite cotangent.
    ///
    /// # Panics
    /// When it is not a single number.
    #[track_caller]
    pub fn backward(&self) -> Result<Gradients> {
        assert_eq!(
            self.len(),
            1,
            "backward starts at a single number, not at {:?}; reduce it with sum_all",
            self.spec()
        );
        let seed = Tensor::full(1.0, self.shape(), self.dtype()).to_device(&self.device())?;
        let cotangents = self.pull_back(self.tape().constant(seed), false)?;
        let by_node = cotangents.into_iter().map(|g| g.map(|g| g.tensor().clone())).collect();
        Ok(Gradients { tape: self.tape().clone(), by_node })
    }

    /// Gradients of this number with respect to some leaves as variables of the same tape, so that they can be
    /// differentiated again.
    ///
    /// # Errors
    /// As [`Var::backward`], and [`ErrorKind::NoGradient`] for a leaf the result does not depend on.
    ///
    /// # Panics
    /// When it is not a single number.
    #[track_caller]
    pub fn gradients_of(&self, leaves: &[&Self]) -> Result<Vec<Self>> {
        assert_eq!(self.len(), 1, "gradients start at a single number, not at {:?}", self.spec());
        let seed = Tensor::full(1.0, self.shape(), self.dtype()).to_device(&self.device())?;
        let mut cotangents = self.pull_back(self.tape().constant(seed), true)?;
        leaves
            .iter()
            .map(|leaf| {
                leaf.node().and_then(|node| cotangents.get_mut(node)?.clone()).ok_or_else(|| {
                    Error::new(ErrorKind::NoGradient, "no gradient arrived at this variable").at(format!("{leaf:?}"))
                })
            })
            .collect()
    }

    /// Carries a cotangent of this variable back to the leaves. With `live`, the derivatives are recorded as well.
    pub(super) fn pull_back(&self, seed: Self, live: bool) -> Result<Vec<Option<Self>>> {
        let tape = self.tape();
        tape.check()?;
        let Some(last) = self.node() else {
            return Err(Error::new(ErrorKind::NoGradient, "backward of a constant: no leaf is behind it")
                .fix("make the inputs whose gradients you want with Tape::leaf"));
        };
        let mut cotangents: Vec<Option<Self>> = vec![None; last + 1];
        cotangents[last] = Some(seed);
        for node in (0..=last).rev() {
            if !tape.is_op(node) {
                continue;
            }
            let Some(gradient) = cotangents[node].take() else { continue };
            for (input, cotangent) in tape.vjp_of(node, &gradient, live)? {
                cotangents[input] = Some(match cotangents[input].take() {
                    None => cotangent,
                    Some(sum) => &sum + &cotangent,
                });
            }
        }
        tape.check()?;
        Ok(cotangents)
    }
}

impl Tape {
    fn is_op(&self, node: usize) -> bool {
        self.0.borrow().nodes[node].op.is_some()
    }

    /// The cotangents of one node's recorded operands.
    fn vjp_of(&self, node: usize, gradient: &Var, live: bool) -> Result<Vec<(usize, Var)>> {
        let (op, operands, output, residual, place, anomaly) = {
            let record = self.0.borrow();
            let entry = &record.nodes[node];
            let Applied { op, inputs, residual } = entry.op.as_ref().expect("only ops are pulled back");
            (op.clone(), inputs.clone(), entry.value.clone(), residual.clone(), entry.place, record.anomaly)
        };
        let var = |node: Option<usize>, value: Tensor| Var::new(self.clone(), node.filter(|_| live), value);
        let inputs: Vec<_> = operands.iter().map(|(node, value)| var(*node, value.clone())).collect();
        let wanted: Vec<_> = operands.iter().map(|(node, _)| node.is_some()).collect();
        let output = var(Some(node), output);
        let cx =
            Backward { gradient, inputs: &inputs, wanted: &wanted, output: &output, residual: residual.as_ref(), live };
        // a fault inside the derivative is reported for the op whose derivative it is, at the line that applied the op
        self.0.borrow_mut().anomaly = false;
        let cotangents = op.vjp(&cx);
        self.0.borrow_mut().anomaly = anomaly;
        let cotangents = cotangents?;
        assert_eq!(cotangents.len(), inputs.len(), "{}: vjp must speak of every operand", op.name());
        let mut arrived = Vec::with_capacity(inputs.len());
        for (index, cotangent) in cotangents.into_iter().enumerate() {
            let (Some(target), Some(cotangent)) = (operands[index].0, cotangent) else { continue };
            assert_eq!(
                cotangent.spec(),
                inputs[index].spec(),
                "{}: the cotangent of operand {index} has another shape than the operand",
                op.name()
            );
            if anomaly {
                anomaly::check_cotangent(&*op, index, gradient.tensor(), cotangent.tensor(), place)?;
            }
            arrived.push((target, cotangent));
        }
        Ok(arrived)
    }
}
