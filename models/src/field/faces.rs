//! The surface of a body of voxels, and how large it is.

use gradreel::{Result, Tensor, Var};

use crate::constant;
use crate::field::Field;
use crate::field::hull::node;

/// The faces between the voxels of a field, and those to what is around it.
#[derive(Debug, Clone)]
pub struct Faces {
    /// The voxels on both sides of each face between two.
    between: [Vec<u32>; 2],
    /// The number of faces of each voxel beyond which there is none.
    open: Vec<f64>,
}

/// Opacities that differ by less than this are about alike.
const ALIKE: f64 = 0.1;

impl Field {
    /// The faces of its voxels.
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
    /// Without those to what is around the field: the field is taken to be the body, and only the surface of what is carved from it counts.
    #[must_use]
    pub fn carved(self) -> Self {
        Self { open: vec![0.0; self.open.len()], ..self }
    }

    /// How much larger the surface is than that of a cube of as many voxels: `Σ φ(o_i − o_j) / (6 n^⅔)` over all faces, with
    /// `φ(d) = √(d² + ε²) − ε`, for opacities `o` `[n, 1]` (0 beyond the field).
    ///
    /// A total variation. Along the axes it neither rounds a box nor draws it in, but closes pits and takes away what sticks out.
    ///
    /// ```
    /// use gradreel::ops::NodeGrid;
    /// use gradreel::{Tape, Tensor};
    /// use gradreel_models::field::Field;
    ///
    /// let node_grid = NodeGrid { origin: [0.0; 3], spacing: 0.01, dims: [5; 3] };
    /// let faces = Field { node_grid, voxels: (0..125).collect() }.faces();
    /// let tape = Tape::new();
    /// let mut opacity = vec![1.0; 125];
    /// let whole = faces.area(&tape.constant(Tensor::from_vec(opacity.clone(), [125, 1])))?.item()?;
    /// opacity[12] = 0.0; // the middle of a side
    /// let pitted = faces.area(&tape.constant(Tensor::from_vec(opacity, [125, 1])))?.item()?;
    /// assert!((whole - 0.905).abs() < 1e-3 && pitted > 1.02 * whole);
    /// // what is carved from a whole cube: nothing
    /// let carved = faces.carved().area(&tape.constant(Tensor::full(1.0, [125, 1], gradreel::DType::F64)))?.item()?;
    /// assert_eq!(carved, 0.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// What the ops return.
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
