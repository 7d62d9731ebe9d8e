//! One run of `gradreel synthesize`: its inputs and stages.

use std::fmt;
use std::path::Path;

use gradreel::backend::cpu::pool;
use gradreel::io::TensorFile;
use gradreel::{Device, Error, ErrorKind, Result, Tensor};
use serde::{Deserialize, Serialize};

use super::Arguments;
use crate::cli::network;
use crate::cli::source::{Place, Source};
use crate::report::synthesis::{self, Synthesis, picture_of};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::views::{
    Detection, Ensemble, FileWeights, LatentColours, MemoryEstimate, ModelSizes, SamplerSettings, Sampling, Subject,
    decode, megabytes, open_picture,
};

/// The settings as saved in the run's folder.
pub(super) const SETTINGS: &str = "settings.toml";
/// State of the run.
const STATE: &str = "state.safetensors";
/// Default memory budget for sampling \[bytes\].
const MEMORY: usize = 4_000_000_000;
/// Maximum array size that every GPU supports \[bytes\].
const BINDING: usize = 128 << 20;
/// Preview pixels per latent cell along a side.
const ENLARGED: usize = 4;

/// Settings that determine the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    image: Source,
    weights: Source,
    /// Degrees.
    elevation: f64,
    steps: usize,
    guidance: f64,
    seed: u64,
    crop: usize,
    /// In units of the model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distance: Option<f64>,
    device: Place,
}

impl Settings {
    fn sampler(&self) -> SamplerSettings {
        SamplerSettings { steps: self.steps, guidance: self.guidance, seed: self.seed }
    }
}

/// A prepared run.
pub(super) struct Job {
    folder: RunFolder,
    settings: Settings,
    sizes: ModelSizes,
    weights: FileWeights,
    /// `[1, 3, s, s]` in −1..1
    picture: Tensor,
    at_once: usize,
    memory_estimate: MemoryEstimate,
}

impl Job {
    /// Starts a new run. Invalid input is rejected before anything is written.
    pub fn begin(arguments: &Arguments, weights: &Path) -> Result<Self> {
        let image = Source::of(&arguments.image, "the picture")?;
        let source = Source::of(weights, "the weights")?;
        let sizes = network::open(weights, &Device::Cpu)?.sizes()?;
        let usual = sizes.sampler();
        let settings = Settings {
            image,
            weights: source,
            elevation: arguments.elevation.unwrap_or_default(),
            steps: arguments.steps.unwrap_or(usual.steps),
            guidance: arguments.guidance.unwrap_or(usual.guidance),
            seed: arguments.seed.unwrap_or(usual.seed),
            crop: arguments.crop.unwrap_or(sizes.crop),
            distance: arguments.distance,
            device: arguments.device.unwrap_or(Place::Cpu),
        };
        if settings.distance.is_some() && sizes.denoiser.spatial_aware.is_none() {
            return Err(Error::new(ErrorKind::Input, "this model cannot be told how far away the object is")
                .at("--distance")
                .found(format!("{} without a spatial-aware module", weights.display()))
                .wanted("weights that were trained with `train novel-view --stage spatial-aware`")
                .fix("leave --distance away, or give such weights to --weights"));
        }
        if settings.elevation.is_nan() || settings.elevation.abs() > 90.0 {
            return Err(Error::new(ErrorKind::Input, "there is no such elevation")
                .at("--elevation")
                .found(settings.elevation)
                .wanted("−90 to 90 degrees above the horizon")
                .fix("0 if the camera is level with the object; 20 to 30 if it looks down a little"));
        }
        settings.distance.map_or(Ok(()), Detection::check_depth).map_err(|e| e.at("--distance"))?;
        settings.sampler().check()?;
        Self::prepare(arguments, weights, settings, |settings| {
            let text = toml::to_string(settings).expect("settings are numbers and text");
            let folder = match &arguments.out {
                Some(folder) => RunFolder::create(folder)?,
                None => {
                    let name = arguments.image.file_stem().map_or("picture".into(), |name| name.to_string_lossy());
                    RunFolder::create_free(Path::new("runs"), &name)?
                }
            };
            folder.write(SETTINGS, text.as_bytes())?;
            Ok(folder)
        })
    }

