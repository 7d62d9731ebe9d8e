//! From nodes to register code: products fused into sums, values assigned to reusable slots.
//!
//! Slots are numbered inputs first, then constants, then outputs, then temporaries. An output has its slot to itself,
//! so that the evaluator can point that slot straight at the caller's memory.

use std::collections::HashMap;

use super::graph::{Id, Node};
use super::instruction::{Binary, Unary};

/// What one step of the code does with its operand slots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Op {
    Unary(Unary),
    Binary(Binary),
    Select,
    /// `a · b + c`
    MulAdd,
    /// `a · b − c`
    MulSub,
    /// `c − a · b`
    NegMulAdd,
    /// The first of `a`, `b` and `e`, the second of `c`, `d` and that.
    Chain(Term, Term),
    Copy,
    /// The n-th decomposition of [`Code::svds`]; it has no operands and no destination of its own.
    Svd(u32),
}

/// A product, or a product and a sum, of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Term {
    /// `a · b`; only the first one.
    Mul,
    /// `a · b + c`
    MulAdd,
    /// `a · b − c`
    MulSub,
    /// `c − a · b`
    NegMulAdd,
}

/// One instruction over a block of lanes: `dst = op(a, b, …)`, slots of operands that `op` lacks being 0.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    pub op: Op,
    pub dst: u32,
    pub a: u32,
    pub b: u32,
    pub c: u32,
    pub d: u32,
    pub e: u32,
}

/// The slots of a singular value decomposition.
#[derive(Debug, Clone, Copy)]
pub struct SvdSlots {
    /// The matrix, row by row.
    pub inputs: [u32; 9],
    /// `U`, singular values, `V`; [`UNUSED`] where nobody reads.
    pub outputs: [u32; 21],
}

/// Stands for the slot of a result that nobody reads.
pub const UNUSED: u32 = u32::MAX;

/// Register code of a program.
#[derive(Debug)]
pub struct Code {
    pub steps: Vec<Step>,
    pub svds: Vec<SvdSlots>,
    /// The values of the constant slots.
    pub constants: Vec<f64>,
    pub inputs: usize,
    pub outputs: usize,
    /// How many temporaries are alive at once, at most.
    pub temporaries: usize,
}

impl Code {
    /// Lowers a graph whose nodes are in topological order.
    pub(crate) fn lower(nodes: &[Node], results: &[Id], inputs: usize) -> Self {
        let (mut steps, mut svds) = fuse(nodes, results);
        chain(&mut steps, &svds, results);
        let mut constants = Vec::new();
        let mut slot: HashMap<Id, u32> = HashMap::new();
        for (id, node) in nodes.iter().enumerate() {
            match *node {
                Node::Input(n) => _ = slot.insert(id as Id, n),
                Node::Const(bits) => {
                    slot.insert(id as Id, (inputs + constants.len()) as u32);
                    constants.push(f64::from_bits(bits));
                }
                _ => {}
            }
        }
        let first_output = (inputs + constants.len()) as u32;
        let mut copies = Vec::new();
        for (&id, output) in results.iter().zip(first_output..) {
            if *slot.entry(id).or_insert(output) != output {
                copies.push((id, output));
            }
        }
        let first_temporary = first_output + results.len() as u32;
        let temporaries = assign_temporaries(&mut steps, &mut svds, &mut slot, first_temporary);
        steps.extend(copies.into_iter().map(|(id, dst)| Step { a: slot[&id], ..Step::new(Op::Copy, dst) }));
        Self { steps, svds, constants, inputs, outputs: results.len(), temporaries }
    }

    /// The number of the first temporary slot.
    pub fn first_temporary(&self) -> usize {
        self.inputs + self.constants.len() + self.outputs
    }

    /// Number of slots of all kinds.
    pub fn slots(&self) -> usize {
        self.first_temporary() + self.temporaries
    }
}

impl Op {
    /// Number of operands.
    fn arity(self) -> usize {
        match self {
            Self::Svd(_) => 0,
            Self::Unary(_) | Self::Copy => 1,
            Self::Binary(_) => 2,
            Self::Select | Self::MulAdd | Self::MulSub | Self::NegMulAdd => 3,
            Self::Chain(Term::Mul, _) => 4,
            Self::Chain(..) => 5,
        }
    }

    /// What it is in a chain, if it can be in one.
    fn term(self) -> Option<Term> {
        match self {
            Self::Binary(Binary::Mul) => Some(Term::Mul),
            Self::MulAdd => Some(Term::MulAdd),
            Self::MulSub => Some(Term::MulSub),
            Self::NegMulAdd => Some(Term::NegMulAdd),
            _ => None,
        }
    }
}

impl Step {
    /// A step without operands.
    fn new(op: Op, dst: u32) -> Self {
        Self { op, dst, a: 0, b: 0, c: 0, d: 0, e: 0 }
    }

    /// The slots it reads.
    fn operands<'a>(&'a mut self, svds: &'a mut [SvdSlots]) -> impl Iterator<Item = &'a mut u32> {
        let arity = self.op.arity();
        let entries: &mut [u32] = match self.op {
            Op::Svd(n) => &mut svds[n as usize].inputs,
            _ => &mut [],
        };
        [&mut self.a, &mut self.b, &mut self.c, &mut self.d, &mut self.e].into_iter().take(arity).chain(entries)
    }
}

