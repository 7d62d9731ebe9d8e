//! Placement of the meshes in a scene.

use gradreel::Result;

use super::json::{Node, Root};
use crate::vector::{cross, dot};
use crate::views::objects::mesh::damaged;

/// Maximum depth of a node.
const DEEPEST: usize = 256;

/// `x ↦ matrix x + shift`
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    matrix: [[f64; 3]; 3],
    shift: [f64; 3],
}

/// A mesh with its placement.
pub(super) struct Placed {
    pub mesh: usize,
    pub place: Place,
}

impl Place {
    const HERE: Self = Self { matrix: crate::vector::EYE, shift: [0.0; 3] };

    /// Placement of a node relative to its parent.
    fn of(node: &Node) -> Self {
        if let Some(m) = node.matrix {
            let at = |row: usize, column: usize| m[4 * column + row];
            let matrix = std::array::from_fn(|row| std::array::from_fn(|column| at(row, column)));
            return Self { matrix, shift: std::array::from_fn(|row| at(row, 3)) };
        }
        let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let scale = node.scale.unwrap_or([1.0; 3]);
        let turn = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let matrix = turn.map(|row| std::array::from_fn(|column| row[column] * scale[column]));
        Self { matrix, shift: node.translation.unwrap_or_default() }
    }

    /// Transforms a point.
    pub fn point(&self, x: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|row| dot(self.matrix[row], x) + self.shift[row])
    }

    /// Transforms a normal to unit length: the cofactor matrix is correct for non-uniform scaling, and for
    /// mirroring up to the sign.
    pub fn normal(&self, x: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.matrix;
        let turned = [cross(b, c), cross(c, a), cross(a, b)].map(|row| dot(row, x));
        let norm = dot(turned, turned).sqrt();
        turned.map(|x| if norm > 0.0 { x / norm } else { 0.0 })
    }

    /// The composition with an outer placement.
    fn within(&self, outer: &Self) -> Self {
        let matrix = crate::vector::product(outer.matrix, self.matrix);
        Self { matrix, shift: outer.point(self.shift) }
    }
}

/// All meshes of the file's scene; without a scene, those of all root nodes.
pub(super) fn placed(root: &Root) -> Result<Vec<Placed>> {
    let scene = root.scenes.get(root.scene.unwrap_or(0));
    let mut seen = vec![false; root.nodes.len()];
    let mut waiting: Vec<(usize, usize, Place)> = match scene {
        Some(scene) => scene.nodes.iter().map(|node| (*node, 0, Place::HERE)).collect(),
        None => {
            let mut child = vec![false; root.nodes.len()];
            let children = root.nodes.iter().flat_map(|node| &node.children);
            children.for_each(|index| child.get_mut(*index).into_iter().for_each(|child| *child = true));
            (0..root.nodes.len()).filter(|node| !child[*node]).map(|node| (node, 0, Place::HERE)).collect()
        }
    };
    waiting.reverse();
    let mut found = Vec::new();
    while let Some((index, depth, outer)) = waiting.pop() {
        let at = || format!("node {index}");
        let node = root.nodes.get(index).ok_or_else(|| damaged("the mesh lacks a node").at(at()))?;
        if depth > DEEPEST || std::mem::replace(&mut seen[index], true) {
            return Err(damaged("the nodes of the mesh are no tree")
                .at(at())
                .wanted("each node below one other at most"));
        }
        let place = Place::of(node).within(&outer);
        found.extend(node.mesh.map(|mesh| Placed { mesh, place }));
        waiting.extend(node.children.iter().rev().map(|child| (*child, depth + 1, place)));
    }
    Ok(found)
}
