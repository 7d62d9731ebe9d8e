//! The spatial-aware module of the paper (section III.A): a correction of the spatial volume that puts the object where the
//! input image shows it.
//!
//! ```text
//! noised views → encoder → epipolar attention → features in space G ─┐
//! spatial volume S ──────────────────────────────────────────────────┴→ φ (S + G) → 3D network → ΔS → S + ΔS
//! box in the input image → covered voxels → φ ∈ {ε, 1} ───────────────↗
//! ```
//!
//! The last convolution starts at zero: an untrained module changes nothing. All of the model itself stays as it is; its
//! depth-wise attention reads the corrected volume.

mod epipolar;
mod region;

use gradreel::{Error, ErrorKind, Result, Tensor, Var};
use serde::{Deserialize, Serialize};

pub use epipolar::{EpipolarAttention, EpipolarLines};

use self::epipolar::ALIGNED;
use self::region::NEAR;
use super::{Detection, EncoderSizes, Ring, SpatialNet, SpatialSizes, TargetEncoder, VolumeSizes, constant};
use crate::layers::{Convolution, GroupNorm, Kernel, Scope};

/// The sizes of the module. Its features are as many as the channels of the spatial volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialAwareSizes {
    /// Channels of an encoded view and of the features in space.
    pub features: usize,
    /// Heads of the epipolar attention.
    pub heads: usize,
    /// Samples of an epipolar line.
    pub samples: usize,
    /// Views attended to: how far round the ring from each view.
    pub neighbours: Vec<i64>,
    /// Frequencies of the encoding of a place on a line.
    pub octaves: usize,
    /// Channels of the 3D network's levels.
    pub widths: [usize; 4],
    /// ε: the weight of what lies outside the box.
    pub least: f64,
    /// How much wider than given the box is taken on every side, in shares of the image.
    pub margin: f64,
}

impl SpatialAwareSizes {
    /// For the published model.
    pub fn published() -> Self {
        Self {
            features: 64,
            heads: 4,
            samples: 32,
            neighbours: vec![-2, -1, 1, 2],
            octaves: 4,
            widths: [64, 64, 128, 128],
            least: 0.01,
            margin: 3.0 / 256.0,
        }
    }

    /// For a model with these volumes, in proportion to that for the published one.
    pub fn suiting(volume: &VolumeSizes) -> Self {
        let (features, samples) = (volume.spatial[0], volume.voxels);
        Self { features, samples, widths: [features, features, 2 * features, 2 * features], ..Self::published() }
    }

    /// Whether a module for a model with these volumes can be made.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the size that does not fit.
    pub fn check(&self, volume: &VolumeSizes) -> Result<()> {
        let by = |count: usize, divisor: usize| count > 0 && divisor > 0 && count.is_multiple_of(divisor);
        for (name, fits, found, wanted) in [
            ("features", self.features == volume.spatial[0], self.features, "the channels of the spatial volume"),
            ("features", by(self.features, 8), self.features, "a multiple of 8"),
            ("heads", by(self.features, self.heads), self.heads, "a divisor of the features"),
            ("samples", (2..=1 << 10).contains(&self.samples), self.samples, "2 to 1024"),
            ("octaves", (1..=16).contains(&self.octaves), self.octaves, "1 to 16"),
            ("neighbours", !self.neighbours.is_empty(), 0, "at least one"),
            ("widths", self.widths.iter().all(|width| by(*width, 8)), self.widths[0], "multiples of 8"),
            (
                "least or margin",
                (0.0..=1.0).contains(&self.least) && (0.0..=1.0).contains(&self.margin),
                0,
                "0 to 1 each",
            ),
        ] {
            if !fits {
                return Err(Error::new(ErrorKind::Input, "no spatial-aware module can be made of these sizes")
                    .at(format!("denoiser.spatial_aware.{name}"))
                    .found(found)
                    .wanted(wanted)
                    .fix("correct the sizes"));
            }
        }
        Ok(())
    }
}

/// What the module is given beside the volume that it corrects.
pub struct Surroundings<'a> {
    /// All noised views `[b, views, latent, w, w]`.
    pub noised: &'a Var,
    /// Time vectors `[b, time]`.
    pub time: &'a Var,
    /// Viewpoints `[b, views, 4]`.
    pub viewpoints: &'a Var,
    /// Elevations of the input cameras in radians.
    pub elevations: &'a [f64],
    /// Where the objects are: one for each of the batch, or none at all. A sample without is weighed alike everywhere.
    pub boxes: &'a [Option<Detection>],
}

/// The module (`spatial_aware`).
pub struct SpatialAware {
    encoder: TargetEncoder,
    attention: EpipolarAttention,
    net: SpatialNet,
    norm: GroupNorm,
    out: Convolution,
    sizes: SpatialAwareSizes,
    ring: Ring,
    latent: usize,
    time: usize,
}

