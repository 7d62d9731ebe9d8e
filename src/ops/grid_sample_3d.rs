//! `grid_sample_3d`: trilinear lookup of a grid at points. Its adjoint in the values is
//! [`grid_scatter_3d`](super::grid_scatter_3d).

use std::rc::Rc;

use rayon::prelude::*;

use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "grid_sample_3d",
    gpu: false,
    cases: || {
        let lattice = Lattice { origin: [-0.5, 0.0, 0.25], spacing: 0.2, dims: [4, 3, 5] };
        let grid = uniform(1, [4, 3, 5, 2], -1.0..1.0);
        vec![Case::new(GridSample3d { lattice }, [grid, uniform(2, [60, 3], -0.6..1.1)])]
    },
};

/// A regular lattice of nodes: node `(i, j, k)` lies at `origin + spacing · (i, j, k)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Position of node (0, 0, 0).
    pub origin: [f64; 3],
    /// Distance between neighbours along every axis.
    pub spacing: f64,
    /// Number of nodes per axis.
    pub dims: [usize; 3],
}

/// The eight nodes around a point, their weights, and the weights' derivatives with respect to the point.
pub(super) struct Corners<T> {
    /// Flat node numbers; `None` outside the lattice.
    pub(super) nodes: [Option<usize>; 8],
    pub(super) weights: [T; 8],
    pub(super) slopes: [[T; 3]; 8],
}

impl Lattice {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The nodes around a point; those outside the lattice count as zero.
    pub(super) fn corners<T: Real>(&self, point: &[T]) -> Corners<T> {
        let inverse = 1.0 / self.spacing;
        let mut base = [0i64; 3];
        let mut hats = [[(T::from_f64(0.0), T::from_f64(0.0)); 2]; 3];
        for axis in 0..3 {
            let x = (point[axis].to_f64() - self.origin[axis]) * inverse;
            let floor = x.floor();
            base[axis] = floor as i64;
            let f = x - floor;
            hats[axis] = [(T::from_f64(1.0 - f), T::from_f64(-inverse)), (T::from_f64(f), T::from_f64(inverse))];
        }
        let mut corners =
            Corners { nodes: [None; 8], weights: [T::from_f64(0.0); 8], slopes: [[T::from_f64(0.0); 3]; 8] };
        for corner in 0..8 {
            let offset = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let node: [i64; 3] = std::array::from_fn(|a| base[a] + offset[a] as i64);
            let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&node[a]));
            let [(wx, sx), (wy, sy), (wz, sz)]: [(T, T); 3] = std::array::from_fn(|a| hats[a][offset[a]]);
            let flat = (node[0] * self.dims[1] as i64 + node[1]) * self.dims[2] as i64 + node[2];
            corners.nodes[corner] = inside.then_some(flat as usize);
            corners.weights[corner] = wx * wy * wz;
            corners.slopes[corner] = [sx * wy * wz, wx * sy * wz, wx * wy * sz];
        }
        corners
    }
}

#[derive(Debug)]
struct GridSample3d {
    lattice: Lattice,
}

impl GridSample3d {
    fn run<T: Real>(&self, grid: &Tensor, points: &Tensor) -> Vec<T> {
        let channels = grid.dims()[3];
        let values = grid.slice::<T>();
        let mut sampled = vec![T::from_f64(0.0); points.dims()[0] * channels];
        sampled.par_chunks_mut(channels.max(1)).with_min_len(1024).zip(points.slice::<T>().par_chunks(3)).for_each(
            |(out, point)| {
                let corners = self.lattice.corners(point);
                for (node, weight) in corners.nodes.iter().zip(corners.weights) {
                    let Some(node) = node else { continue };
                    let row = &values[node * channels..][..channels];
                    out.iter_mut().zip(row).for_each(|(o, v)| *o += weight * *v);
                }
            },
        );
        sampled
    }
}

impl Op for GridSample3d {
    fn name(&self) -> &'static str {
        "grid_sample_3d"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [grid, points] = inputs else { unreachable!("grid_sample_3d has two operands") };
        let [nx, ny, nz] = self.lattice.dims;
        match (grid.shape.dims(), points.shape.dims()) {
            (&[x, y, z, channels], &[count, 3]) if [x, y, z] == [nx, ny, nz] && grid.dtype == points.dtype => {
                Ok(Spec::new([count, channels], grid.dtype))
            }
            _ => Err(Error::new(ErrorKind::Shape, "grid_sample_3d: the operands do not fit")
                .found(format!("{grid:?} at {points:?}"))
                .wanted(format!("[{nx}, {ny}, {nz}, channels] at [points, 3]"))),
        }
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let shape = [inputs[1].dims()[0], inputs[0].dims()[3]];
        for_real!(inputs[0].dtype(), T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0], &inputs[1]), shape).into()))
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        // the place of a point always, what lies around it for the slope alone
        Reads::nothing().input(1).input_if(0, wanted[1])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (grid, points, g) = (cx.input(0), cx.input(1), cx.gradient());
        let for_grid = || g.grid_scatter_3d(points, self.lattice);
        let for_points = || -> Result<Var> {
            cx.first_order_only("grid_sample_3d in its points")?;
            Ok(points.tape().constant(position_gradient(&self.lattice, grid.tensor(), points.tensor(), g.tensor())))
        };
        Ok(vec![cx.wants(0).then(for_grid), cx.wants(1).then(for_points).transpose()?])
    }
}

/// `∂/∂x_p Σ_c u_pc · sample(grid, x_p)_c` for every point: `[points, 3]`.
pub(super) fn position_gradient(lattice: &Lattice, grid: &Tensor, points: &Tensor, u: &Tensor) -> Tensor {
    fn run<T: Real>(lattice: &Lattice, grid: &Tensor, points: &Tensor, u: &Tensor) -> Vec<T> {
        let channels = grid.dims()[3];
        let (values, weights) = (grid.slice::<T>(), u.slice::<T>());
        let mut slopes = vec![T::from_f64(0.0); points.len()];
        slopes.par_chunks_mut(3).with_min_len(1024).zip(points.slice::<T>().par_chunks(3)).enumerate().for_each(
            |(p, (out, point))| {
                let corners = lattice.corners(point);
                for (node, slope) in corners.nodes.iter().zip(corners.slopes) {
                    let Some(node) = node else { continue };
                    let row = &values[node * channels..][..channels];
                    let u = &weights[p * channels..][..channels];
                    let dot = row.iter().zip(u).fold(T::from_f64(0.0), |sum, (v, u)| sum + *v * *u);
                    out.iter_mut().zip(slope).for_each(|(o, s)| *o += s * dot);
                }
            },
        );
        slopes
    }
    for_real!(grid.dtype(), T => Tensor::from_vec(run::<T>(lattice, grid, points, u), points.shape()))
}

impl Var {
    /// Trilinear lookup at points `[count, 3]` of a grid `[x, y, z, channels]` whose nodes form `lattice`: `[count,
    /// channels]`. Nodes outside count as zero. Differentiable in the grid (any number of times) and in the points (once).
    ///
    /// # Panics
    /// When the shapes do not fit.
    #[track_caller]
    #[must_use]
    pub fn grid_sample_3d(&self, points: &Self, lattice: Lattice) -> Self {
        Self::run(Rc::new(GridSample3d { lattice }), &[self, points])
    }
}