/// Steps over node ids, with each product that has one use, in a sum or difference, merged into it.
fn fuse(nodes: &[Node], results: &[Id]) -> (Vec<Step>, Vec<SvdSlots>) {
    let mut uses = vec![0_u32; nodes.len()];
    results.iter().for_each(|&id| uses[id as usize] += 2);
    for operand in nodes.iter().flat_map(|node| node.operands()) {
        uses[operand as usize] += 1;
    }
    let product = |id: Id| match nodes[id as usize] {
        Node::Binary(Binary::Mul, a, b) if uses[id as usize] == 1 => Some((a, b)),
        _ => None,
    };
    let mut merged = vec![false; nodes.len()];
    let mut steps = Vec::new();
    let mut svds = Vec::new();
    for (id, &node) in nodes.iter().enumerate() {
        let (op, [a, b, c]) = match node {
            Node::Input(_) | Node::Const(_) | Node::Part(..) => continue,
            Node::Compose(..) => unreachable!("composed matrices have been written out"),
            Node::Svd(inputs) => {
                let mut outputs = [UNUSED; 21];
                for (at, node) in nodes.iter().enumerate() {
                    if let Node::Part(of, n) = *node
                        && of as usize == id
                    {
                        outputs[usize::from(n)] = at as Id;
                    }
                }
                svds.push(SvdSlots { inputs, outputs });
                (Op::Svd(svds.len() as u32 - 1), [0; 3])
            }
            Node::Unary(op, a) => (Op::Unary(op), [a, 0, 0]),
            Node::Select(c, a, b) => (Op::Select, [c, a, b]),
            Node::Binary(op, x, y) => match (op, product(x), product(y)) {
                (Binary::Add, Some((a, b)), _) => {
                    merged[x as usize] = true;
                    (Op::MulAdd, [a, b, y])
                }
                (Binary::Add, _, Some((a, b))) => {
                    merged[y as usize] = true;
                    (Op::MulAdd, [a, b, x])
                }
                (Binary::Sub, Some((a, b)), _) => {
                    merged[x as usize] = true;
                    (Op::MulSub, [a, b, y])
                }
                (Binary::Sub, _, Some((a, b))) => {
                    merged[y as usize] = true;
                    (Op::NegMulAdd, [a, b, x])
                }
                _ => (Op::Binary(op), [x, y, 0]),
            },
        };
        steps.push(Step { a, b, c, ..Step::new(op, id as u32) });
    }
    steps.retain(|step| !merged[step.dst as usize]);
    (steps, svds)
}

/// Merges a product, or a product and a sum, into the sum that is the only one to read it: its value never leaves the
/// registers.
fn chain(steps: &mut Vec<Step>, svds: &[SvdSlots], results: &[Id]) {
    let mut reads: HashMap<Id, usize> = HashMap::new();
    let mut made: HashMap<Id, usize> = HashMap::new();
    let mut svds = svds.to_vec();
    for (at, step) in steps.iter_mut().enumerate() {
        made.insert(step.dst, at);
        step.operands(&mut svds).for_each(|id| *reads.entry(*id).or_default() += 1);
    }
    results.iter().for_each(|id| *reads.entry(*id).or_default() += 2);
    let mut merged = vec![false; steps.len()];
    for at in 0..steps.len() {
        let outer = steps[at];
        let Some(last) = outer.op.term().filter(|term| *term != Term::Mul) else { continue };
        let Some(&before) = made.get(&outer.c).filter(|_| reads[&outer.c] == 1) else { continue };
        let inner = steps[before];
        let Some(first) = inner.op.term() else { continue };
        steps[at] = Step {
            a: inner.a,
            b: inner.b,
            c: outer.a,
            d: outer.b,
            e: inner.c,
            ..Step::new(Op::Chain(first, last), outer.dst)
        };
        merged[before] = true;
    }
    let mut merged = merged.into_iter();
    steps.retain(|_| !merged.next().expect("one for each step"));
}

/// Rewrites node ids to slots. A slot is free again from the step that reads its value last: that step may write its
/// result over it.
fn assign_temporaries(steps: &mut [Step], svds: &mut [SvdSlots], slot: &mut HashMap<Id, u32>, first: u32) -> usize {
    let mut last_read: HashMap<Id, usize> = HashMap::new();
    for (at, step) in steps.iter_mut().enumerate() {
        step.operands(svds).for_each(|id| _ = last_read.insert(*id, at));
    }
    let mut free = Vec::new();
    let mut count = 0;
    for (at, step) in steps.iter_mut().enumerate() {
        let mut released = Vec::new();
        for operand in step.operands(svds) {
            let assigned = slot[operand];
            if last_read[operand] == at && assigned >= first && !released.contains(&assigned) {
                released.push(assigned);
            }
            *operand = assigned;
        }
        free.append(&mut released);
        let mut assign = |id: &mut Id| {
            *id = *slot.entry(*id).or_insert_with(|| {
                free.pop().unwrap_or_else(|| {
                    count += 1;
                    first + count - 1
                })
            });
        };
        match step.op {
            Op::Svd(n) => svds[n as usize].outputs.iter_mut().filter(|id| **id != UNUSED).for_each(assign),
            _ => assign(&mut step.dst),
        }
    }
    count as usize
}
