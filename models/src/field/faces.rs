//! The surface area of a voxel body, as a regulariser.

use gradreel::{Result, Tensor, Var};

use crate::constant;
use crate::field::Field;
use crate::field::hull::node;

/// The faces between the voxels of a field, and its outer faces.
#[derive(Debug, Clone)]
pub struct Faces {
    /// The two voxels of each inner face.
    between: [Vec<u32>; 2],
    /// Number of outer faces of each voxel.
    open: Vec<f64>,
}

/// Opacity difference `ε` below which the penalty is quadratic.
const ALIKE: f64 = 0.1;

impl Field {
    /// The faces of the field's voxels.
    pub fn faces(&self) -> Faces {
        let [nx, ny, nz] = self.node_grid.dims;
        let mut numbers = vec![u32::MAX; nx * ny * nz];
        self.voxels.iter().zip(0..).for_each(|(&voxel, number)| numbers[voxel as usize] = number);
        let mut faces = Faces { between: [Vec::new(), Vec::new()], open: vec![6.0; self.len()] };
        for (number, &voxel) in self.voxels.iter().enumerate() {
            let here = node(&self.node_grid, voxel as usize);
            for (axis, stride) in [ny * nz, nz, 1].into_iter().enumerate() {
                if here[axis] + 1 == self.node_grid.dims[axis] {
                    continue;
                }
                let next = numbers[voxel as usize + stride];
                if next != u32::MAX {
                    faces.between[0].push(number as u32);
                    faces.between[1].push(next);
                    faces.open[number] -= 1.0;
                    faces.open[next as usize] -= 1.0;
                }
            }
        }
        faces
    }
}

impl Faces {
    /// Drops the outer faces: the field counts as the body, and only surface carved into it is penalised.
    #[must_use]
    pub fn carved(self) -> Self {
        Self { open: vec![0.0; self.open.len()], ..self }
    }

    /// Surface area relative to a cube of as many voxels: `Σ φ(o_i − o_j) / (6 n^⅔)` over all faces, with
    /// `φ(d) = √(d² + ε²) − ε`, for opacities `o` `[n, 1]` (0 outside the field).
    ///
    /// A total variation. An axis-aligned box is neither rounded nor shrunk; pits are closed and protrusions removed.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn area(&self, opacity: &Var) -> Result<Var> {
        let size = |difference: &Var| (difference.square() + ALIKE * ALIKE).sqrt() - ALIKE;
        let [low, high] = [0, 1].map(|side| constant::indices(opacity, self.between[side].clone()));
        let inside = size(&(&opacity.index_select(&low?)? - &opacity.index_select(&high?)?));
        let count = self.open.len();
        let open = opacity.tape().constant(Tensor::from_vec(self.open.clone(), [count, 1]).cast(opacity.dtype())?);
        let outside = (&open * &size(opacity)).sum_all();
        Ok((&inside.sum_all() + &outside) * (1.0 / (6.0 * (count.max(1) as f64).powf(2.0 / 3.0))))
    }
}
