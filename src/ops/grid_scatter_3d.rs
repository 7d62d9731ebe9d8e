//! `grid_scatter_3d`: spreads values at points to the nodes of a grid with trilinear weights. The adjoint of
//! [`grid_sample_3d`](super::grid_sample_3d).

use std::rc::Rc;

use crate::ops::grid_sample_3d::position_gradient;
use crate::ops::{Case, Entry, Lattice, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "grid_scatter_3d",
    gpu: false,
    cases: || {
        let lattice = Lattice { origin: [-0.5, 0.0, 0.25], spacing: 0.2, dims: [4, 3, 5] };
        vec![Case::new(GridScatter3d { lattice }, [uniform(1, [60, 2], -1.0..1.0), uniform(2, [60, 3], -0.6..1.1)])]
    },
};

#[derive(Debug)]
struct GridScatter3d {
    lattice: Lattice,
}

impl GridScatter3d {
    /// In the order of the points, so that the sums do not depend on the thread count.
    fn run<T: Real>(&self, values: &Tensor, points: &Tensor) -> Vec<T> {
        let channels = values.dims()[1];
        let mut grid = vec![T::from_f64(0.0); self.lattice.len() * channels];
        for (row, point) in values.slice::<T>().chunks(channels.max(1)).zip(points.slice::<T>().chunks(3)) {
            let corners = self.lattice.corners(point);
            for (node, weight) in corners.nodes.iter().zip(corners.weights) {
                let Some(node) = node else { continue };
                let sums = &mut grid[node * channels..][..channels];
                sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * *v);
            }
        }
        grid
    }
}

impl Op for GridScatter3d {
    fn name(&self) -> &'static str {
        "grid_scatter_3d"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [values, points] = inputs else { unreachable!("grid_scatter_3d has two operands") };
        let [nx, ny, nz] = self.lattice.dims;
        match (values.shape.dims(), points.shape.dims()) {
            (&[count, channels], &[other, 3]) if count == other && values.dtype == points.dtype => {
                Ok(Spec::new([nx, ny, nz, channels], values.dtype))
            }
            _ => Err(Error::new(ErrorKind::Shape, "grid_scatter_3d: the operands do not fit")
                .found(format!("{values:?} at {points:?}"))
                .wanted("[points, channels] at [points, 3]")),
        }
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let [nx, ny, nz] = self.lattice.dims;
        let shape = [nx, ny, nz, inputs[0].dims()[1]];
        for_real!(inputs[0].dtype(), T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0], &inputs[1]), shape).into()))
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        // the place of a point always, what lies around it for the slope alone
        Reads::nothing().input(1).input_if(0, wanted[1])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (values, points, g) = (cx.input(0), cx.input(1), cx.gradient());
        let for_values = || g.grid_sample_3d(points, self.lattice);
        let for_points = || -> Result<Var> {
            cx.first_order_only("grid_scatter_3d in its points")?;
            Ok(points.tape().constant(position_gradient(&self.lattice, g.tensor(), points.tensor(), values.tensor())))
        };
        Ok(vec![cx.wants(0).then(for_values), cx.wants(1).then(for_points).transpose()?])
    }
}

impl Var {
    /// Spreads values `[count, channels]` at points `[count, 3]` to the nodes of `lattice` with trilinear weights:
    /// `[x, y, z, channels]`. What falls on nodes outside is dropped. Differentiable in the values (any number of times)
    /// and in the points (once).
    ///
    /// # Panics
    /// When the shapes do not fit.
    #[track_caller]
    #[must_use]
    pub fn grid_scatter_3d(&self, points: &Self, lattice: Lattice) -> Self {
        Self::run(Rc::new(GridScatter3d { lattice }), &[self, points])
    }
}