    /// Resumes the run in a folder, with the same picture and weights.
    pub fn resume(arguments: &Arguments, weights: &Path) -> Result<Self> {
        let folder = RunFolder::resume(arguments.out.as_deref().unwrap_or(Path::new(".")))?;
        let place = folder.path(SETTINGS);
        let fix = "give the folder of an interrupted run to --out, or begin one without --resume";
        folder.goes_on(SETTINGS, "there is no run of synthesize to go on with", fix)?;
        let text = folder.read_text(SETTINGS)?;
        let mut settings: Settings = toml::from_str(&text).map_err(|e| {
            Error::new(ErrorKind::Input, "the settings of the run are damaged")
                .at(place.display())
                .found(e)
                .fix("begin again with another --out")
        })?;
        settings.sampler().check().map_err(|e| e.within(place.display()))?;
        settings.image = settings.image.found_again(&arguments.image, "the picture")?;
        settings.weights = settings.weights.found_again(weights, "the weights")?;
        Self::prepare(arguments, weights, settings, |_| Ok(folder))
    }

    fn prepare(
        arguments: &Arguments,
        weights: &Path,
        settings: Settings,
        folder: impl FnOnce(&Settings) -> Result<RunFolder>,
    ) -> Result<Self> {
        let device = settings.device.device()?;
        let weights = network::open(weights, &device)?;
        let sizes = weights.sizes()?;
        weights.check(&sizes.weights()?).into_result()?;
        // crop is given in pixels of a 256-pixel image, whatever the model's size
        let crop = settings.crop.saturating_mul(sizes.image).div_ceil(256);
        if crop > sizes.image {
            return Err(Error::new(ErrorKind::Input, "the object would be larger than its picture")
                .at("--crop")
                .found(settings.crop)
                .wanted("0 to 256")
                .fix("200 leaves the margin that the published model was trained with"));
        }
        let picture = open_picture(&arguments.image, sizes.image, Some(crop).filter(|crop| *crop > 0))?;
        let memory_estimate = MemoryEstimate::of(&sizes, size_of::<f32>());
        let most = match device {
            // more views than threads would only wait for each other
            Device::Cpu => rayon::current_num_threads().min(sizes.denoiser.ring.views),
            Device::Gpu(_) => (BINDING / memory_estimate.largest).clamp(1, sizes.denoiser.ring.views),
        };
        let budget = arguments.memory.map_or(MEMORY, |size| size.0);
        let at_once = memory_estimate.at_once(budget, most).map_err(|e| e.at("--memory"))?;
        // cached buffers count towards the budget
        pool::set_limit(pool::limit().min(budget - memory_estimate.total(at_once)));
        let folder = folder(&settings)?;
        Ok(Self { folder, settings, sizes, weights, picture, at_once, memory_estimate })
    }

    /// Folder of the results.
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// Whether the run is finished.
    pub fn is_published(&self) -> bool {
        self.folder.has(synthesis::PAGE)
    }

    /// Runs all remaining stages.
    pub fn finish(&self, progress: &Progress) -> Result<()> {
        let input = picture_of(&self.picture)?;
        let mut run = match self.folder.has(STATE) {
            true => self.state()?,
            false => self.encode(progress)?,
        };
        self.sample(&mut run, progress)?;
        let views = self.sizes.denoiser.ring.views;
        let stage = progress.stage("decoding", views as u64);
        let mut pictures = Vec::with_capacity(views);
        let all: Vec<usize> = (0..views).collect();
        decode(&self.weights, &self.sizes, run.latents(), &all, self.weights.device(), &mut |_, picture| {
            pictures.push(picture_of(&picture)?);
            stage.set(pictures.len() as u64, "");
            interrupt::check()
        })?;
        stage.finish("");
        let name = |path: &str| {
            let name = Path::new(path).file_name();
            name.map_or_else(|| path.to_owned(), |name| name.to_string_lossy().into_owned())
        };
        let SamplerSettings { steps, guidance, seed } = *run.settings();
        synthesis::publish(
            &self.folder,
            &Synthesis {
                title: &name(&self.settings.image.path),
                ring: &self.sizes.denoiser.ring,
                input: &input,
                views: &pictures,
                latents: run.latents(),
                notes: vec![
                    ("Elevation of the picture".into(), format!("{}° (given)", self.settings.elevation)),
                    ("Steps".into(), format!("{} of {steps} asked for", run.steps())),
                    ("Guidance".into(), guidance.to_string()),
                    ("Seed".into(), seed.to_string()),
                    ("Weights".into(), name(&self.settings.weights.path)),
                ],
                settings: &toml::to_string(&self.settings).expect("settings are numbers and text"),
            },
        )
    }

