//! The graph a program is made of: nodes in topological order, each distinct node stored once (hash-consing).

use std::collections::HashMap;

use super::instruction::{Binary, Unary};

/// Position of a node in its [`Graph`]; operands always come before the nodes that use them.
pub(crate) type Id = u32;

/// One value of a program. Conditions are values too: 1 where true, 0 where false.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Node {
    /// The n-th input.
    Input(u32),
    /// A constant, as the bits of an `f64`.
    Const(u64),
    Unary(Unary, Id),
    Binary(Binary, Id, Id),
    /// `Select(condition, a, b)`: `a` where the condition is not 0, else `b`.
    Select(Id, Id, Id),
    /// The singular value decomposition of nine entries, row by row; its results are [`Node::Part`]s: `U` (9, row by
    /// row), singular values (3), `V` (9).
    Svd([Id; 9]),
    /// `Compose(form, [svd, d₀, d₁, d₂])`: a matrix with given values in the frames of a decomposition; its results
    /// are nine [`Node::Part`]s, row by row.
    Compose(Form, [Id; 4]),
    /// The n-th result of a node that has several.
    Part(Id, u8),
}

/// How the frames of `F = U Σ Vᵀ` make a matrix of three values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Form {
    /// `U diag(d) Vᵀ`
    TwoPoint,
    /// `U diag(d) Uᵀ`
    Left,
    /// `V diag(d) Vᵀ`
    Right,
}

impl Node {
    /// The node of a constant.
    pub fn constant(value: f64) -> Self {
        Self::Const(value.to_bits())
    }

    /// The operands, in order.
    pub fn operands(self) -> impl Iterator<Item = Id> {
        let (ids, count) = match self {
            Self::Input(_) | Self::Const(_) => ([0; 9], 0),
            Self::Unary(_, a) | Self::Part(a, _) => ([a, 0, 0, 0, 0, 0, 0, 0, 0], 1),
            Self::Binary(_, a, b) => ([a, b, 0, 0, 0, 0, 0, 0, 0], 2),
            Self::Select(c, a, b) => ([c, a, b, 0, 0, 0, 0, 0, 0], 3),
            Self::Compose(_, [svd, a, b, c]) => ([svd, a, b, c, 0, 0, 0, 0, 0], 4),
            Self::Svd(entries) => (entries, 9),
        };
        ids.into_iter().take(count)
    }

    /// The same node with every operand renamed.
    pub fn rename(self, to: impl Fn(Id) -> Id) -> Self {
        match self {
            Self::Input(_) | Self::Const(_) => self,
            Self::Unary(op, a) => Self::Unary(op, to(a)),
            Self::Binary(op, a, b) => Self::Binary(op, to(a), to(b)),
            Self::Select(c, a, b) => Self::Select(to(c), to(a), to(b)),
            Self::Svd(entries) => Self::Svd(entries.map(to)),
            Self::Compose(form, operands) => Self::Compose(form, operands.map(to)),
            Self::Part(of, n) => Self::Part(to(of), n),
        }
    }
}

/// Nodes under construction. Every node passes [`Graph::push`], which simplifies it and shares equal ones.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    nodes: Vec<Node>,
    seen: HashMap<Node, Id>,
}

impl Graph {
    /// The node at `id`.
    pub fn node(&self, id: Id) -> Node {
        self.nodes[id as usize]
    }

    /// The value of a constant node.
    pub fn constant(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Const(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Adds a node, or finds the one that already computes the same.
    pub fn push(&mut self, node: Node) -> Id {
        match self.simplify(node) {
            Ok(id) => id,
            Err(node) => self.intern(node),
        }
    }

    /// Adds a node as it is unless an equal one exists.
    pub fn intern(&mut self, node: Node) -> Id {
        let Self { nodes, seen } = self;
        *seen.entry(node).or_insert_with(|| {
            nodes.push(node);
            u32::try_from(nodes.len() - 1).expect("a scalar program has fewer than 2^32 nodes")
        })
    }

    /// The nodes that `outputs` depend on, renumbered densely, with the outputs' new ids.
    pub fn reachable(&self, outputs: &[Id]) -> (Vec<Node>, Vec<Id>) {
        let mut live = vec![false; self.nodes.len()];
        for &output in outputs {
            live[output as usize] = true;
        }
        for id in (0..self.nodes.len()).rev() {
            if live[id] {
                for operand in self.nodes[id].operands() {
                    live[operand as usize] = true;
                }
            }
        }
        let mut renamed = vec![0; self.nodes.len()];
        let mut kept = Vec::new();
        for (id, node) in self.nodes.iter().enumerate().filter(|&(id, _)| live[id]) {
            renamed[id] = kept.len() as Id;
            kept.push(node.rename(|operand| renamed[operand as usize]));
        }
        (kept, outputs.iter().map(|&id| renamed[id as usize]).collect())
    }
}
