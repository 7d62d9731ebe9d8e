//! The sizes of a model as a file of weights states them, and whether they make a model.

use gradreel::{Error, ErrorKind, Result};

use super::ModelSizes;

/// Greatest size that is believed.
const MOST: usize = 1 << 16;

impl ModelSizes {
    /// The key under which a safetensors file's metadata hold the sizes of its model.
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
    /// [`ErrorKind::Input`] for other text, or sizes of which no model can be made.
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

    /// Pixels along a side of a latent: the image's, halved by every level of the autoencoder but the first.
    pub fn latent_width(&self) -> usize {
        self.image >> self.autoencoder.multipliers.len().saturating_sub(1)
    }

    /// Whether a model can be made of these sizes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the size that does not fit, and why.
    pub fn check(&self) -> Result<()> {
        let Self { image, denoiser, autoencoder, clip } = self;
        let (ring, unet, volume) = (&denoiser.ring, &denoiser.unet, &denoiser.volume);
        let refuse = |name: &str, found: String, wanted: &str| {
            Err(Error::new(ErrorKind::Input, "no model can be made of these sizes")
                .at(name)
                .found(found)
                .wanted(wanted)
                .fix("correct the sizes in the metadata of the file of weights"))
        };
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
            ("autoencoder.base", autoencoder.base),
            ("autoencoder.blocks", autoencoder.blocks),
            ("autoencoder.multipliers", autoencoder.multipliers.len()),
            ("clip.resolution", clip.resolution),
            ("clip.patch", clip.patch),
            ("clip.width", clip.width),
            ("clip.heads", clip.heads),
        ];
        counts.extend(unet.multipliers.iter().map(|m| ("denoiser.unet.multipliers", *m)));
        counts.extend(autoencoder.multipliers.iter().map(|m| ("autoencoder.multipliers", *m)));
        counts.extend(volume.spatial.iter().map(|c| ("denoiser.volume.spatial", *c)));
        counts.extend(volume.frustum.iter().map(|c| ("denoiser.volume.frustum", *c)));
        if let Some((name, count)) = counts.into_iter().find(|(_, count)| *count == 0 || *count > MOST) {
            return refuse(name, count.to_string(), "1 to 65536");
        }
        // normalisation by 32 groups in the UNet and the autoencoder, by 8 on the volume side
        let groups: [(&str, Vec<usize>, usize); 5] = [
            ("denoiser.unet.base", vec![unet.base], 32),
            ("autoencoder.base", vec![autoencoder.base], 32),
            ("denoiser.volume.spatial", volume.spatial.to_vec(), 8),
            ("denoiser.volume.frustum", volume.frustum.to_vec(), 8),
            (
                "denoiser.volume.voxels, its depth or the latent width",
                vec![volume.voxels, volume.depth, self.latent_width()],
                8,
            ),
        ];
        for (name, sizes, divisor) in groups {
            if let Some(size) = sizes.iter().find(|size| **size == 0 || !size.is_multiple_of(divisor)) {
                return refuse(name, size.to_string(), &format!("a multiple of {divisor}"));
            }
        }
        let levels = autoencoder.multipliers.len() - 1;
        let deep = unet.multipliers.map(|m| m * unet.base);
        let finite = [ring.elevation, ring.distance, ring.focal, ring.half].iter().all(|v| v.is_finite());
        let around = ring.distance > 3f64.sqrt() * ring.half && ring.focal > 0.0 && ring.half > 0.0;
        for (name, fits, found, wanted) in [
            ("image", image.is_multiple_of(1 << levels), format!("{image}"), "a size that the autoencoder can halve"),
            (
                "denoiser.unet.heads",
                deep[..3].iter().all(|c| c.is_multiple_of(unet.heads)) && deep[3].is_multiple_of(unet.heads),
                format!("{} heads for {deep:?} channels", unet.heads),
                "a divisor of the channels of every level",
            ),
            ("denoiser.unet.volumes", unet.volumes == volume.frustum, format!("{:?}", unet.volumes), "the frustum's"),
            (
                "denoiser.unet.inputs",
                [unet.inputs, unet.outputs, autoencoder.latent] == [2 * volume.latent, volume.latent, volume.latent],
                format!("{} of {} latent channels", unet.inputs, volume.latent),
                "noised and input latent side by side, of the autoencoder's channels",
            ),
            (
                "clip",
                clip.resolution >= clip.patch && clip.width.is_multiple_of(clip.heads) && clip.outputs == unet.context,
                format!("{clip:?}"),
                "whole patches, heads that divide the width, outputs as many as the UNet's context",
            ),
            ("denoiser.ring", finite && around, format!("{ring:?}"), "cameras outside the ball around the voxels"),
        ] {
            if !fits {
                return refuse(name, found, wanted);
            }
        }
        Ok(())
    }
}
