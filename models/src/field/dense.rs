//! A dense node grid over a box, with trilinear lookups.

use gradreel::ops::NodeGrid;
use gradreel::{Error, ErrorKind, Result, Tensor, Var};

use crate::constant;

/// Largest number of nodes of a grid.
const MOST_NODES: f64 = (1u32 << 28) as f64;

/// A box with nodes along each axis; values at the nodes are tensors `[x, y, z, channels]`.
///
/// The first and last node of each axis lie on the faces of the box; the others are evenly spaced between them.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DenseGrid {
    /// Lowest corner \[m\].
    pub low: [f64; 3],
    /// Highest corner \[m\].
    pub high: [f64; 3],
    /// Nodes per axis, at least 2.
    pub dims: [usize; 3],
    /// Nominal spacing \[m\]. The actual spacing differs slightly where the extent is not a multiple of it.
    pub spacing: f64,
}

impl DenseGrid {
    /// A box with nodes about `spacing` \[m\] apart: `round(extent / spacing) + 1` per axis.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the box is empty or has too few or too many nodes.
    pub fn of_spacing(low: [f64; 3], high: [f64; 3], spacing: f64) -> Result<Self> {
        let nodes = |axis: usize| ((high[axis] - low[axis]) / spacing).round() + 1.0;
        Self::checked(low, high, spacing, [0, 1, 2].map(nodes))
    }

    /// A box of about `count` nodes: `⌊extent / spacing⌋` per axis with `spacing = (volume / count)^⅓`.
    ///
    /// # Errors
    /// As [`DenseGrid::of_spacing`].
    pub fn of_count(low: [f64; 3], high: [f64; 3], count: usize) -> Result<Self> {
        let volume: f64 = (0..3).map(|axis| high[axis] - low[axis]).product();
        let spacing = (volume / count as f64).cbrt();
        // rounding must not remove a node where the extent is a multiple of the spacing
        let nodes = |axis: usize| ((high[axis] - low[axis]) / spacing + 1e-9).floor();
        Self::checked(low, high, spacing, [0, 1, 2].map(nodes))
    }

    fn checked(low: [f64; 3], high: [f64; 3], spacing: f64, nodes: [f64; 3]) -> Result<Self> {
        let fits = nodes.iter().all(|n| *n >= 2.0) && nodes.iter().product::<f64>() <= MOST_NODES;
        if fits && (0..3).all(|axis| high[axis] > low[axis]) {
            return Ok(Self { low, high, dims: nodes.map(|n| n as usize), spacing });
        }
        Err(Error::new(ErrorKind::Input, "a grid does not fit its box")
            .found(format!("{nodes:?} nodes {spacing} m apart from {low:?} to {high:?} m"))
            .wanted(format!("at least 2 nodes along every axis, at most {MOST_NODES} in all"))
            .fix("choose another spacing, or a box whose lower corner is below the upper one"))
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    /// Whether there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Nodes per metre along each axis, as used by lookups: `(N − 1) / extent`.
    pub fn scale(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| (self.dims[axis] - 1) as f64 / (self.high[axis] - self.low[axis]))
    }

    /// Whether a point lies in the box or on its faces.
    #[inline(always)]
    pub fn contains(&self, x: [f64; 3]) -> bool {
        (0..3).all(|axis| self.low[axis] <= x[axis] && x[axis] <= self.high[axis])
    }

    /// Positions of the nodes \[m\], z fastest.
    pub fn nodes(&self) -> Vec<[f64; 3]> {
        let [nx, ny, nz] = self.dims;
        let along = |axis: usize, i: usize| {
            let (low, high, last) = (self.low[axis], self.high[axis], self.dims[axis] - 1);
            if i == last { high } else { low + (high - low) * i as f64 / last as f64 }
        };
        let node = |i: usize| [along(0, i / (ny * nz)), along(1, i / nz % ny), along(2, i % nz)];
        (0..nx * ny * nz).map(node).collect()
    }

