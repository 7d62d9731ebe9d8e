//! Reverse-mode automatic differentiation on a tape one can see.
//!
//! A [`Tape`] is made for one evaluation and dropped afterwards; there is no global mode. [`Tape::leaf`] marks a tensor whose
//! gradient is wanted, [`Tape::constant`] one whose gradient is not. Applying an [`Op`] to [`Var`]s computes its value at
//! once and, if a leaf is behind an operand, appends one node to a flat list. [`Var::backward`] walks that list from the
//! end in a loop, so that a tape of a hundred thousand nodes needs no more stack than one of ten.
//!
//! Derivatives are written in ops ([`Op::vjp`] returns `Var`s): one rule serves both backends, and
//! [`Var::gradients_of`] records them again for gradients of gradients.
//!
//! A tape keeps no more than derivatives will read ([`Op::reads`]); [`Var::into_gradients`] frees even that, node by
//! node, as soon as it was read. [`Tape::memory`] says how much it holds, and held at most.
//!
//! ```
//! use gradreel::{Tape, Tensor};
//!
//! let tape = Tape::new();
//! let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 2.0, 3.0], [3]));
//! let loss = x.square().sum_all();
//! let gradients = loss.backward()?;
//! assert_eq!(gradients.wrt(&x)?.slice::<f64>(), &[2.0, 4.0, 6.0]);
//! # Ok::<(), gradreel::Error>(())
//! ```

mod anomaly;
mod backward;
pub mod devicecheck;
pub mod gradcheck;
mod memory;
mod op;
mod operands;
mod profile;
mod remat;
mod transfer;
mod var;

use std::cell::RefCell;
use std::panic::Location;
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub use backward::Gradients;
pub(crate) use backward::deriving;
pub(crate) use memory::AddressMap;
use memory::Ledger;
pub use memory::Memory;
pub use op::{Backward, Forward, Op, Reads};
pub use operands::Operands;
pub use profile::{Profile, ProfileRow};
use smallvec::SmallVec;
pub use var::Var;

use crate::tensor::Role;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

/// A record of the ops applied to some leaves; cloning it gives another handle to the same record.
///
/// ```
/// # use gradreel::{Tape, Tensor};
/// # let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
/// let y = x.square();
/// assert_eq!(y.backward()?.wrt(&x)?.item()?, 6.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Clone)]
pub struct Tape(Rc<RefCell<Record>>);

/// What a tape remembers.
struct Record {
    /// Tells tapes apart after they are gone.
    id: u64,
    nodes: Vec<Node>,
    ledger: Ledger,
    anomaly: bool,
    /// Whether the segment of a remat runs on it.
    segment: bool,
    /// The time of ops, where it is wanted.
    profile: Option<Profile>,
    /// The first fault met by a method that cannot return it; every result is withheld after that.
    fault: Option<Error>,
}

/// One applied op, or a leaf.
struct Node {
    kind: Kind,
    place: &'static Location<'static>,
}

enum Kind {
    Leaf,
    Op(Applied),
    /// An op whose derivative was taken by a backward pass that used up the tape.
    Spent,
}

/// The op of a node with what its derivative will read; the rest is hollow.
#[derive(Clone)]
struct Applied {
    op: Rc<dyn Op>,
    inputs: SmallVec<[(Option<usize>, Tensor); 2]>,
    output: Tensor,
    residual: Option<Rc<dyn std::any::Any>>,
    residual_bytes: usize,
}

impl Default for Tape {
    fn default() -> Self {
        Self::new()
    }
}

