//! Sixteen views of every frame, all from the same noise.

use gradreel::backend::cpu::pool;
use gradreel::io::TensorFile;
use gradreel::{Device, Error, Result, Tensor};

use super::pictures::Shown;
use super::{Placing, PublishedConfig};
use crate::layers::Weights;
use crate::runtime::run_folder::RunFolder;
use crate::views::{Ensemble, FileWeights, MemoryEstimate, ModelSizes, SamplerSettings, Sampling, Subject, decode};

/// Default memory budget for sampling \[bytes\].
const MEMORY: usize = 4_000_000_000;

/// Name of a frame's tensor in its file.
const PICTURES: &str = "pictures";

/// Makes the views of frames with one model. Its noise is the same for all frames, so that what nobody saw looks alike in them.
pub(crate) struct ViewMaker<'a> {
    weights: &'a FileWeights,
    /// The model, without the module where it is not used.
    pub sizes: ModelSizes,
    pub settings: SamplerSettings,
    pub memory: MemoryEstimate,
    ensemble: Ensemble,
}

impl<'a> ViewMaker<'a> {
    /// The sizes of a model, and how its sampler is set.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] for sizes or settings that cannot be used.
    pub fn settings(weights: &FileWeights, config: &PublishedConfig) -> Result<(ModelSizes, SamplerSettings)> {
        let sizes = weights.sizes()?;
        let usual = sizes.sampler();
        let settings = SamplerSettings {
            steps: config.steps.unwrap_or(usual.steps),
            guidance: config.guidance.unwrap_or(usual.guidance),
            seed: config.seed,
        };
        settings.check()?;
        Ok((sizes, settings))
    }

    /// A model ready to run; the module is left out where the object is moved instead, or `without` says so.
    ///
    /// # Errors
    /// When a weight is missing, or not even one view fits the memory.
    pub fn new(weights: &'a FileWeights, config: &PublishedConfig, module: bool) -> Result<Self> {
        let (mut sizes, settings) = Self::settings(weights, config)?;
        if !module {
            sizes.denoiser.spatial_aware = None;
        }
        let memory = MemoryEstimate::of(&sizes, size_of::<f32>());
        let most = rayon::current_num_threads().min(sizes.denoiser.ring.views);
        let at_once = memory.at_once(MEMORY, most)?;
        pool::set_limit(pool::limit().min(MEMORY.saturating_sub(memory.total(at_once))));
        let ensemble = Ensemble::new(weights as &dyn Weights, &sizes.denoiser, &Device::Cpu, at_once)?;
        Ok(Self { weights, sizes, settings, memory, ensemble })
    }

    /// Views that are made at once.
    pub fn at_once(&self) -> usize {
        self.ensemble.at_once()
    }

    /// Steps of a frame.
    pub fn steps(&self) -> Result<usize> {
        Ok(crate::views::Ddim::new(&crate::views::Schedule::published(), self.settings.steps)?.len())
    }

    /// Views of a frame.
    pub fn views(&self) -> usize {
        self.sizes.denoiser.ring.views
    }

    /// Begins a frame.
    ///
    /// # Errors
    /// When a weight is missing.
    pub fn begin(&self, shown: &Shown) -> Result<Sampling> {
        let Shown { picture, elevation, seen } = shown;
        let key = self.settings.picture_key();
        let subject = Subject::encode(self.weights, &self.sizes, picture, *elevation, key, &Device::Cpu)?;
        let subject = Subject { seen: *seen, ..subject };
        Sampling::begin(subject, self.settings, self.views())
    }

    /// The views of a frame `[views, 3, s, s]` in −1…1: read from its file in the folder, or made, going on with what is there.
    /// `watch` hears how many views of all steps are known.
    ///
    /// # Errors
    /// What sampling returns; an error of `watch`, before which everything known is saved.
    pub fn frame(
        &self,
        folder: &RunFolder,
        frame: usize,
        shown: &dyn Fn() -> Result<Shown>,
        watch: &mut dyn FnMut(usize) -> Result<()>,
    ) -> Result<Tensor> {
        let [done, begun] = ["", "state."].map(|kind| format!("views/frame_{frame:03}.{kind}safetensors"));
        if let Some(pictures) = made(folder, frame)? {
            return Ok(pictures);
        }
        let mut run = match folder.has(&begun) {
            true => self.read(folder, &begun)?,
            false => self.begin(&shown()?)?,
        };
        while !run.is_finished() {
            let step = run.done();
            let outcome = run.step(&self.ensemble, &mut |known| watch(step * self.views() + known));
            folder.write(&begun, &run.to_file().to_bytes()?)?;
            outcome?;
        }
        let mut pictures = Vec::with_capacity(self.views());
        let all: Vec<usize> = (0..self.views()).collect();
        decode(self.weights, &self.sizes, run.latents(), &all, &Device::Cpu, &mut |_, picture| {
            pictures.extend(picture.to_vec()?.into_iter().map(|value| value as f32));
            Ok(())
        })?;
        let size = self.sizes.image;
        let pictures = Tensor::from_vec(pictures, [self.views(), 3, size, size]);
        let mut file = TensorFile::default();
        file.tensors.insert(PICTURES.into(), pictures.clone());
        folder.write(&done, &file.to_bytes()?)?;
        // a leftover is never read once the pictures are there
        let _ = std::fs::remove_file(folder.path(&begun));
        Ok(pictures)
    }

    fn read(&self, folder: &RunFolder, name: &str) -> Result<Sampling> {
        let damaged = |e: Error| e.within(folder.path(name).display()).fix("remove the file to make this frame again");
        let file = TensorFile::from_bytes(&folder.read(name)?).map_err(damaged)?;
        let run = Sampling::from_file(&file).map_err(damaged)?;
        let width = self.sizes.latent_width();
        let latents = [1, self.views(), self.sizes.autoencoder.channels(), width, width];
        if run.latents().dims() != latents || *run.settings() != self.settings {
            let error = Error::new(gradreel::ErrorKind::Input, "the views of a frame were begun otherwise");
            return Err(damaged(error.found(format!("latents {}, {:?}", run.latents().shape(), run.settings()))));
        }
        Ok(run)
    }
}

/// The views of a frame, if they are made.
///
/// # Errors
/// [`gradreel::ErrorKind::Input`] when their file is damaged.
pub(super) fn made(folder: &RunFolder, frame: usize) -> Result<Option<Tensor>> {
    let name = format!("views/frame_{frame:03}.safetensors");
    if !folder.has(&name) {
        return Ok(None);
    }
    let damaged = |e: Error| e.within(folder.path(&name).display()).fix("remove the file to make this frame again");
    let file = TensorFile::from_bytes(&folder.read(&name)?).map_err(damaged)?;
    Ok(Some(file.get(PICTURES).map_err(damaged)?.clone()))
}

impl Placing {
    /// What of this a run assumes.
    pub(super) fn said(self) -> &'static str {
        match self {
            Self::Module => {
                "views: the spatial-aware module puts the object where the film has it; what nobody saw is a guess of the model"
            }
            Self::Moved => {
                "views: the model makes them of the object in the middle, and they are moved to where the film has it; what nobody saw is a \
                 guess of the model"
            }
        }
    }
}