impl SpatialAware {
    /// Builds the module from the weights at a scope, for a model with these cameras and volumes.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &SpatialAwareSizes, volume: &VolumeSizes, ring: &Ring) -> Result<Self> {
        let SpatialAwareSizes { features, widths, .. } = *sizes;
        let VolumeSizes { latent, time, .. } = *volume;
        let encoder = EncoderSizes { inputs: latent, width: features, outputs: features, time, view: 4 };
        Ok(Self {
            encoder: TargetEncoder::new(&scope.at("encoder"), encoder)?,
            attention: EpipolarAttention::new(&scope.at("epipolar"), sizes)?,
            net: SpatialNet::new(&scope.at("net"), SpatialSizes { inputs: features, widths, time })?,
            norm: GroupNorm::new(&scope.at("norm"), 8, widths[0], 1e-5)?,
            out: Convolution::new(&scope.at("out"), Kernel::volume(widths[0], features, 1).zeros())?,
            sizes: sizes.clone(),
            ring: ring.clone(),
            latent,
            time,
        })
    }

    /// A spatial volume `[b, features, v, v, v]` with the object where the box is.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a box that is none; when places cannot be moved to the device of the views.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the module.
    #[track_caller]
    pub fn correct(&self, volume: &Var, given: &Surroundings<'_>) -> Result<Var> {
        let [batch, views, _, height, width] = given.noised.dims()[..] else {
            panic!("noised views are [b, views, c, h, w], not {}", given.noised.shape())
        };
        let all = batch * views;
        let times = given.time.reshape([batch, 1, self.time]).broadcast_to([batch, views, self.time]);
        let maps = self.encoder.forward(
            &given.noised.reshape([all, self.latent, height, width]),
            &times.reshape([all, self.time]),
            &given.viewpoints.reshape([all, 4]),
        );
        let maps = maps.reshape([batch, views, self.sizes.features, height, width]);
        let maps = self.attention.forward(&self.ring, &maps)?;
        let combined = combine(&self.ring, &self.sizes, volume, &maps, given.elevations, given.boxes)?;
        let found = self.net.forward(&combined, given.time)?;
        Ok(volume + &self.out.forward(&self.norm.silu(&found)))
    }
}

/// What the 3D network sees: `φ (S + G)`, with the spatial volumes `S [b, f, v, v, v]` and the features of the views
/// `[b, views, f, w, w]` gathered in space as `G`.
///
/// # Errors
/// [`ErrorKind::Input`] for a box that is none; when places cannot be moved to the device of the features.
///
/// # Panics
/// If the shapes do not fit.
#[track_caller]
pub fn combine(
    ring: &Ring,
    sizes: &SpatialAwareSizes,
    volume: &Var,
    maps: &Var,
    elevations: &[f64],
    boxes: &[Option<Detection>],
) -> Result<Var> {
    let (batch, size) = (volume.dims()[0], volume.dims()[4]);
    assert!(boxes.is_empty() || boxes.len() == batch, "one box for each of the batch");
    boxes.iter().flatten().try_for_each(Detection::check)?;
    let gathered = gather(ring, maps, size)?;
    let sum = volume + &gathered;
    if boxes.iter().all(Option::is_none) {
        return Ok(sum);
    }
    let of = |sample: usize| {
        region::weights(ring, size, boxes[sample].as_ref(), elevations[sample], [sizes.margin, sizes.least])
    };
    let weights: Vec<f64> = (0..batch).flat_map(of).collect();
    Ok(&sum * &constant(volume, Tensor::from_vec(weights, [batch, 1, size, size, size]))?)
}

/// Features of the views `[b, views, f, w, w]` in space: each voxel gets the mean of what the views that see it have where
/// it falls, `[b, f, size, size, size]`.
///
/// # Errors
/// When places cannot be moved to the device of the features.
///
/// # Panics
/// If the features have not five axes.
#[track_caller]
pub fn gather(ring: &Ring, maps: &Var, size: usize) -> Result<Var> {
    let [batch, views, channels, height, width] = maps.dims()[..] else {
        panic!("features are [b, views, f, w, w], not {}", maps.shape())
    };
    let (voxels, last) = (size * size * size, (width - 1) as f64);
    let projected = |view: usize| {
        let pose = ring.pose(view);
        ring.voxels(size).map(move |voxel| ring.project(&pose, voxel, width)).collect::<Vec<_>>()
    };
    let all: Vec<Vec<[f64; 3]>> = (0..views).map(projected).collect();
    let sees = |view: usize, voxel: usize| {
        let [u, v, depth] = all[view][voxel];
        depth > NEAR && (0.0..=last).contains(&u) && (0.0..=last).contains(&v)
    };
    let counts: Vec<usize> = (0..voxels).map(|voxel| (0..views).filter(|&view| sees(view, voxel)).count()).collect();
    let mut total: Option<Var> = None;
    for (view, projected) in all.iter().enumerate() {
        let places: Vec<f64> = places_in(projected.iter().map(|[u, v, _]| [*u, *v]), width).collect();
        let share = |voxel: usize| if sees(view, voxel) { 1.0 / counts[voxel] as f64 } else { 0.0 };
        let places = constant(maps, Tensor::from_vec(places, [1, voxels, 1, 2]))?.broadcast_to([batch, voxels, 1, 2]);
        let shares = constant(maps, Tensor::from_vec((0..voxels).map(share).collect::<Vec<f64>>(), [1, 1, voxels, 1]))?;
        let sampled = maps.select(1, view).reshape([batch, channels, height, width]).grid_sample(&places, ALIGNED);
        let part = &sampled.reshape([batch, channels, voxels, 1]) * &shares;
        total = Some(total.map_or(part.clone(), |sum| &sum + &part));
    }
    Ok(total.expect("there are views").reshape([batch, channels, size, size, size]))
}

/// Cells of a map as places in −1..1 with aligned corners.
fn places_in(cells: impl Iterator<Item = [f64; 2]>, width: usize) -> impl Iterator<Item = f64> {
    let middle = (width - 1) as f64 / 2.0;
    cells.flat_map(move |[u, v]| [u / middle - 1.0, v / middle - 1.0])
}
