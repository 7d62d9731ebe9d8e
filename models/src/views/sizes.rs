//! Reading, writing and validating the model sizes stored in a weights file.

use gradreel::{Error, ErrorKind, Result};

use super::{AutoencoderSizes, ClipSizes, Coding, DenoiserSizes, ModelSizes, Output, Patches, Ring, SpatialAwareSizes};
use super::{SamplerSettings, UnetSizes, VolumeSizes};

/// Maximum accepted size.
const MOST: usize = 1 << 16;

impl ModelSizes {
    /// Metadata key of the model sizes in a safetensors file.
    pub const METADATA: &str = "gradreel.sizes";

    /// The sizes as JSON.
    ///
    /// ```
    /// use gradreel_models::views::ModelSizes;
    /// let sizes = ModelSizes::published();
    /// assert_eq!(ModelSizes::from_json(&sizes.to_json())?.image, 256);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("sizes are plain numbers")
    }

    /// Reads what [`ModelSizes::to_json`] writes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for invalid text or invalid sizes.
    pub fn from_json(text: &str) -> Result<Self> {
        let sizes: Self = serde_json::from_str(text).map_err(|e| {
            Error::new(ErrorKind::Input, "cannot read the sizes of a model")
                .found(e)
                .wanted(format!("JSON such as {}", Self::published().to_json()))
                .fix(
                    "write the file again with the metadata of ModelSizes::to_json, or without for the published sizes",
                )
        })?;
        sizes.check()?;
        Ok(sizes)
    }

    /// Pixels along a side of a latent.
    pub fn latent_width(&self) -> usize {
        self.image / self.autoencoder.factor().max(1)
    }

    /// Default sampler settings: 50 steps with guidance 2 for the published model; a dozen steps without guidance
    /// for one that predicts clean latents. Such a model places the object in the first steps; each further step
    /// adds noise that shrinks it.
    pub fn sampler(&self) -> SamplerSettings {
        match self.denoiser.output {
            Output::Noise => SamplerSettings::default(),
            Output::Clean => SamplerSettings { steps: 12, guidance: 1.0, ..SamplerSettings::default() },
        }
    }

    /// A model of 64² pixels that can be trained and run on a CPU: pixel patches instead of an autoencoder, no CLIP
    /// tower, and a spatial-aware module. The cameras are the published ones.
    pub fn small() -> Self {
        let (volumes, channels) = ([32, 32, 48, 48], 48);
        let volume = VolumeSizes {
            latent: channels,
            features: 8,
            time: 64,
            spatial: volumes,
            frustum: volumes,
            voxels: 16,
            depth: 16,
            input: false,
        };
        let unet = UnetSizes {
            inputs: 2 * channels,
            outputs: channels,
            base: 32,
            multipliers: [2, 2, 3, 3],
            heads: 4,
            context: 32,
            volumes,
        };
        let spatial_aware = Some(SpatialAwareSizes::suiting(&volume));
        Self {
            image: 64,
            crop: 128,
            autoencoder: Coding::Patches(Patches { patch: 4, scale: 0.2 }),
            clip: None,
            denoiser: DenoiserSizes { ring: Ring::published(16), unet, volume, spatial_aware, output: Output::Clean },
        }
    }

    /// Validates the sizes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the invalid size and the reason.
    pub fn check(&self) -> Result<()> {
        let Self { image, crop, denoiser, autoencoder, clip } = self;
        let (ring, unet, volume) = (&denoiser.ring, &denoiser.unet, &denoiser.volume);
        let mut counts: Vec<(&str, usize)> = vec![
            ("image", *image),
            ("denoiser.ring.views", ring.views),
            ("denoiser.unet.base", unet.base),
            ("denoiser.unet.heads", unet.heads),
            ("denoiser.unet.context", unet.context),
            ("denoiser.volume.latent", volume.latent),
            ("denoiser.volume.features", volume.features),
            ("denoiser.volume.time", volume.time),
            ("denoiser.volume.voxels", volume.voxels),
            ("denoiser.volume.depth", volume.depth),
        ];
        // group normalisation uses 32 groups in the UNet and the autoencoder, 8 on the volume path
        let mut groups: Vec<(&str, Vec<usize>, usize)> = vec![
            ("denoiser.unet.base", vec![unet.base], 32),
            ("denoiser.volume.spatial", volume.spatial.to_vec(), 8),
            ("denoiser.volume.frustum", volume.frustum.to_vec(), 8),
        ];
        counts.extend(unet.multipliers.iter().map(|m| ("denoiser.unet.multipliers", *m)));
        counts.extend(volume.spatial.iter().map(|c| ("denoiser.volume.spatial", *c)));
        counts.extend(volume.frustum.iter().map(|c| ("denoiser.volume.frustum", *c)));
        match autoencoder {
            Coding::Patches(Patches { patch, .. }) => counts.push(("autoencoder.patch", *patch)),
            Coding::Learned(AutoencoderSizes { base, multipliers, blocks, .. }) => {
                groups.push(("autoencoder.base", vec![*base], 32));
                counts.push(("autoencoder.base", *base));
                counts.push(("autoencoder.blocks", *blocks));
                counts.push(("autoencoder.multipliers", multipliers.len()));
                counts.extend(multipliers.iter().map(|m| ("autoencoder.multipliers", *m)));
            }
        }
        if let Some(ClipSizes { resolution, patch, width, heads, .. }) = *clip {
            let sizes = [resolution, patch, width, heads];
            counts.extend(["clip.resolution", "clip.patch", "clip.width", "clip.heads"].into_iter().zip(sizes));
        }
        if let Some((name, count)) = counts.into_iter().find(|(_, count)| *count == 0 || *count > MOST) {
            return refuse(name, count.to_string(), "1 to 65536");
        }
        let halved = vec![volume.voxels, volume.depth, self.latent_width()];
        groups.push(("denoiser.volume.voxels, its depth or the latent width", halved, 8));
        for (name, sizes, divisor) in groups {
            if let Some(size) = sizes.iter().find(|size| **size == 0 || !size.is_multiple_of(divisor)) {
                return refuse(name, size.to_string(), &format!("a multiple of {divisor}"));
            }
        }
        let deep = unet.multipliers.map(|m| m * unet.base);
        let finite = [ring.elevation, ring.distance, ring.focal, ring.half].iter().all(|v| v.is_finite());
        let around = ring.distance > 3f64.sqrt() * ring.half && ring.focal > 0.0 && ring.half > 0.0;
        let channels = autoencoder.channels();
        for (name, fits, found, wanted) in [
            (
                "autoencoder.scale",
                autoencoder.scale() > 0.0 && autoencoder.scale().is_finite(),
                autoencoder.scale().to_string(),
                "a positive number",
            ),
            ("crop", *crop <= 256, crop.to_string(), "0 to 256 pixels of 256"),
            (
                "image",
                image.is_multiple_of(autoencoder.factor()),
                format!("{image}"),
                "a size that the autoencoder can halve, or whole patches",
            ),
            (
                "denoiser.unet.heads",
                deep.iter().all(|c| c.is_multiple_of(unet.heads)),
                format!("{} heads for {deep:?} channels", unet.heads),
                "a divisor of the channels of every level",
            ),
            ("denoiser.unet.volumes", unet.volumes == volume.frustum, format!("{:?}", unet.volumes), "the frustum's"),
            (
                "denoiser.unet.inputs",
                [unet.inputs, unet.outputs, channels] == [2 * volume.latent, volume.latent, volume.latent],
                format!("{} of {} latent channels", unet.inputs, volume.latent),
                "noised and input latent side by side, of the autoencoder's channels",
            ),
            (
                "clip",
                clip.is_none_or(|clip| {
                    let whole = clip.resolution >= clip.patch && clip.width.is_multiple_of(clip.heads);
                    whole && clip.outputs == unet.context
                }),
                format!("{clip:?}"),
                "whole patches, heads that divide the width, outputs as many as the UNet's context",
            ),
            ("denoiser.ring", finite && around, format!("{ring:?}"), "cameras outside the ball around the voxels"),
        ] {
            if !fits {
                return refuse(name, found, wanted);
            }
        }
        denoiser.spatial_aware.as_ref().map_or(Ok(()), |module| module.check(volume))
    }
}

fn refuse(name: &str, found: String, wanted: &str) -> Result<()> {
    Err(Error::new(ErrorKind::Input, "no model can be made of these sizes")
        .at(name)
        .found(found)
        .wanted(wanted)
        .fix("correct the sizes in the metadata of the file of weights"))
}
