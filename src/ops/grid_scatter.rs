//! `grid_scatter`: spreads values at points to the nodes of a regular grid. The adjoint of
//! [`grid_sample`](super::grid_sample).

use std::rc::Rc;

use crate::backend::cpu;
use crate::backend::gpu::{Gpu, Kernel, Work, sorted_pairs, words};
use crate::ops::grid::{Extent, Placement};
use crate::ops::grid_sample::{GridSample, slope};
use crate::ops::{Case, Entry, GridSampling, Interpolation, NodeGrid, Padding, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "grid_scatter",
    gpu: true,
    cases: || {
        let node_grid = NodeGrid { origin: [-0.5, 0.0, 0.25], spacing: 0.2, dims: [4, 3, 5] };
        let at = uniform(2, [60, 3], -0.6..1.1);
        let place = Placement::node_grid(&node_grid);
        let mut cases = vec![Case::new(GridScatter { place }, [uniform(1, [60, 2], -1.0..1.0), at])];
        let settings = [
            (Interpolation::Linear, Padding::Border, false),
            (Interpolation::Linear, Padding::Zeros, true),
            (Interpolation::Nearest, Padding::Zeros, false),
        ];
        let shapes: [(&[usize], &[usize], &[usize]); 3] = [
            (&[4, 5], &[2, 3, 7], &[2, 7, 2]),
            (&[3, 1, 2], &[1, 1, 2, 5, 3], &[1, 2, 5, 3, 3]),
            (&[2, 3], &[1, 21, 4], &[1, 4, 2]),
        ];
        for (interpolation, padding, align_corners) in settings {
            for (sizes, samples, points) in shapes {
                let settings = GridSampling { interpolation, padding, align_corners };
                let op = GridScatter { place: Placement::unit(sizes, settings) };
                cases.push(Case::new(op, [uniform(3, samples, -1.0..1.0), uniform(4, points, -1.3..1.3)]));
            }
        }
        cases
    },
};

const TEXT: &str = include_str!("../../kernels/grid_scatter.wgsl");

/// The cell of each point, as pairs to be sorted.
pub(super) static CELLS: Kernel = Kernel::new("grid_scatter", "cells", TEXT, &["pairs", "points"]);
/// Where the points of each cell start among the sorted pairs.
pub(super) static STARTS: Kernel = Kernel::new("grid_scatter", "find_starts", TEXT, &["begins", "sorted"]);
/// The sum of one channel of a node per invocation.
pub(super) static GATHER: Kernel =
    Kernel::new("grid_scatter", "gather", TEXT, &["y", "samples", "points", "starts", "sorted"]);

#[derive(Debug)]
pub(super) struct GridScatter {
    pub(super) place: Placement,
}

impl GridScatter {
    /// Sorts the points by cell; then each node adds up those of the cells around it. No atomics: the same bits every time.
    fn run(&self, gpu: &Gpu, samples: &Tensor, points: &Tensor, extent: Extent, result: Spec) -> Result<Tensor> {
        let count = extent.batch * extent.count;
        let list = |len: usize| Spec::new([len], DType::U32);
        // a cell for every place of the lower node, one before the first node included
        let cells = extent.batch * self.place.axes.iter().map(|axis| axis.size + 1).product::<usize>();
        let words_of = |len: usize| self.place.words(extent, len);
        let pairs = gpu.launch(&CELLS, &[points], &words_of(count), list(2 * count), Work::Invocations(count))?;
        let pairs = sorted_pairs(gpu, &pairs)?;
        let starts = &words([cells + 1, count]);
        let starts = gpu.launch(&STARTS, &[&pairs], starts, list(cells + 1), Work::Invocations(cells + 1))?;
        let len = result.shape.len();
        gpu.launch(&GATHER, &[samples, points, &starts, &pairs], &words_of(len), result, Work::Invocations(len))
    }
}

impl Op for GridScatter {
    fn name(&self) -> &'static str {
        "grid_scatter"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [samples, points] = Spec::exactly(self.name(), inputs)?;
        Ok(self.place.scattered(self.name(), samples, points)?.1)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [samples, points] = inputs.array();
        let (extent, result) = self.place.scattered(self.name(), &samples.spec(), &points.spec())?;
        for_real!(result.dtype, T => {
            let grid = cpu::grid::scatter::<T>(&self.place, extent, samples.slice(), points.slice());
            Ok(Tensor::from_vec(grid, result.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [samples, points] = inputs.array();
        let (extent, result) = self.place.scattered(self.name(), &samples.spec(), &points.spec())?;
        Ok(self.run(gpu, samples, points, extent, result)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        // where the points are always, what they spread for their slopes alone
        Reads::nothing().input(1).input_if(0, wanted[1])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (samples, points, g) = (cx.input(0), cx.input(1), cx.gradient());
        let for_samples = || Var::run(Rc::new(GridSample { place: self.place.clone() }), &[g, points]);
        let for_points = || -> Result<Var> {
            cx.first_order_only("grid_scatter in its points")?;
            Ok(points.tape().constant(slope(&self.place, g.tensor(), points.tensor(), samples.tensor())?))
        };
        Ok(vec![cx.wants(0).then(for_samples), cx.wants(1).then(for_points).transpose()?])
    }
}

impl Var {
    /// Spreads values `[count, channels]` at points `[count, 3]` to the nodes of `node_grid` with trilinear weights:
    /// `[x, y, z, channels]`. What falls on nodes outside is dropped; a point that is not finite makes the nodes of the
    /// first cell NaN. Differentiable in the values (any number of times) and in the points (once). The sums are added up
    /// in the same order whatever the number of threads.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::NodeGrid};
    /// let tape = Tape::new();
    /// // two nodes along x, one metre apart
    /// let nodes = NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: [2, 1, 1] };
    /// let mass = tape.leaf(Tensor::from_vec(vec![4.0], [1, 1]));
    /// let points = tape.leaf(Tensor::from_vec(vec![0.25, 0.0, 0.0], [1, 3]));
    /// assert_eq!(mass.grid_scatter_3d(&points, nodes).value()?.slice::<f64>(), [3.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not fit, or the grid has no nodes.
    #[track_caller]
    #[must_use]
    pub fn grid_scatter_3d(&self, points: &Self, node_grid: NodeGrid) -> Self {
        Self::run(Rc::new(GridScatter { place: Placement::node_grid(&node_grid) }), &[self, points])
    }
}
