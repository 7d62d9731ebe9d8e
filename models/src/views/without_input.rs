//! Removing the un-projection of the input image from a model.

use gradreel::io::TensorFile;
use gradreel::{DType, Error, ErrorKind, Result, Tape};

use super::{FileWeights, ModelSizes};

/// The weight at which un-projected views are combined: its input channels are those of all views, followed by
/// those of the input image.
const MEETING: &str = "spatial_volume.spatial_volume_feats.init_conv.weight";

/// Prefix of the encoder that un-projects the input image.
const READER: &str = "spatial_volume.input_encoder.";

impl FileWeights {
    /// The weights of a model that receives its input image in the UNet only, like the published one, with all
    /// other weights of this model, in `f32`: a starting point for training.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if this model does not un-project its input, or the file lacks a weight.
    pub fn without_input(&self) -> Result<TensorFile> {
        let mut sizes = self.sizes()?;
        if !std::mem::replace(&mut sizes.denoiser.volume.input, false) {
            return Err(Error::new(ErrorKind::Input, "this model does not un-project its input image")
                .at(self.path().display())
                .found("denoiser.volume.input = false")
                .fix("it is what was asked for: use it as it is"));
        }
        let kept = sizes.denoiser.ring.views * sizes.denoiser.volume.features;
        let archive = self.archive();
        let mut file = TensorFile::default();
        for name in archive.names().filter(|name| !name.starts_with(READER)) {
            let tensor = archive.load(name)?.cast(DType::F32)?;
            let tensor = match name {
                MEETING if tensor.dims().get(1).is_some_and(|channels| *channels > kept) => {
                    Tape::new().constant(tensor).slice(1, 0..kept).value()?.clone()
                }
                _ => tensor,
            };
            file.tensors.insert(name.to_owned(), tensor);
        }
        file.metadata.insert(ModelSizes::METADATA.into(), sizes.to_json());
        Ok(file)
    }
}