impl Tape {
    /// An empty tape.
    ///
    /// ```
    /// # use gradreel::Tape;
    /// assert!(Tape::new().is_empty());
    /// ```
    pub fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        let ledger = Ledger::default();
        let record =
            Record { id, nodes: Vec::new(), ledger, anomaly: false, segment: false, profile: None, fault: None };
        Self(Rc::new(RefCell::new(record)))
    }

    /// An empty tape that checks every value and gradient and names the first op that made one non-finite, with the
    /// caller's line, shapes and ranges. Costs one pass over each result.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    /// let tape = Tape::with_anomaly_mode();
    /// let x = tape.leaf(Tensor::from_vec(vec![-1.0], [1]));
    /// let error = x.ln().value().unwrap_err();
    /// assert!(error.to_string().contains("ln"));
    /// ```
    pub fn with_anomaly_mode() -> Self {
        let tape = Self::new();
        tape.0.borrow_mut().anomaly = true;
        tape
    }

    /// An empty tape for the segment of a remat.
    fn for_segment(anomaly: bool) -> Self {
        let tape = Self::new();
        {
            let mut record = tape.0.borrow_mut();
            (record.anomaly, record.segment) = (anomaly, true);
        }
        tape
    }

    /// A variable whose gradient is wanted.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert!(x.is_differentiable());
    /// ```
    #[track_caller]
    pub fn leaf(&self, value: Tensor) -> Var {
        let node = self.push(Node { kind: Kind::Leaf, place: Location::caller() });
        Var::new(self.clone(), Some(node), value)
    }

    /// A variable without gradient.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.constant(Tensor::from_vec(vec![3.0], [1]));
    /// assert!(!x.is_differentiable());
    /// ```
    pub fn constant(&self, value: Tensor) -> Var {
        Var::new(self.clone(), None, value)
    }

    /// Number of recorded nodes, leaves included.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// let _y = x.square();
    /// assert_eq!(tape.len(), 2);
    /// ```
    pub fn len(&self) -> usize {
        self.0.borrow().nodes.len()
    }

    /// Whether nothing was recorded.
    ///
    /// ```
    /// # use gradreel::Tape;
    /// assert!(Tape::new().is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes that this tape holds for its backward pass, now and at most so far.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([1000], DType::F32));
    /// let sum = &(&x + &x) + &x; // linear: no derivative reads a value
    /// assert_eq!(tape.memory().held, 0);
    /// let loss = sum.square().sum_all(); // 2 · sum
    /// assert_eq!(tape.memory().held, 4000);
    /// loss.into_gradients()?;
    /// assert_eq!(tape.memory().held, 0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn memory(&self) -> Memory {
        self.0.borrow().ledger.memory()
    }

    /// The first fault met by a method that could not return it (a device lost under `a + b`, a non-finite value in
    /// anomaly mode).
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// let _y = x.sqrt();
    /// tape.check()?;
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// That fault. [`Var::value`] and [`Var::backward`] return it, too.
    pub fn check(&self) -> Result<()> {
        self.0.borrow().fault.clone().map_or(Ok(()), Err)
    }

    /// Applies an op; records it if the gradient of an operand is wanted.
    ///
    /// Where no gradient is wanted, nothing is recorded, and operands may live on any tapes.
    ///
    /// ```
    /// use std::rc::Rc;
    /// use gradreel::{Tape, Tensor, ops::Map, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(tape.apply(Rc::new(square), &[&x])?.item()?, 9.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// What [`Op::infer`] and [`Op::forward`] return; in anomaly mode, a non-finite result.
    /// [`ErrorKind::NoGradient`] when an op that has to be recorded has an operand of another
    /// tape; the fault of that tape, if it has one.
    #[track_caller]
    pub fn apply(&self, op: Rc<dyn Op>, inputs: &[&Var]) -> Result<Var> {
        let place = Location::caller();
        self.check_tapes(&*op, inputs).map_err(|e| e.at(format!("{} (called at {place})", op.name())))?;
        let mut specs = SmallVec::<[Spec; 3]>::new();
        inputs.iter().for_each(|x| specs.push(x.spec()));
        let expected = operands::infer(&*op, &specs).map_err(|e| e.at(format!("{} (called at {place})", op.name())))?;
        self.compute(op, inputs, &expected, place)
    }

    /// Applies an op on behalf of a method that returns a plain `Var`.
    ///
    /// # Panics
    /// For a wrong shape or an operand of another tape, at the caller's line. Any other fault is kept by the tape (see [`Tape::check`]).
    #[track_caller]
    pub(crate) fn apply_or_keep_fault(&self, op: Rc<dyn Op>, inputs: &[&Var]) -> Var {
        let place = Location::caller();
        let mut specs = SmallVec::<[Spec; 3]>::new();
        inputs.iter().for_each(|x| specs.push(x.spec()));
        let expected = match self.check_tapes(&*op, inputs).and_then(|()| operands::infer(&*op, &specs)) {
            Ok(expected) => expected,
            Err(error) => panic!("{}", error.at(op.name())),
        };
        self.compute(op, inputs, &expected, place).unwrap_or_else(|fault| {
            self.keep_fault(fault);
            self.constant(Tensor::zeros(expected.shape, expected.dtype))
        })
    }

    /// Computes an op whose shapes fit, and records it if a gradient is wanted.
    fn compute(
        &self,
        op: Rc<dyn Op>,
        inputs: &[&Var],
        expected: &Spec,
        place: &'static Location<'static>,
    ) -> Result<Var> {
        let mut values = SmallVec::<[Tensor; 3]>::new();
        inputs.iter().for_each(|x| values.push(x.tensor().clone()));
        // what a tape kept a fault about is not known
        inputs.iter().filter(|x| !self.same(x.tape())).try_for_each(|x| x.tape().check())?;
        let begin = self.0.borrow().profile.is_some().then(Instant::now);
        let Forward { output, residual, residual_bytes } = op.forward_accepted(Operands::accepted(&values))?;
        if let (Some(begin), Some(profile)) = (begin, &mut self.0.borrow_mut().profile) {
            profile.add(op.name().to_owned(), values.iter(), begin.elapsed());
        }
        assert!(
            *output.shape() == expected.shape && output.dtype() == expected.dtype,
            "{}: the result {output:?} is not what its shape rule promised, {expected:?}",
            op.name()
        );
        if self.0.borrow().anomaly {
            anomaly::check_value(&*op, &values, &output, place)?;
        }
        if inputs.iter().all(|x| !x.is_differentiable()) {
            return Ok(self.constant(output));
        }
        let mut wanted = SmallVec::<[bool; 8]>::new();
        inputs.iter().for_each(|x| wanted.push(x.is_differentiable()));
        let reads = op.reads(&wanted);
        let only = |tensor: Tensor, read: bool, role| if read { tensor } else { tensor.hollow(role) };
        let output_kept = only(output.clone(), reads.reads_output(), Role::Result);
        let mut applied = Applied { op, inputs: SmallVec::new(), output: output_kept, residual, residual_bytes };
        for (i, value) in values.into_iter().enumerate() {
            applied.inputs.push((inputs[i].node(), only(value, reads.reads_input(i), Role::Operand(i))));
        }
        let node = self.push(Node { kind: Kind::Op(applied), place });
        Ok(Var::new(self.clone(), Some(node), output))
    }

    /// Refuses operands of other tapes where the op has to be recorded. The segment of a remat may use constants of others:
    /// it is run on several tapes.
    fn check_tapes(&self, op: &dyn Op, inputs: &[&Var]) -> Result<()> {
        if inputs.iter().all(|x| self.same(x.tape())) {
            return Ok(());
        }
        let (recorded, segment) = (inputs.iter().any(|x| x.is_differentiable()), self.0.borrow().segment);
        for (number, x) in inputs.iter().enumerate().filter(|(_, x)| !self.same(x.tape())) {
            let (what, fix) = match x.is_differentiable() {
                true => ("is differentiable on", "detach it, or hand it to the segment of a remat as an operand"),
                false if !recorded || segment => continue,
                false => (
                    "is a constant of",
                    "make it a constant of the tape that records, with tape.constant(x.value()?.clone())",
                ),
            };
            return Err(Error::new(
                ErrorKind::NoGradient,
                format!("{}: operand {number} {what} another tape", op.name()),
            )
            .found(format!("{x:?}"))
            .fix(fix));
        }
        Ok(())
    }

    /// Keeps the first fault; every result is withheld from then on.
    pub(crate) fn keep_fault(&self, fault: Error) {
        self.0.borrow_mut().fault.get_or_insert(fault);
    }

    fn push(&self, node: Node) -> usize {
        let Record { nodes, ledger, .. } = &mut *self.0.borrow_mut();
        if let Kind::Op(applied) = &node.kind {
            applied.tensors().for_each(|tensor| ledger.hold(tensor));
            ledger.add(applied.residual_bytes);
        }
        nodes.push(node);
        nodes.len() - 1
    }

    fn same(&self, other: &Self) -> bool {
        Rc::ptr_eq(&self.0, &other.0)
    }
}

impl Applied {
    /// The tensors that it holds.
    fn tensors(&self) -> impl Iterator<Item = &Tensor> {
        self.inputs.iter().map(|(_, value)| value).chain([&self.output])
    }
}
