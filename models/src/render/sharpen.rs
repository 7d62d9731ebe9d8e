//! Sharpening: partial removal of the blur of trilinear weights, which affects thin parts most.

use gradreel::ops::NodeGrid;
use gradreel::scalar::Real;
use gradreel::{Backward, DType, Error, ErrorKind, Forward, Op, Operands, Reads, Result, Spec, Tensor, Var};
use rayon::prelude::*;

/// Removes a share of the blur from a grid `[x, y, z, channels]` that particles were [`splat`](super::splat())ted to:
/// `g − share/6 · Δg`, where `Δg` is the sum of second differences along the three axes, with zeros outside the grid.
///
/// Trilinear weights blur with the variance `h²/6` along each axis when particles are spread, and again in the lookup;
/// `share` 1 compensates both. Noise on the scale of a cell is amplified, threefold at `share` 1.
///
/// # Errors
/// [`ErrorKind::Shape`] when `grid` does not match `node_grid`.
pub fn sharpen(grid: &Var, node_grid: NodeGrid, share: f64) -> Result<Var> {
    // a zero share adds no node to the tape
    if share == 0.0 { Ok(grid.clone()) } else { grid.apply(Sharpen { node_grid, share }, &[]) }
}

#[derive(Debug)]
struct Sharpen {
    node_grid: NodeGrid,
    share: f64,
}

/// [`sharpen`] on plain values `[nodes, channels]`.
pub(super) fn sharpened<T: Real>(values: &[T], dims: [usize; 3], channels: usize, share: f64) -> Vec<T> {
    let [nx, ny, nz] = dims;
    let part = T::from_f64(share / 6.0);
    let whole = T::ONE + T::from_f64(6.0) * part;
    let mut result = vec![T::ZERO; values.len()];
    let plane = (ny * nz * channels).max(1);
    result.par_chunks_mut(plane).enumerate().for_each(|(x, result)| {
        for (row, result) in result.chunks_mut(nz * channels).enumerate() {
            let at = (x * ny + row) * nz * channels;
            let here = &values[at..at + nz * channels];
            let (far, next) = (plane as isize, (nz * channels) as isize);
            let beside = [(x > 0, -far), (x + 1 < nx, far), (row > 0, -next), (row + 1 < ny, next)];
            for (sum, value) in result.iter_mut().zip(here) {
                *sum = whole * *value;
            }
            for (_, offset) in beside.iter().filter(|(inside, _)| *inside) {
                let there = &values[at.wrapping_add_signed(*offset)..][..nz * channels];
                for (sum, value) in result.iter_mut().zip(there) {
                    *sum -= part * *value;
                }
            }
            for (sum, value) in result[channels..].iter_mut().zip(here) {
                *sum -= part * *value;
            }
            for (sum, value) in result.iter_mut().zip(&here[channels..]) {
                *sum -= part * *value;
            }
        }
    });
    result
}

impl Sharpen {
    fn of(&self, values: &Tensor) -> Tensor {
        let channels = values.dims()[3];
        match values.dtype() {
            DType::F64 => Tensor::from_vec(
                sharpened::<f64>(values.slice(), self.node_grid.dims, channels, self.share),
                values.shape(),
            ),
            _ => Tensor::from_vec(
                sharpened::<f32>(values.slice(), self.node_grid.dims, channels, self.share),
                values.shape(),
            ),
        }
    }
}

impl Op for Sharpen {
    fn name(&self) -> &'static str {
        "sharpen"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [grid] = Spec::exactly(self.name(), inputs)?;
        let dims = grid.shape.dims();
        if dims.len() != 4 || dims[..3] != self.node_grid.dims || !grid.dtype.is_real() {
            let [x, y, z] = self.node_grid.dims;
            return Err(Error::new(ErrorKind::Shape, "sharpen: the grid is not one of the grid")
                .found(format!("{grid:?}"))
                .wanted(format!("[{x}, {y}, {z}, channels]")));
        }
        Ok(grid.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        Ok(self.of(&inputs[0]).into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    /// The operator is symmetric.
    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(sharpen(cx.gradient(), self.node_grid, self.share)?)])
    }
}
