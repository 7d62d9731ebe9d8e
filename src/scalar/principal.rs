//! Functions of principal stretches: what a matrix is in the frames of its singular value decomposition.

use super::graph::{Form, Graph, Id, Node};
use super::handle::Scalar;
use super::instruction::Binary;
use super::{Mat3, Vec3, trace};

/// The singular value decomposition `F = U diag(σ) Vᵀ` of a traced matrix, and matrices that share its frames.
///
/// `U` and `V` are rotations; the singular values, the *principal stretches* of a deformation gradient, descend, and the
/// last has the sign of `det F`.
///
/// A law that works on principal stretches computes three values `d` from three stretches and puts them back into the
/// frames: [`Principal::two_point`], [`Principal::left`], [`Principal::right`]. Such an *isotropic function* has a
/// derivative in closed form that needs none of `U` and `V`, with divided differences `(dᵢ − dⱼ)/(σᵢ − σⱼ)` which stay
/// finite, and exact, where stretches coincide, as they do at rest. For that the three values have to treat the three
/// stretches alike: compute them with the same expression.
///
/// ```
/// use gradreel::scalar::{Mat3, Program};
///
/// // Hencky's stress τ = U diag(2μ ln σ) Uᵀ for μ = ½, and the cotangent of F at rest
/// const F: [&str; 9] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22"];
/// const TAU: [&str; 9] = ["t00", "t01", "t02", "t10", "t11", "t12", "t20", "t21", "t22"];
/// let hencky = Program::trace("hencky", &F, &TAU, |f| {
///     let principal = Mat3::from_slice(f).principal();
///     principal.left(principal.stretches().map(|s| s.ln())).to_vec()
/// });
/// let rest = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// let shear = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
/// let cotangent = hencky.vjp().eval(&[rest, shear].concat());
/// assert_eq!(cotangent, [0.0, 0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
/// ```
///
/// Source: Miehe, *Comparison of Two Algorithms for the Computation of Fourth-Order Isotropic Tensor Functions*, 1998.
#[derive(Debug, Clone, Copy)]
pub struct Principal {
    svd: Scalar,
    stretches: [Scalar; 3],
}

impl Mat3 {
    /// Its singular value decomposition. That of [`Principal::two_point`] is known and costs nothing: it has the same
    /// frames.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.stretches().norm_squared()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 14.0).abs() < 1e-12);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn principal(self) -> Principal {
        let entries = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|n| self.0[n / 3][n % 3]);
        if let Some((svd, stretches)) = trace::two_point(entries) {
            return Principal { svd, stretches };
        }
        let svd = trace::svd(entries);
        Principal { svd, stretches: [9, 10, 11].map(|n| trace::part(svd, n)) }
    }
}

impl Principal {
    /// The principal stretches.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.stretches().norm_squared()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 14.0).abs() < 1e-12);
    /// ```
    pub fn stretches(self) -> Vec3 {
        Vec3(self.stretches)
    }

    /// `U`, a rotation. Its derivative is not finite where two stretches coincide; there it is cut off.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.u().det()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 1.0).abs() < 1e-12);
    /// ```
    #[track_caller]
    pub fn u(self) -> Mat3 {
        matrix(self.svd, 0)
    }

    /// `V`, a rotation. Its derivative is as that of [`Principal::u`].
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.v().det()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 1.0).abs() < 1e-12);
    /// ```
    #[track_caller]
    pub fn v(self) -> Mat3 {
        matrix(self.svd, 12)
    }

    /// `U diag(d) Vᵀ`: a deformation gradient with other stretches.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.two_point(principal.stretches()).trace()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 6.0).abs() < 1e-12);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn two_point(self, d: Vec3) -> Mat3 {
        self.compose(Form::TwoPoint, d)
    }

    /// `U diag(d) Uᵀ`: a symmetric matrix in the deformed body, such as the Kirchhoff stress.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.left(principal.stretches().map(|s| s.ln())).trace()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 6.0f64.ln()).abs() < 1e-12);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn left(self, d: Vec3) -> Mat3 {
        self.compose(Form::Left, d)
    }

    /// `V diag(d) Vᵀ`: a symmetric matrix in the undeformed body, such as the right stretch tensor.
    ///
    /// ```
    /// use gradreel::scalar::{Mat3, Program, Vec3};
    /// let f = Program::trace("f", &["x"], &["y"], |x| {
    ///     let stretch = Mat3::diag(Vec3::new(x[0], 2.0, 1.0));
    ///     let principal = stretch.principal();
    ///     vec![principal.right(principal.stretches().map(|s| s.square())).trace()]
    /// });
    /// assert!((f.eval(&[3.0f64])[0] - 14.0).abs() < 1e-12);
    /// ```
    #[must_use]
    #[track_caller]
    pub fn right(self, d: Vec3) -> Mat3 {
        self.compose(Form::Right, d)
    }

    #[track_caller]
    fn compose(self, form: Form, d: Vec3) -> Mat3 {
        matrix(trace::compose(form, self.svd, d.0), 0)
    }
}

/// Nine parts of a node, row by row.
#[track_caller]
pub(super) fn matrix(of: Scalar, first: u8) -> Mat3 {
    Mat3([0, 1, 2].map(|i| [0, 1, 2].map(|j| trace::part(of, first + 3 * i + j))))
}

/// The same nodes with the matrices that are composed in principal frames written out in products and sums.
pub(super) fn write_out(nodes: &[Node], results: &[Id]) -> (Vec<Node>, Vec<Id>) {
    if !nodes.iter().any(|node| matches!(node, Node::Compose(..))) {
        return (nodes.to_vec(), results.to_vec());
    }
    let mut graph = Graph::default();
    let mut renamed: Vec<Id> = Vec::with_capacity(nodes.len());
    let mut entries: Vec<Option<[Id; 9]>> = Vec::with_capacity(nodes.len());
    for &node in nodes {
        let composed = match node {
            Node::Compose(form, operands) => Some(compose(&mut graph, form, operands.map(|id| renamed[id as usize]))),
            _ => None,
        };
        renamed.push(match (node, composed) {
            (_, Some(entries)) => entries[0],
            (Node::Part(of, n), _) if entries[of as usize].is_some() => {
                entries[of as usize].map_or(0, |entries| entries[usize::from(n)])
            }
            _ => graph.push(node.rename(|id| renamed[id as usize])),
        });
        entries.push(composed);
    }
    graph.reachable(&results.iter().map(|&id| renamed[id as usize]).collect::<Vec<_>>())
}

/// The nine entries of a composed matrix.
fn compose(graph: &mut Graph, form: Form, [svd, d @ ..]: [Id; 4]) -> [Id; 9] {
    let (left, right) = match form {
        Form::TwoPoint => (0, 12),
        Form::Left => (0, 0),
        Form::Right => (12, 12),
    };
    let mut frame =
        |first: u8| -> [Id; 9] { [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|n| graph.push(Node::Part(svd, first + n))) };
    let (left, right) = (frame(left), frame(right));
    let scaled = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|n| graph.push(Node::Binary(Binary::Mul, left[n], d[n % 3])));
    let mut entries = [0; 9];
    for n in 0..9 {
        let (i, j) = (n / 3, n % 3);
        entries[n] = if form != Form::TwoPoint && j < i {
            entries[3 * j + i]
        } else {
            let [a, b, c] =
                [0, 1, 2].map(|k| graph.push(Node::Binary(Binary::Mul, scaled[3 * i + k], right[3 * j + k])));
            let sum = graph.push(Node::Binary(Binary::Add, a, b));
            graph.push(Node::Binary(Binary::Add, sum, c))
        };
    }
    entries
}
