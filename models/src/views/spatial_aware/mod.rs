//! The spatial-aware module of the paper (section III.A): a correction of the spatial volume that aligns the object
//! with the input image.
//!
//! ```text
//! noised views → encoder → epipolar attention → features in space G ─┐
//! spatial volume S ──────────────────────────────────────────────────┴→ φ (S + G) → 3D network → ΔS → S + ΔS
//! box in the input image → covered voxels → φ ∈ {ε, 1} ───────────────↗
//! ```
//!
//! The last convolution is initialised to zero, so that an untrained module changes nothing. The model itself is
//! not changed; its depth-wise attention reads the corrected volume.

pub(super) mod epipolar;
mod region;

use gradreel::{Error, ErrorKind, Result, Tensor, Var};
use serde::{Deserialize, Serialize};

use self::epipolar::{ALIGNED, EpipolarAttention};
use self::region::NEAR;
use super::{Detection, EncoderSizes, Ring, SpatialNet, SpatialSizes, TargetEncoder, VolumeSizes, constant};
use crate::layers::{Convolution, GroupNorm, Kernel, Scope};

/// Sizes of the module. The number of features equals the channels of the spatial volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialAwareSizes {
    /// Channels of an encoded view and of the gathered features.
    pub features: usize,
    /// Heads of the epipolar attention.
    pub heads: usize,
    /// Samples per epipolar line.
    pub samples: usize,
    /// Attended views, as offsets around the ring.
    pub neighbours: Vec<i64>,
    /// Frequencies of the positional encoding along a line.
    pub octaves: usize,
    /// Channels of the 3D network's levels.
    pub widths: [usize; 4],
    /// ε: the weight outside the box.
    pub least: f64,
    /// Margin added to every side of the box, as a share of the image.
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

    /// For a model with these volumes, scaled from the published sizes.
    pub fn suiting(volume: &VolumeSizes) -> Self {
        let (features, samples) = (volume.spatial[0], volume.voxels);
        Self { features, samples, widths: [features, features, 2 * features, 2 * features], ..Self::published() }
    }

    /// Checks that the module fits a model with these volumes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the size that does not fit.
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

/// Inputs of the module besides the volume that it corrects.
pub struct Surroundings<'a> {
    /// All noised views `[b, views, latent, w, w]`.
    pub noised: &'a Var,
    /// Time vectors `[b, time]`.
    pub time: &'a Var,
    /// Viewpoints `[b, views, 4]`.
    pub viewpoints: &'a Var,
    /// Elevations of the input cameras in radians.
    pub elevations: &'a [f64],
    /// Detections: one per sample, or none at all. Without one, all voxels of a sample have equal weight.
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

    /// Corrects a spatial volume `[b, features, v, v, v]` such that the object lies in the box.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an invalid box; if positions cannot be moved to the views' device.
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

/// Input of the 3D network: `φ (S + G)`, where `S` are the spatial volumes `[b, f, v, v, v]` and `G` is gathered
/// from the view features `[b, views, f, w, w]`.
///
/// # Errors
/// [`ErrorKind::Input`] for an invalid box; if positions cannot be moved to the features' device.
///
/// # Panics
/// If the shapes do not match.
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

/// Gathers view features `[b, views, f, w, w]` in space: each voxel gets the mean of the features at its
/// projections into the views that see it, `[b, f, size, size, size]`.
///
/// # Errors
/// If positions cannot be moved to the features' device.
///
/// # Panics
/// If the features do not have five axes.
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

/// Cells of a map as positions in −1..1 with aligned corners.
fn places_in(cells: impl Iterator<Item = [f64; 2]>, width: usize) -> impl Iterator<Item = f64> {
    let middle = (width - 1) as f64 / 2.0;
    cells.flat_map(move |[u, v]| [u / middle - 1.0, v / middle - 1.0])
}
