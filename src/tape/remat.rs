//! Rematerialisation: recompute in the backward pass instead of remembering.

use std::cell::RefCell;
use std::fmt;
use std::rc::Rc;

use crate::tape::backward::Pass;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Tape, Var};
use crate::{Result, Spec, Tensor};

type Segment = dyn Fn(&Tape, &[Var]) -> Result<Var>;

impl Tape {
    /// Runs a segment of a model without recording it; the backward pass runs it once more to get its derivative.
    ///
    /// The memory of the segment's inner values is freed at once, for one more forward evaluation. The segment must be a
    /// pure function of its operands: variables that it captures must be constants. Remat changes no number.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.5f64; 3], [3]));
    /// let y = tape.remat(&[&x], |_, inputs| Ok(inputs[0].square().exp()))?;
    /// assert_eq!(tape.len(), 2); // the leaf and one node for the whole segment
    /// assert!(y.sum_all().backward()?.wrt(&x)?.slice::<f64>()[0] > 1.28);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// What the segment returns.
    #[track_caller]
    pub fn remat(&self, inputs: &[&Var], segment: impl Fn(&Self, &[Var]) -> Result<Var> + 'static) -> Result<Var> {
        let segment: Rc<Segment> = Rc::new(segment);
        let inner = Self::for_segment(self.0.borrow().anomaly);
        let values: Vec<_> = inputs.iter().map(|x| inner.constant(x.tensor().clone())).collect();
        let output = segment(&inner, &values)?.value()?.clone();
        if inputs.iter().all(|x| !x.is_differentiable()) {
            return Ok(self.constant(output));
        }
        self.apply(Rc::new(Remat { segment, spec: output.spec(), first: RefCell::new(Some(output)) }), inputs)
    }
}

/// A segment as one op. Its first forward value was computed to learn its shape and is used up by the first application.
struct Remat {
    segment: Rc<Segment>,
    spec: Spec,
    first: RefCell<Option<Tensor>>,
}

impl fmt::Debug for Remat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Remat({:?})", self.spec)
    }
}

impl Op for Remat {
    fn name(&self) -> &'static str {
        "remat"
    }

    fn infer(&self, _inputs: &[Spec]) -> Result<Spec> {
        Ok(self.spec.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        self.forward_accepted(inputs)
    }

    /// The segment may hand its operands to any device.
    fn forward_accepted(&self, inputs: Operands<'_>) -> Result<Forward> {
        if let Some(value) = self.first.borrow_mut().take() {
            return Ok(value.into());
        }
        let inner = Tape::for_segment(false);
        let values: Vec<_> = inputs.iter().map(|x| inner.constant(x.clone())).collect();
        Ok((self.segment)(&inner, &values)?.value()?.clone().into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let outer = cx.gradient().tape();
        let inner = Tape::for_segment(cx.anomaly);
        let leaves: Vec<_> = cx
            .inputs()
            .iter()
            .enumerate()
            .map(|(i, x)| if cx.wants(i) { inner.leaf(x.tensor().clone()) } else { inner.constant(x.tensor().clone()) })
            .collect();
        let output = (self.segment)(&inner, &leaves)?;
        if !output.is_differentiable() {
            return Ok(vec![None; leaves.len()]);
        }
        let seed = inner.constant(cx.gradient().tensor().clone());
        let cotangents = output.pull_back(seed, Pass::Spend)?;
        Ok(leaves
            .iter()
            .map(|leaf| {
                let cotangent = leaf.node().and_then(|node| cotangents.get(node)?.as_ref())?;
                Some(outer.constant(cotangent.tensor().clone()))
            })
            .collect())
    }
}
