//! From noised views to the frustum volumes of one view: encoder, un-projection, spatial net, frustum net.

use gradreel::ops::{GridSampling, Interpolation, Padding};
use gradreel::{Result, Tensor, Var};
use serde::{Deserialize, Serialize};

use super::{EncoderSizes, FrustumNet, FrustumSizes, Ring, SpatialNet, SpatialSizes, TargetEncoder, constant};
use crate::layers::Scope;

/// Coordinates −1 and 1 are the centres of the first and the last cell.
const ALIGNED: GridSampling =
    GridSampling { interpolation: Interpolation::Linear, padding: Padding::Zeros, align_corners: true };

/// The sizes of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeSizes {
    /// Channels of a latent.
    pub latent: usize,
    /// Channels of an encoded view.
    pub features: usize,
    /// Channels of the time vector.
    pub time: usize,
    /// Channels of the spatial net's levels.
    pub spatial: [usize; 4],
    /// Channels of the frustum net's levels.
    pub frustum: [usize; 4],
    /// Voxels along a side of the spatial volume.
    pub voxels: usize,
    /// Depth samples of a frustum.
    pub depth: usize,
    /// Whether the input image is un-projected together with the noised views. In the published model it only
    /// enters the UNet.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub input: bool,
}

impl VolumeSizes {
    /// The published model.
    pub const PUBLISHED: Self = Self {
        latent: 4,
        features: 16,
        time: 256,
        spatial: [64, 128, 256, 512],
        frustum: [64, 128, 256, 512],
        voxels: 32,
        depth: 48,
        input: false,
    };
}

/// The volume path of the model (`spatial_volume`).
pub struct VolumePath {
    ring: Ring,
    sizes: VolumeSizes,
    encoder: TargetEncoder,
    input: Option<TargetEncoder>,
    spatial: SpatialNet,
    frustum: FrustumNet,
}