    /// The grid in node coordinates: origin 0, spacing 1.
    fn numbers(&self) -> NodeGrid {
        NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: self.dims }
    }

    /// Trilinear lookup of values `[x, y, z, channels]` at points `[n, 3]` \[m\]: `[n, channels]`. Nodes outside count
    /// as 0. Differentiable in values and points.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when constants cannot be copied to the device.
    ///
    /// # Panics
    /// When the shapes do not fit.
    #[track_caller]
    pub fn lookup(&self, values: &Var, points: &Var) -> Result<Var> {
        Ok(values.grid_sample_3d(&self.numbered(points)?, self.numbers()))
    }

    /// Points \[m\] in node coordinates, `[n, 3]`.
    ///
    /// # Errors
    /// As [`DenseGrid::lookup`].
    pub fn numbered(&self, points: &Var) -> Result<Var> {
        let low = constant::numbers(points, self.low.to_vec(), [3])?;
        let scale = constant::numbers(points, self.scale().to_vec(), [3])?;
        Ok((points - &low) * &scale)
    }

    /// Values resampled at the nodes of another grid.
    ///
    /// # Errors
    /// As [`DenseGrid::lookup`].
    pub fn resampled(&self, values: &Var, onto: &Self) -> Result<Var> {
        let channels = values.dims()[3];
        let points = constant::points(values, &onto.nodes())?;
        Ok(self.lookup(values, &points)?.reshape([onto.dims[0], onto.dims[1], onto.dims[2], channels]))
    }

    /// The value of one channel `[x·y·z]` at a point \[m\]; nodes outside count as 0.
    #[inline(always)]
    pub(crate) fn at(&self, values: &[f64], scale: &[f64; 3], x: [f64; 3]) -> f64 {
        let mut base = [0isize; 3];
        let mut share = [0.0; 3];
        for axis in 0..3 {
            let place = (x[axis] - self.low[axis]) * scale[axis];
            let floor = place.floor();
            (base[axis], share[axis]) = (floor as isize, place - floor);
        }
        let [ny, nz] = [self.dims[1], self.dims[2]];
        if (0..3).all(|axis| base[axis] >= 0 && (base[axis] as usize) + 1 < self.dims[axis]) {
            let at = (base[0] as usize * ny + base[1] as usize) * nz + base[2] as usize;
            let line = |at: usize| values[at] + share[2] * (values[at + 1] - values[at]);
            let plane = |at: usize| {
                let (near, far) = (line(at), line(at + nz));
                near + share[1] * (far - near)
            };
            let (near, far) = (plane(at), plane(at + ny * nz));
            return near + share[0] * (far - near);
        }
        let inside = |i: isize, axis: usize| i >= 0 && (i as usize) < self.dims[axis];
        let mut sum = 0.0;
        for corner in 0..8usize {
            let far = [corner >> 2, corner >> 1 & 1, corner & 1];
            let node: [isize; 3] = std::array::from_fn(|axis| base[axis] + far[axis] as isize);
            if (0..3).all(|axis| inside(node[axis], axis)) {
                let weight: f64 =
                    (0..3).map(|axis| if far[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
                let flat = (node[0] as usize * ny + node[1] as usize) * nz + node[2] as usize;
                sum += weight * values[flat];
            }
        }
        sum
    }
}

/// Shift of raw densities at which an empty node has this opacity over unit length: `ln(1/(1 − α) − 1)`.
///
/// C. Sun, M. Sun, H.-T. Chen, "Direct Voxel Grid Optimization", CVPR 2022.
pub fn opacity_shift(opacity: f64) -> f64 {
    opacity.ln() - (-opacity).ln_1p()
}

/// One channel of values `[x, y, z, channels]` on the CPU, x slowest.
///
/// # Errors
/// [`ErrorKind::Device`] when a GPU tensor cannot be read back.
pub(crate) fn channel(values: &Tensor, channel: usize) -> Result<Vec<f64>> {
    let channels = values.dims()[values.dims().len() - 1];
    let all = values.to_vec()?;
    Ok(if channels == 1 { all } else { all.into_iter().skip(channel).step_by(channels).collect() })
}
