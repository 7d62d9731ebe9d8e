//! The backward pass: one loop over the tape from the result to the leaves.

use std::cell::RefCell;
use std::panic::Location;
use std::rc::Rc;
use std::time::Instant;

use rayon::prelude::*;
use smallvec::SmallVec;

use crate::backend::cpu::CHUNK;
use crate::scalar::Real;
use crate::tape::{Applied, Backward, Kind, Op, Record, Tape, Var, anomaly};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Tensor};

/// Cotangents with the nodes at which they arrive.
type Arrived = SmallVec<[(usize, Var); 2]>;

/// The gradients of a scalar with respect to the leaves of a tape. Does not keep the tape.
///
/// ```
/// # use gradreel::{Tape, Tensor};
/// # let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
/// let gradients = x.square().backward()?;
/// assert_eq!(gradients.wrt(&x)?.item()?, 6.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Gradients {
    tape: u64,
    /// In the order of the leaves' places on the tape.
    by_leaf: Vec<(usize, Tensor)>,
}

impl Gradients {
    /// The gradient with respect to a leaf.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!((&x * 2.0).backward()?.wrt(&x)?.item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::NoGradient`] when the variable is a constant, lives on another tape, is not a leaf, or the result does
    /// not depend on it.
    pub fn wrt(&self, leaf: &Var) -> Result<&Tensor> {
        let reason = match leaf.node() {
            None => "it is a constant; make it with Tape::leaf",
            Some(_) if self.tape != leaf.tape().id() => "it lives on another tape",
            Some(node) => match self.by_leaf.binary_search_by_key(&node, |(leaf, _)| *leaf) {
                Ok(at) => return Ok(&self.by_leaf[at].1),
                Err(_) => "it is not a leaf, or the result does not depend on it",
            },
        };
        Err(Error::new(ErrorKind::NoGradient, "no gradient arrived at this variable")
            .at(format!("{leaf:?}"))
            .found(reason))
    }
}

thread_local! {
    /// The op whose derivative this thread is taking.
    static DERIVING: RefCell<Option<Rc<dyn Op>>> = const { RefCell::new(None) };
}

/// Puts back which op's derivative was being taken before.
struct Deriving(Option<Rc<dyn Op>>);

impl Deriving {
    fn during<R>(op: &Rc<dyn Op>, run: impl FnOnce() -> R) -> R {
        let _before = Self(DERIVING.replace(Some(op.clone())));
        run()
    }
}

impl Drop for Deriving {
    fn drop(&mut self) {
        DERIVING.set(self.0.take());
    }
}

/// The name of the op whose derivative this thread is taking.
pub(crate) fn deriving() -> Option<String> {
    DERIVING.with_borrow(|op| Some(op.as_ref()?.name().to_owned()))
}

/// What becomes of the tape while derivatives are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    /// It stays as it is.
    Keep,
    /// The derivatives are recorded on it.
    Record,
    /// Each node is freed as soon as its derivative was taken, and all others as well.
    Spend,
}

impl Var {
    /// Gradients of this number with respect to every leaf behind it.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// let gradients = x.square().sum_all().backward()?;
    /// assert_eq!(gradients.wrt(&x)?.slice::<f64>(), [2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::NoGradient`] when no leaf is behind it; the tape's fault; what [`crate::Op::vjp`] returns; in anomaly
    /// mode, the first non-finite cotangent.
    ///
    /// # Panics
    /// When it is not a single number.
    #[track_caller]
    pub fn backward(&self) -> Result<Gradients> {
        self.gradients(Pass::Keep)
    }

    /// As [`Var::backward`], but uses the tape up: what a node keeps is freed as soon as its derivative was taken, so that
    /// memory shrinks on the way back. Afterwards the tape holds its leaves only; a later backward pass through what was
    /// recorded before is an error.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 2.0, 3.0], [3]));
    /// let loss = x.square().sum_all();
    /// let gradients = loss.clone().into_gradients()?;
    /// assert_eq!(gradients.wrt(&x)?.slice::<f64>(), &[2.0, 4.0, 6.0]);
    /// assert_eq!(tape.memory().held, 0);
    /// assert!(loss.backward().is_err());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Var::backward`].
    ///
    /// # Panics
    /// When it is not a single number.
    #[track_caller]
    pub fn into_gradients(self) -> Result<Gradients> {
        self.gradients(Pass::Spend)
    }

