//! The normalised splat: averages of particle features at the nodes of a grid.

use gradreel::ops::NodeGrid;
use gradreel::{Error, ErrorKind, Result, Var};

use crate::constant;
use crate::field::DenseGrid;
use crate::render::splat::cover;

/// Settings of the normalised splat.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FeatureSplat {
    /// Nodes with a summed weight up to this are empty. The position derivatives of nodes touched only by the tail of a
    /// particle are of the order of its inverse; 1e-3 limits them.
    pub least_weight: f64,
    /// The value of every channel of an empty node.
    pub empty: f64,
}

impl Default for FeatureSplat {
    fn default() -> Self {
        Self { least_weight: 1e-10, empty: -100.0 }
    }
}

/// Features on a grid that follows the particles.
#[derive(Debug, Clone)]
pub struct FeatureGrid {
    /// Averages, `[x, y, z, channels]`.
    pub values: Var,
    /// Summed weights, `[x, y, z, 1]`.
    pub weight: Var,
    /// The bounding box of the non-empty nodes; its corners are multiples of the spacing.
    pub grid: DenseGrid,
    /// The index of its first node, relative to the world's origin.
    pub first: [i64; 3],
}

/// Averages the features `[n, channels]` of particles at `[n, 3]` \[m\] at the nodes `i · spacing`: `Σ w f / Σ w` with
/// trilinear weights, in the tight box around the nodes whose `Σ w` exceeds the threshold.
///
/// X. Li and others, "PAC-NeRF: Physics Augmented Continuum Neural Radiance Fields", ICLR 2023.
///
/// # Errors
/// [`ErrorKind::NonFinite`] for a non-finite position; [`ErrorKind::Physics`] when the particles spread over too many
/// nodes; [`ErrorKind::Input`] without particles.
pub fn splat_features(positions: &Var, features: &Var, spacing: f64, settings: &FeatureSplat) -> Result<FeatureGrid> {
    let (first, dims) = tight(positions, spacing, settings.least_weight)?;
    let node_grid = NodeGrid { origin: first.map(|i| i as f64 * spacing), spacing, dims };
    let count = features.dims()[0];
    let channels = features.dims()[1];
    let ones = constant::numbers(features, vec![1.0; count], [count, 1])?;
    let sums = features.concat(&[&ones], 1).grid_scatter_3d(positions, node_grid);
    let (sum, weight) = (sums.slice(3, 0..channels), sums.slice(3, channels..channels + 1));
    let least = constant::numbers(features, vec![settings.least_weight], [1])?;
    let empty = constant::numbers(features, vec![settings.empty], [1])?;
    // the quotient of an empty node is not used, but its divisor must not be 0
    let values = weight.gt(&least).choose(&(&sum / &weight.maximum(&least)), &empty);
    let high = [0, 1, 2].map(|axis| spacing * (first[axis] + dims[axis] as i64 - 1) as f64);
    let grid = DenseGrid { low: first.map(|i| spacing * i as f64), high, dims, spacing };
    Ok(FeatureGrid { values, weight, grid, first })
}

/// First node and size of the tight box around the nodes with more than this summed weight.
fn tight(positions: &Var, spacing: f64, least: f64) -> Result<([i64; 3], [usize; 3])> {
    let outer = cover(positions, spacing)?;
    let corner = outer.origin.map(|x| (x / spacing).round());
    let [_, ny, nz] = outer.dims;
    let mut weights = vec![0.0; outer.len()];
    for x in positions.value()?.to_vec()?.as_chunks::<3>().0 {
        let place = [0, 1, 2].map(|axis| x[axis] / spacing);
        let share = place.map(|p| p - p.floor());
        let base = [0, 1, 2].map(|axis| (place[axis].floor() - corner[axis]) as usize);
        for far in 0..8usize {
            let far = [far >> 2, far >> 1 & 1, far & 1];
            let weight: f64 = (0..3).map(|a| if far[a] == 1 { share[a] } else { 1.0 - share[a] }).product();
            weights[((base[0] + far[0]) * ny + base[1] + far[1]) * nz + base[2] + far[2]] += weight;
        }
    }
    let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
    for (i, _) in weights.iter().enumerate().filter(|(_, weight)| **weight > least) {
        let node = [i / (ny * nz), i / nz % ny, i % nz];
        (low, high) = ([0, 1, 2].map(|a| low[a].min(node[a])), [0, 1, 2].map(|a| high[a].max(node[a])));
    }
    if low[0] == usize::MAX {
        return Err(Error::new(ErrorKind::Input, "there are no particles to be rendered")
            .fix("check the density of the field that they come from"));
    }
    let first = [0, 1, 2].map(|axis| low[axis] as i64 + corner[axis] as i64);
    // a lookup needs two nodes along every axis
    Ok((first, [0, 1, 2].map(|axis| (high[axis] - low[axis] + 1).max(2))))
}
