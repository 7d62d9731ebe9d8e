//! The same model without the path on which it un-projects its input image.

use gradreel::io::TensorFile;
use gradreel::{DType, Error, ErrorKind, Result, Tape};

use super::{FileWeights, ModelSizes};

/// Where the un-projected views meet: its input channels are those of every view, and last those of the input image.
const MEETING: &str = "spatial_volume.spatial_volume_feats.init_conv.weight";

/// What reads the input image for the volume.
const READER: &str = "spatial_volume.input_encoder.";

impl FileWeights {
    /// The weights of the model that knows its input image from the UNet alone, as the published one does, and has all else from this
    /// one, in `f32`: what a training goes on from.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when this model does not un-project its input, or the file lacks a weight.
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
