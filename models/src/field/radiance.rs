//! The voxel radiance field: raw density and features on a dense grid, colour from a small network.

use gradreel::optim::{Bound, Params};
use gradreel::{DType, Key, Result, Tape, Tensor, Var};

use super::{DenseGrid, Occupancy, dense};
use crate::constant;
use crate::layers::{Init, Perceptron, Scope, initialise};
use crate::render::Rays;

/// Sizes of a radiance field.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadianceSizes {
    /// Features per node.
    pub features: usize,
    /// Width of the colour network, which has two hidden layers.
    pub width: usize,
    /// Frequencies of the encoding of viewing directions.
    pub view_levels: usize,
}

impl Default for RadianceSizes {
    fn default() -> Self {
        Self { features: 12, width: 128, view_levels: 4 }
    }
}

/// A radiance field: its grid and how its values are interpreted. The values are in a [`Params`] store:
/// `radiance.density` `[x, y, z, 1]`, `radiance.features` `[x, y, z, features]` and the network's `radiance.colour.*`.
///
/// C. Sun, M. Sun, H.-T. Chen, "Direct Voxel Grid Optimization", CVPR 2022; X. Li and others, "PAC-NeRF", ICLR 2023.
#[derive(Debug, Clone, PartialEq)]
pub struct RadianceField {
    /// The grid of density and features.
    pub grid: DenseGrid,
    /// The spacing of the coarsest grid \[m\], the unit of length of raw densities.
    pub base_spacing: f64,
    /// Added to raw densities: `opacity_shift` of the initial opacity.
    pub shift: f64,
    /// Sizes.
    pub sizes: RadianceSizes,
}

impl RadianceField {
    /// A field on its coarsest grid; `opacity` is the initial opacity of a node over one unit of length.
    pub fn new(grid: DenseGrid, opacity: f64, sizes: RadianceSizes) -> Self {
        Self { base_spacing: grid.spacing, grid, shift: dense::opacity_shift(opacity), sizes }
    }

    /// Initial values: zero grids and a random network.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn initialise(&self, key: Key, dtype: DType) -> Result<Params> {
        let mut params = initialise(key, dtype, |scope| ColourNet::new(&scope.at("radiance.colour"), &self.sizes))?;
        let [x, y, z] = self.grid.dims;
        params.set("radiance.density", Tensor::zeros([x, y, z, 1], dtype));
        params.set("radiance.features", Tensor::zeros([x, y, z, self.sizes.features], dtype));
        Ok(params)
    }

    /// Density and features side by side, `[x, y, z, 1 + features]`.
    ///
    /// # Errors
    /// When the store holds no field.
    pub fn values(&self, bound: &Bound) -> Result<Var> {
        Ok(bound.get("radiance.density")?.concat(&[bound.get("radiance.features")?], 3))
    }

    /// The colour network.
    ///
    /// # Errors
    /// When the store holds no such network, or one of other sizes.
    pub fn colours(&self, bound: &Bound) -> Result<ColourNet> {
        ColourNet::new(&Scope::root(bound).at("radiance.colour"), &self.sizes)
    }

    /// The mask of the nodes that are opaque now, or adjacent to an opaque one.
    ///
    /// # Errors
    /// When the store holds no field.
    pub fn occupancy(&self, params: &Params, threshold: f64) -> Result<Occupancy> {
        let mut occupancy = Occupancy::full(self.grid.clone());
        occupancy.update(&dense::channel(params.get("radiance.density")?, 0)?, self.shift, threshold);
        Ok(occupancy)
    }

    /// One progressive refinement: the box shrinks to the opaque nodes, the spacing is halved, and both grids are
    /// resampled. Returns the new values and their mask, or `None` without changes when no node is opaque. The caller
    /// must reset the optimiser.
    ///
    /// # Errors
    /// When the store holds no field, or the finer grid has too many nodes.
    pub fn refined(&mut self, params: &Params, threshold: f64) -> Result<Option<(Params, Occupancy)>> {
        let Some([low, high]) = self.occupancy(params, threshold)?.bounds() else { return Ok(None) };
        let spacing = self.grid.spacing / 2.0;
        // a single layer of nodes keeps half a cell on either side
        let flat = |axis: usize| if high[axis] > low[axis] { 0.0 } else { spacing };
        let low = [0, 1, 2].map(|axis| low[axis] - flat(axis));
        let high = [0, 1, 2].map(|axis| high[axis] + flat(axis));
        let finer = DenseGrid::of_spacing(low, high, spacing)?;
        let tape = Tape::new();
        let mut refined = params.clone();
        for path in ["radiance.density", "radiance.features"] {
            let values = tape.constant(params.get(path)?.clone());
            refined.set(path, self.grid.resampled(&values, &finer)?.value()?.clone());
        }
        self.grid = finer;
        let occupancy = self.occupancy(&refined, threshold)?;
        Ok(Some((refined, occupancy)))
    }
}

/// The colour network: `[features, γ(direction)] → width → width → 3`, with ReLU between the layers and a logistic
/// function after the last.
pub struct ColourNet {
    layers: Perceptron,
    view_levels: usize,
}

impl ColourNet {
    /// The network at a scope, with layers `0`, `1` and `2`.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &RadianceSizes) -> Result<Self> {
        let inputs = sizes.features + 3 * (1 + 2 * sizes.view_levels);
        let layers = [("0", sizes.width), ("1", sizes.width), ("2", 3)];
        let last = Some([Init::FanIn(sizes.width), Init::Zeros]);
        Ok(Self { layers: Perceptron::ending_in(scope, inputs, &layers, last)?, view_levels: sizes.view_levels })
    }

    /// Colours `[n, 3]` in 0…1 from features `[n, features]`, each seen along its ray in `ray_of`.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn forward(&self, features: &Var, rays: &Rays, ray_of: Vec<u32>) -> Result<Var> {
        let views = constant::points(features, &rays.unit_directions())?.positional_encoding(self.view_levels);
        let views = views.index_select(&constant::indices(features, ray_of)?)?;
        Ok(self.layers.forward(&features.concat(&[&views], 1)).logistic())
    }
}
