//! `grid_sample`: lookup of a regular grid at points. Its adjoint in the values is [`grid_scatter`](super::grid_scatter).

use std::rc::Rc;

use crate::backend::cpu;
use crate::backend::gpu::{Gpu, Kernel, Work};
use crate::ops::grid::Placement;
use crate::ops::grid_scatter::GridScatter;
use crate::ops::{Case, Entry, GridSampling, Interpolation, NodeGrid, Padding, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "grid_sample",
    gpu: true,
    cases: || {
        let node_grid = NodeGrid { origin: [-0.5, 0.0, 0.25], spacing: 0.2, dims: [4, 3, 5] };
        let grid = uniform(1, [4, 3, 5, 2], -1.0..1.0);
        let mut cases = vec![Case::new(
            GridSample { place: Placement::node_grid(&node_grid) },
            [grid, uniform(2, [60, 3], -0.6..1.1)],
        )];
        let settings = [
            (Interpolation::Linear, Padding::Zeros, false),
            (Interpolation::Linear, Padding::Border, true),
            (Interpolation::Nearest, Padding::Zeros, true),
            (Interpolation::Nearest, Padding::Border, false),
        ];
        let shapes: [(&[usize], &[usize]); 3] =
            [(&[2, 3, 4, 5], &[2, 3, 7, 2]), (&[2, 1, 3, 4, 2], &[2, 9, 3]), (&[1, 21, 1, 5, 3], &[1, 2, 3, 4, 3])];
        for (interpolation, padding, align_corners) in settings {
            for (values, points) in shapes {
                let settings = GridSampling { interpolation, padding, align_corners };
                let op = GridSample { place: Placement::unit(&values[2..], settings) };
                cases.push(Case::new(op, [uniform(3, values, -1.0..1.0), uniform(4, points, -1.3..1.3)]));
            }
        }
        cases
    },
};

/// One sample per invocation.
pub(super) static SAMPLE: Kernel =
    Kernel::new("grid_sample", "sample", include_str!("../../kernels/grid_sample.wgsl"), &["y", "grid", "points"]);

/// The derivative in the points, one point per invocation.
pub(super) static SLOPE: Kernel = Kernel::new(
    "grid_sample",
    "slope",
    include_str!("../../kernels/grid_sample.wgsl"),
    &["y", "grid", "points", "samples"],
);

#[derive(Debug)]
pub(super) struct GridSample {
    pub(super) place: Placement,
}

impl Op for GridSample {
    fn name(&self) -> &'static str {
        "grid_sample"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [grid, points] = Spec::exactly(self.name(), inputs)?;
        Ok(self.place.sampled(self.name(), grid, points)?.1)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [grid, points] = inputs.array();
        let (extent, result) = self.place.sampled(self.name(), &grid.spec(), &points.spec())?;
        for_real!(result.dtype, T => {
            let samples = cpu::grid::sample::<T>(&self.place, extent, grid.slice(), points.slice());
            Ok(Tensor::from_vec(samples, result.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [grid, points] = inputs.array();
        let (extent, result) = self.place.sampled(self.name(), &grid.spec(), &points.spec())?;
        let len = result.shape.len();
        let words = self.place.words(extent, len);
        Ok(gpu.launch(&SAMPLE, &[grid, points], &words, result, Work::Invocations(len))?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        // where the points are always, what lies around them for their slopes alone
        Reads::nothing().input(1).input_if(0, wanted[1])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (grid, points, g) = (cx.input(0), cx.input(1), cx.gradient());
        let for_grid = || Var::run(Rc::new(GridScatter { place: self.place.clone() }), &[g, points]);
        let for_points = || -> Result<Var> {
            cx.first_order_only("grid_sample in its points")?;
            Ok(points.tape().constant(slope(&self.place, grid.tensor(), points.tensor(), g.tensor())?))
        };
        Ok(vec![cx.wants(0).then(for_grid), cx.wants(1).then(for_points).transpose()?])
    }
}

/// The derivative of `Σ samples · grid_sample(grid, points)` with respect to the points.
pub(super) fn slope(place: &Placement, grid: &Tensor, points: &Tensor, samples: &Tensor) -> Result<Tensor> {
    let (extent, _) = place.sampled("grid_sample", &grid.spec(), &points.spec())?;
    if let Device::Gpu(gpu) = grid.device() {
        let count = extent.batch * extent.count;
        let words = place.words(extent, count);
        return gpu.launch(&SLOPE, &[grid, points, samples], &words, points.spec(), Work::Invocations(count));
    }
    for_real!(points.dtype(), T => {
        let slopes = cpu::grid::slope::<T>(place, extent, grid.slice(), points.slice(), samples.slice());
        Ok(Tensor::from_vec(slopes, points.shape()))
    })
}

impl Var {
    /// Values of a grid `[n, c, h, w]` or `[n, c, d, h, w]` at points `[n, …, 2]` or `[n, …, 3]`: `[n, c, …]`, as PyTorch's
    /// `grid_sample`.
    ///
    /// A point's first component runs along the last axis, from −1 at its beginning to 1 at its end. A point that is not
    /// finite has the value NaN. Differentiable in the values (any number of times) and in the points (once). Where the
    /// padding is the border, points beyond it have no slope; nor has the nearest node.
    ///
    /// ```
    /// use gradreel::ops::{GridSampling, Padding};
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![0.0f64, 1.0, 2.0, 3.0], [1, 1, 2, 2]));
    /// let points = tape.leaf(Tensor::from_vec(vec![0.0f64, 0.0, -1.0, 1.0], [1, 2, 2]));
    /// let settings = GridSampling { align_corners: true, ..GridSampling::default() };
    /// let y = image.grid_sample(&points, settings);
    /// assert_eq!(y.value()?.slice::<f64>(), &[1.5, 2.0]);
    /// let slopes = y.sum_all().backward()?;
    /// assert_eq!(slopes.wrt(&points)?.slice::<f64>()[..2], [0.5, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not fit, or an axis of the grid has no nodes.
    #[track_caller]
    #[must_use]
    pub fn grid_sample(&self, points: &Self, settings: GridSampling) -> Self {
        let rank = self.dims().len();
        if !(4..=5).contains(&rank) {
            let error =
                Error::new(ErrorKind::Shape, "grid_sample: a grid has two or three axes after batch and channels");
            panic!("{}", error.found(format!("{:?}", self.spec())).wanted("[n, c, h, w] or [n, c, d, h, w]"));
        }
        Self::run(Rc::new(GridSample { place: Placement::unit(&self.dims()[2..], settings) }), &[self, points])
    }

    /// Trilinear lookup at points `[count, 3]` of a grid `[x, y, z, channels]` whose nodes form `node_grid`: `[count,
    /// channels]`. Nodes outside count as zero; a point that is not finite has the value NaN. Differentiable in the grid
    /// (any number of times) and in the points (once).
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::NodeGrid};
    /// let tape = Tape::new();
    /// // two nodes along x, one metre apart
    /// let nodes = NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: [2, 1, 1] };
    /// let grid = tape.leaf(Tensor::from_vec(vec![1.0, 3.0], [2, 1, 1, 1]));
    /// let points = tape.leaf(Tensor::from_vec(vec![0.25, 0.0, 0.0], [1, 3]));
    /// assert_eq!(grid.grid_sample_3d(&points, nodes).item()?, 1.5);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not fit, or the grid has no nodes.
    #[track_caller]
    #[must_use]
    pub fn grid_sample_3d(&self, points: &Self, node_grid: NodeGrid) -> Self {
        Self::run(Rc::new(GridSample { place: Placement::node_grid(&node_grid) }), &[self, points])
    }
}