    #[track_caller]
    fn gradients(&self, pass: Pass) -> Result<Gradients> {
        assert_eq!(
            self.len(),
            1,
            "backward starts at a single number, not at {:?}; reduce it with sum_all",
            self.spec()
        );
        let seed = Tensor::full(1.0, self.shape(), self.dtype().of_cotangent()).to_device(&self.device())?;
        let cotangents = self.pull_back(self.tape().constant(seed), pass)?;
        let arrived = cotangents.into_iter().enumerate();
        let by_leaf = arrived.filter_map(|(node, gradient)| Some((node, gradient?.tensor().clone()))).collect();
        Ok(Gradients { tape: self.tape().id(), by_leaf })
    }

    /// Gradients of this number with respect to some leaves as variables of the same tape, so that they can be
    /// differentiated again.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// let cube = &x.square() * &x;
    /// let slope = cube.gradients_of(&[&x])?.remove(0); // 3 x²
    /// assert_eq!(slope.backward()?.wrt(&x)?.item()?, 18.0); // 6 x
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Var::backward`], and [`ErrorKind::NoGradient`] for a leaf the result does not depend on.
    ///
    /// # Panics
    /// When it is not a single number.
    #[track_caller]
    pub fn gradients_of(&self, leaves: &[&Self]) -> Result<Vec<Self>> {
        assert_eq!(self.len(), 1, "gradients start at a single number, not at {:?}", self.spec());
        let seed = Tensor::full(1.0, self.shape(), self.dtype().of_cotangent()).to_device(&self.device())?;
        let mut cotangents = self.pull_back(self.tape().constant(seed), Pass::Record)?;
        leaves
            .iter()
            .map(|leaf| {
                leaf.node().and_then(|node| cotangents.get_mut(node)?.clone()).ok_or_else(|| {
                    Error::new(ErrorKind::NoGradient, "no gradient arrived at this variable").at(format!("{leaf:?}"))
                })
            })
            .collect()
    }

    /// Carries a cotangent of this variable back to the leaves: what arrives, by node.
    pub(super) fn pull_back(&self, seed: Self, pass: Pass) -> Result<Vec<Option<Self>>> {
        let tape = self.tape();
        tape.check()?;
        let Some(last) = self.node() else {
            return Err(Error::new(ErrorKind::NoGradient, "backward of a constant: no leaf is behind it")
                .fix("make the inputs whose gradients you want with Tape::leaf"));
        };
        if pass == Pass::Spend {
            // nothing after this variable leads to it
            tape.spend(last + 1..tape.len());
        }
        let mut cotangents: Vec<Option<Self>> = vec![None; last + 1];
        tape.hold(seed.tensor());
        cotangents[last] = Some(seed);
        let done = tape.walk(&mut cotangents, pass);
        cotangents.iter().flatten().for_each(|waiting| tape.release(waiting.tensor()));
        done.and_then(|()| tape.check())?;
        Ok(cotangents)
    }
}

impl Tape {
    pub(super) fn id(&self) -> u64 {
        self.0.borrow().id
    }

    /// Takes the derivatives of the ops at which a cotangent waits, from the last to the first.
    fn walk(&self, cotangents: &mut [Option<Var>], pass: Pass) -> Result<()> {
        for node in (0..cotangents.len()).rev() {
            if matches!(self.0.borrow().nodes[node].kind, Kind::Leaf) {
                continue;
            }
            let Some(gradient) = cotangents[node].take() else {
                if pass == Pass::Spend {
                    self.spend(node..node + 1);
                }
                continue;
            };
            let arrived = self.vjp_of(node, &gradient, pass);
            self.release(gradient.tensor());
            drop(gradient);
            for (input, cotangent) in arrived? {
                let sum = match cotangents[input].take() {
                    None => cotangent,
                    Some(before) => {
                        self.release(before.tensor());
                        if pass == Pass::Record { &before + &cotangent } else { before.added(cotangent) }
                    }
                };
                self.hold(sum.tensor());
                cotangents[input] = Some(sum);
            }
        }
        Ok(())
    }

    /// The cotangents of one node's recorded operands.
    fn vjp_of(&self, node: usize, gradient: &Var, pass: Pass) -> Result<Arrived> {
        let mut record = self.0.borrow_mut();
        let (place, anomaly) = (record.nodes[node].place, record.anomaly);
        let kind = &mut record.nodes[node].kind;
        let applied = match (pass, &*kind) {
            (Pass::Spend, Kind::Op(_)) => std::mem::replace(kind, Kind::Spent),
            (_, Kind::Op(applied)) => Kind::Op(applied.clone()),
            _ => Kind::Spent,
        };
        let Kind::Op(applied) = applied else {
            return Err(Error::new(ErrorKind::NoGradient, "this tape was used up by Var::into_gradients")
                .at(place)
                .fix("take the other gradients before it, with Var::backward"));
        };
        // a fault inside the derivative is reported for the op whose derivative it is, at the line that applied the op
        record.anomaly = false;
        drop(record);
        let arrived = self.derivative(&applied, node, gradient, pass, anomaly.then_some(place));
        let mut record = self.0.borrow_mut();
        record.anomaly = anomaly;
        if pass == Pass::Spend {
            record.let_go(&applied);
        }
        drop(record);
        arrived
    }

    /// Calls the op's derivative and sorts what it returns; with a place, looks for what is not finite.
    fn derivative(
        &self,
        applied: &Applied,
        node: usize,
        gradient: &Var,
        pass: Pass,
        checked: Option<&Location<'_>>,
    ) -> Result<Arrived> {
        let live = pass == Pass::Record;
        let var = |node: Option<usize>, value: &Tensor| Var::new(self.clone(), node.filter(|_| live), value.clone());
        let Applied { op, inputs, residual, .. } = applied;
        let (mut operands, mut wanted) = (SmallVec::<[Var; 4]>::new(), SmallVec::<[bool; 8]>::new());
        for (node, value) in inputs {
            operands.push(var(*node, value));
            wanted.push(node.is_some());
        }
        let output = var(Some(node), &applied.output);
        let cx = Backward {
            gradient,
            inputs: &operands,
            wanted: &wanted,
            output: &output,
            residual: residual.as_ref(),
            live,
            anomaly: checked.is_some(),
        };
        let begin = self.0.borrow().profile.as_ref().map(|profile| (Instant::now(), profile.total()));
        let cotangents = Deriving::during(op, || op.vjp(&cx))?;
        if let (Some((begin, before)), Some(profile)) = (begin, &mut self.0.borrow_mut().profile) {
            let alone = begin.elapsed().saturating_sub(profile.total() - before);
            profile.add(format!("d {}", op.name()), inputs.iter().map(|(_, x)| x), alone);
        }
        assert_eq!(cotangents.len(), inputs.len(), "{}: vjp must speak of every operand", op.name());
        let mut arrived = Arrived::new();
        for (index, cotangent) in cotangents.into_iter().enumerate() {
            let (Some(target), Some(cotangent)) = (inputs[index].0, cotangent) else { continue };
            assert!(
                cotangent.shape() == inputs[index].1.shape()
                    && cotangent.dtype() == inputs[index].1.dtype().of_cotangent(),
                "{}: the cotangent {cotangent:?} does not fit operand {index}, {:?}",
                op.name(),
                inputs[index].1
            );
            if let Some(place) = checked {
                anomaly::check_cotangent(&**op, index, gradient.tensor(), cotangent.tensor(), place)?;
            }
            arrived.push((target, cotangent));
        }
        Ok(arrived)
    }

    /// Frees what these nodes keep.
    fn spend(&self, nodes: std::ops::Range<usize>) {
        for node in nodes {
            let mut record = self.0.borrow_mut();
            let kind = &mut record.nodes[node].kind;
            if matches!(kind, Kind::Leaf) {
                continue;
            }
            let Kind::Op(applied) = std::mem::replace(kind, Kind::Spent) else { continue };
            record.let_go(&applied);
            // whatever the op and its residual do when they go, they may ask the tape
            drop(record);
            drop(applied);
        }
    }

    fn hold(&self, cotangent: &Tensor) {
        self.0.borrow_mut().ledger.hold(cotangent);
    }

    fn release(&self, cotangent: &Tensor) {
        self.0.borrow_mut().ledger.release(cotangent);
    }
}

impl Record {
    /// Takes what an op keeps out of the account.
    fn let_go(&mut self, applied: &Applied) {
        applied.tensors().for_each(|tensor| self.ledger.release(tensor));
        self.ledger.subtract(applied.residual_bytes);
    }
}

impl Var {
    /// The sum of two cotangents that nobody differentiates again: in place where nobody else has one of them.
    fn added(mut self, mut other: Self) -> Self {
        if self.device() != Device::Cpu || !self.dtype().is_real() {
            return &self + &other;
        }
        if !self.tensor_mut().is_unshared() {
            std::mem::swap(&mut self, &mut other);
        }
        if !self.tensor_mut().is_unshared() {
            return &self + &other;
        }
        for_real!(self.dtype(), T => {
            let terms = other.tensor().slice::<T>();
            let sums = self.tensor_mut().slice_mut::<T>();
            if terms.len() <= CHUNK {
                add::<T>(sums, terms);
            } else {
                sums.par_chunks_mut(CHUNK).zip(terms.par_chunks(CHUNK)).for_each(|(sums, terms)| add::<T>(sums, terms));
            }
        });
        self
    }
}

fn add<T: Real>(sums: &mut [T], terms: &[T]) {
    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += *term);
}
