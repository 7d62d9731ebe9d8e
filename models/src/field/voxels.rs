//! The voxels of a field, with their opacity and colour.

use gradreel::ops::NodeGrid;
use gradreel::optim::{Bound, Params};
use gradreel::{DType, Result, Tape, Tensor, Var};
use ndarray::Array2;

use crate::field::{Hull, place};
use crate::video::Clip;

/// Raw density and raw colour at the voxels of a hull. The values are in a [`Params`] store under `field.density`
/// `[voxels, 1]` and `field.colour` `[voxels, 3]`.
///
/// Opacity and colour are the logistic function of the raw values.
#[derive(Debug, Clone)]
pub struct Field {
    /// The grid of the voxels; its spacing is the particle spacing \[m\].
    pub node_grid: NodeGrid,
    /// Flat indices of the voxels on the grid, increasing.
    pub voxels: Vec<u32>,
}

/// Initial raw density of a voxel of the hull: opacity 0.98.
pub(super) const FILLED: f64 = 4.0;

impl Field {
    /// A field that fills a hull with the mean colour of the object, and its raw values.
    pub fn filling(hull: Hull, clip: &Clip) -> (Self, Params) {
        let count = hull.voxels.len();
        let mean = mean_colour(clip).map(|c| (c.clamp(0.02, 0.98) / (1.0 - c.clamp(0.02, 0.98))).ln() as f32);
        let mut params = Params::new();
        params.set("field.density", Tensor::full(FILLED, [count, 1], DType::F32));
        params.set("field.colour", Tensor::from_vec(mean.repeat(count), [count, 3]));
        (Self { node_grid: hull.node_grid, voxels: hull.voxels }, params)
    }

    /// Keeps the voxels of at least this opacity, with their raw values.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when the store holds no field.
    pub fn pruned(&self, params: &Params, least: f64) -> Result<(Self, Params)> {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let opacity = self.opacity(&bound)?.value()?.to_vec()?;
        self.chosen(params, &|voxel| opacity[voxel] >= least)
    }

    /// Keeps some voxels, by their places in [`Field::voxels`], with their raw values.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when the store holds no field.
    pub fn chosen(&self, params: &Params, keeps: &dyn Fn(usize) -> bool) -> Result<(Self, Params)> {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let kept: Vec<u32> = (0..self.len() as u32).filter(|&i| keeps(i as usize)).collect();
        let voxels = kept.iter().map(|&i| self.voxels[i as usize]).collect();
        let rows = tape.constant(Tensor::from_vec(kept.clone(), [kept.len()]));
        let mut pruned = Params::new();
        for path in ["field.density", "field.colour"] {
            pruned.set(path, bound.get(path)?.index_select(&rows)?.value()?.clone());
        }
        Ok((Self { node_grid: self.node_grid, voxels }, pruned))
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// Whether there are no voxels.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// Centres of the voxels \[m\], `[voxels, 3]`.
    pub fn centres(&self) -> Array2<f64> {
        Array2::from_shape_fn((self.len(), 3), |(i, axis)| place(&self.node_grid, self.voxels[i] as usize)[axis])
    }

    /// Opacity of the voxels, `[voxels, 1]` in 0…1.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when the store holds no field.
    pub fn opacity(&self, bound: &Bound) -> Result<Var> {
        Ok(bound.get("field.density")?.logistic())
    }

    /// Colour of the voxels, `[voxels, 3]` in 0…1.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] when the store holds no field.
    pub fn colour(&self, bound: &Bound) -> Result<Var> {
        Ok(bound.get("field.colour")?.logistic())
    }
}

/// The mean colour of the object over all views of the first frame.
pub(crate) fn mean_colour(clip: &Clip) -> [f64; 3] {
    let (mut sum, mut mass) = ([0.0; 3], 0.0);
    for frames in &clip.frames {
        let frame = &frames[0];
        for ((row, column), _) in frame.alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.9) {
            (0..3).for_each(|c| sum[c] += f64::from(frame.rgb[[row, column, c]]));
            mass += 1.0;
        }
    }
    if mass == 0.0 { [0.5; 3] } else { sum.map(|s| s / mass) }
}