impl VolumePath {
    /// Builds the path from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: VolumeSizes, ring: Ring) -> Result<Self> {
        let VolumeSizes { latent, features, time, spatial, frustum, .. } = sizes;
        let encoder = EncoderSizes { inputs: latent, width: 16, outputs: features, time, view: 4 };
        let seen = ring.views + usize::from(sizes.input);
        let net = SpatialSizes { inputs: seen * features, widths: spatial, time };
        let pyramid = FrustumSizes { inputs: spatial[0], widths: frustum, time, view: 4 };
        Ok(Self {
            encoder: TargetEncoder::new(&scope.at("target_encoder"), encoder)?,
            input: sizes.input.then(|| TargetEncoder::new(&scope.at("input_encoder"), encoder)).transpose()?,
            spatial: SpatialNet::new(&scope.at("spatial_volume_feats"), net)?,
            frustum: FrustumNet::new(&scope.at("frustum_volume_feats"), pyramid)?,
            ring,
            sizes,
        })
    }

    /// The cameras of the path.
    pub fn ring(&self) -> &Ring {
        &self.ring
    }

    /// Viewpoint embeddings of all views for input images of these elevations in radians: `[b, views, 4]`, on the
    /// tape and device and in the dtype of `like`.
    ///
    /// # Errors
    /// If they cannot be moved there.
    pub fn viewpoints(&self, like: &Var, elevations: &[f64]) -> Result<Var> {
        let views = self.ring.views;
        let of =
            |elevation: &f64| (0..views).flat_map(|view| self.ring.viewpoint(view, *elevation)).collect::<Vec<_>>();
        let values: Vec<f64> = elevations.iter().flat_map(of).collect();
        constant(like, Tensor::from_vec(values, [elevations.len(), views, 4]))
    }

    /// Un-projects all noised views `[b, views, latent, w, w]`, given time vectors `[b, time]` and viewpoints
    /// `[b, views, 4]`, into a volume `[b, views · features, v, v, v]`.
    ///
    /// # Errors
    /// If the sampling positions cannot be cast.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the path.
    #[track_caller]
    pub fn unproject(&self, noised: &Var, time: &Var, viewpoints: &Var) -> Result<Var> {
        let [batch, views, latent, height, width] = noised.dims()[..] else {
            panic!("noised views are [b, views, c, h, w], not {}", noised.shape())
        };
        let (v, features) = (self.sizes.voxels, self.sizes.features);
        let all = batch * views;
        let times = time.reshape([batch, 1, self.sizes.time]).broadcast_to([batch, views, self.sizes.time]);
        let maps = self.encoder.forward(
            &noised.reshape([all, latent, height, width]),
            &times.reshape([all, self.sizes.time]),
            &viewpoints.reshape([all, 4]),
        );
        let places: Vec<f64> = (0..views).flat_map(|view| self.places(&self.ring.pose(view), width)).collect();
        let places = constant(noised, Tensor::from_vec(places, [views, v * v * v, 1, 2]))?;
        let places = places.reshape([1, views, v * v * v, 1, 2]).broadcast_to([batch, views, v * v * v, 1, 2]);
        let sampled = maps.grid_sample(&places.reshape([all, v * v * v, 1, 2]), ALIGNED);
        Ok(sampled.reshape([batch, views * features, v, v, v]))
    }

    /// Un-projects the input latents `[b, latent, w, w]`, whose cameras are at azimuth 0 and these elevations in
    /// radians, into a volume `[b, features, v, v, v]`; `None` if the path has no encoder for them.
    ///
    /// # Errors
    /// If the sampling positions cannot be cast.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the path.
    #[track_caller]
    pub fn unproject_input(&self, latents: &Var, time: &Var, elevations: &[f64]) -> Result<Option<Var>> {
        let Some(encoder) = &self.input else { return Ok(None) };
        let (v, features) = (self.sizes.voxels, self.sizes.features);
        let (batch, width) = (elevations.len(), *latents.dims().last().expect("latents are [b, c, h, w]"));
        let viewpoints = elevations.iter().flat_map(|elevation| [elevation - self.ring.elevation, 0.0, 1.0, 0.0]);
        let viewpoints = constant(latents, Tensor::from_vec(viewpoints.collect::<Vec<f64>>(), [batch, 4]))?;
        let maps = encoder.forward(latents, time, &viewpoints);
        let places = elevations.iter().flat_map(|elevation| self.places(&self.ring.input_pose(*elevation), width));
        let places = constant(latents, Tensor::from_vec(places.collect::<Vec<f64>>(), [batch, v * v * v, 1, 2]))?;
        Ok(Some(maps.grid_sample(&places, ALIGNED).reshape([batch, features, v, v, v])))
    }

    /// Projections of the voxels onto a camera's map, in −1..1 with aligned corners.
    fn places(&self, pose: &[[f64; 4]; 3], width: usize) -> Vec<f64> {
        let unit = |cell: f64| cell / ((width - 1) as f64 / 2.0) - 1.0;
        let voxels = self.ring.voxels(self.sizes.voxels);
        voxels
            .flat_map(|point| {
                let [u, v, _] = self.ring.project(pose, point, width);
                [unit(u), unit(v)]
            })
            .collect()
    }

    /// Un-projected volume and time vectors to the spatial volume `[b, spatial[0], v, v, v]`.
    ///
    /// # Errors
    /// As [`crate::layers::Segment::run`].
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the path.
    #[track_caller]
    pub fn spatial_volume(&self, unprojected: &Var, time: &Var) -> Result<Var> {
        self.spatial.forward(unprojected, time)
    }

    /// Samples the spatial volume of one sample `[1, c, v, v, v]` in some views' frustums:
    /// `[views.len(), c, depth, w, w]`.
    ///
    /// # Errors
    /// If the sampling positions cannot be cast.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the path, or a view does not exist.
    #[track_caller]
    pub fn frustum_samples(&self, volume: &Var, views: &[usize], width: usize) -> Result<Var> {
        let depth = self.sizes.depth;
        let half = self.ring.half;
        let places: Vec<f64> = views
            .iter()
            .flat_map(|&view| self.ring.frustum(view, depth, width))
            .flat_map(|point| point.map(|x| x / half))
            .collect();
        let places = constant(volume, Tensor::from_vec(places, [1, views.len() * depth, width, width, 3]))?;
        let sampled = volume.grid_sample(&places, ALIGNED);
        let channels = sampled.dims()[1];
        let sampled = sampled.reshape([channels, views.len(), depth, width, width]);
        Ok(sampled.permute(&[1, 0, 2, 3, 4]))
    }

    /// Frustum samples `[n, c, depth, w, w]`, time vectors `[n, time]` and viewpoints `[n, 4]` to the pyramid,
    /// finest first.
    ///
    /// # Errors
    /// As [`crate::layers::Segment::run`].
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the path.
    #[track_caller]
    pub fn pyramid(&self, samples: &Var, time: &Var, viewpoints: &Var) -> Result<[Var; 4]> {
        self.frustum.forward(samples, time, viewpoints)
    }
}