    fn encode(&self, progress: &Progress) -> Result<Sampling> {
        let stage = progress.stage("encoding the picture", 1);
        let (sampler, elevation) = (self.settings.sampler(), self.settings.elevation.to_radians());
        let device = self.weights.device();
        let subject =
            Subject::encode(&self.weights, &self.sizes, &self.picture, elevation, sampler.picture_key(), device)?;
        let seen = match (self.settings.crop, self.settings.distance) {
            // a centred object is where the model expects it
            (1.., None) => None,
            (_, depth) => subject.seen.map(|seen| Detection { depth, ..seen }),
        };
        let subject = Subject { seen, ..subject };
        let run = Sampling::begin(subject, sampler, self.sizes.denoiser.ring.views)?;
        self.save(&run)?;
        stage.finish("");
        interrupt::check()?;
        Ok(run)
    }

    /// Runs the remaining steps; each is saved on completion.
    fn sample(&self, run: &mut Sampling, progress: &Progress) -> Result<()> {
        if run.is_finished() {
            return Ok(());
        }
        let colours = LatentColours::fit(&self.picture, &run.subject().latent, self.sizes.autoencoder.scale())?;
        let ensemble = Ensemble::new(&self.weights, &self.sizes.denoiser, self.weights.device(), self.at_once)?;
        let (views, steps) = (run.views(), run.steps());
        let before = run.done() * views + run.known();
        let stage = progress.stage("sampling", (steps * views - before) as u64);
        while !run.is_finished() {
            let step = run.done();
            let message = format!("step {} of {steps}", step + 1);
            let outcome = run.step(&ensemble, &mut |known| {
                stage.set((step * views + known - before) as u64, &message);
                interrupt::check()
            });
            // completed views of an interrupted step are saved, too
            self.save(run)?;
            outcome?;
            if let Some(clean) = run.clean() {
                let painted = colours.paint(clean)?;
                let small = painted.iter().map(picture_of).collect::<Result<Vec<_>>>()?;
                self.folder.write("preview.png", &synthesis::sheet(&small, ENLARGED)?)?;
            }
        }
        stage.finish("");
        Ok(())
    }

    fn save(&self, run: &Sampling) -> Result<()> {
        self.folder.write(STATE, &run.to_file().to_bytes()?)
    }

    fn state(&self) -> Result<Sampling> {
        let place = self.folder.path(STATE);
        let damaged = |e: Error| e.within(place.display()).fix("begin again with another --out");
        let file = TensorFile::from_bytes(&self.folder.read(STATE)?).map_err(damaged)?;
        let run = Sampling::from_file(&file).map_err(damaged)?;
        let ModelSizes { denoiser, autoencoder, .. } = &self.sizes;
        let width = self.sizes.latent_width();
        let latents = [1, denoiser.ring.views, autoencoder.channels(), width, width];
        let fits = run.latents().dims() == latents && run.subject().embedding.dims() == [1, 1, denoiser.unet.context];
        if !fits || *run.settings() != self.settings.sampler() {
            return Err(Error::new(ErrorKind::Input, "the state of the run does not belong to its settings")
                .at(place.display())
                .found(format!("latents {}, {:?}", run.latents().shape(), run.settings()))
                .wanted(format!("latents {latents:?}, {:?}", self.settings.sampler()))
                .fix("begin again with another --out"));
        }
        Ok(run)
    }
}

impl fmt::Display for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { folder, settings, sizes, at_once, memory_estimate, .. } = self;
        write!(
            f,
            "{}: {} views, {at_once} at once (about {} beside the weights) → {}",
            settings.image.path,
            sizes.denoiser.ring.views,
            megabytes(memory_estimate.total(*at_once)),
            folder.root().display()
        )
    }
}
