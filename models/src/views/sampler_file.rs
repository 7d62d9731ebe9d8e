//! Saving a sampler run to a file.

use gradreel::io::TensorFile;
use gradreel::{DType, Error, ErrorKind, Result, Tensor};
use serde::{Deserialize, Serialize};

use super::{Detection, ImageBox, SamplerSettings, Sampling, Subject};

/// Metadata key of the integers.
const METADATA: &str = "gradreel.sampling";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Numbers {
    steps: usize,
    seed: u64,
    done: usize,
}

impl Sampling {
    /// The complete state for resuming the run, including predictions of an unfinished step: `latents`,
    /// `embedding`, `latent`, `elevation`, `seen` (left, top, right and bottom of the box, and the object's depth,
    /// if known), `guidance`, `predicted.<view>`, and integers in the metadata.
    pub fn to_file(&self) -> TensorFile {
        let mut file = TensorFile::default();
        let Self { subject, settings: SamplerSettings { steps, guidance, seed }, done, .. } = self;
        let numbers = Numbers { steps: *steps, seed: *seed, done: *done };
        let text = serde_json::to_string(&numbers).expect("whole numbers are JSON");
        file.metadata.insert(METADATA.into(), text);
        let mut put = |name: &str, tensor: &Tensor| file.tensors.insert(name.to_owned(), tensor.clone());
        put("latents", &self.latents);
        put("embedding", &subject.embedding);
        put("latent", &subject.latent);
        // stored as tensors, since decimal text may lose the last bit
        put("elevation", &Tensor::from_vec(vec![subject.elevation], [1]));
        put("guidance", &Tensor::from_vec(vec![*guidance], [1]));
        if let Some(Detection { bounds: ImageBox { low, high }, depth }) = subject.seen {
            let known: Vec<f64> = low.into_iter().chain(high).chain(depth).collect();
            put("seen", &Tensor::from_vec(known.clone(), [known.len()]));
        }
        for (view, noise) in self.predicted.iter().enumerate() {
            if let Some(noise) = noise {
                put(&format!("predicted.{view}"), noise);
            }
        }
        file
    }

    /// Restores a run written by [`Sampling::to_file`]; it continues bitwise identically.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if an entry is missing or inconsistent.
    pub fn from_file(file: &TensorFile) -> Result<Self> {
        let damaged = |what: &str, found: String| {
            Error::new(ErrorKind::Input, "this is not the state of a sampler")
                .at(what)
                .found(found)
                .fix("start the run again")
        };
        let text = file.metadata.get(METADATA).map_or("", String::as_str);
        let numbers: Numbers = serde_json::from_str(text).map_err(|e| damaged(METADATA, e.to_string()))?;
        let number = |name: &str| {
            let tensor = file.get(name)?;
            match tensor.dims() {
                [1] if tensor.dtype() == DType::F64 => tensor.item(),
                _ => Err(damaged(name, format!("{:?}", tensor.spec()))),
            }
        };
        let subject = Subject {
            embedding: file.get("embedding")?.clone(),
            latent: file.get("latent")?.clone(),
            elevation: number("elevation")?,
            seen: match file.tensors.get("seen") {
                None => None,
                Some(tensor) => match tensor.to_vec()?[..] {
                    [left, top, right, bottom, ref depth @ ..] if depth.len() < 2 => Some(Detection {
                        bounds: ImageBox { low: [left, top], high: [right, bottom] },
                        depth: depth.first().copied(),
                    }),
                    _ => return Err(damaged("seen", format!("{:?}", tensor.spec()))),
                },
            },
        };
        let settings = SamplerSettings { steps: numbers.steps, guidance: number("guidance")?, seed: numbers.seed };
        let latents = file.get("latents")?.clone();
        let (latent, context) = (subject.latent.dims().to_vec(), subject.embedding.dims().to_vec());
        let mut run = Self::begin_from(subject, settings, latents)?;
        let same = [&run.subject.latent, &run.subject.embedding].iter().all(|t| t.dtype() == run.latents.dtype());
        if latent.len() != 4 || latent[1..] != run.latents.dims()[2..] || context.len() != 3 || !same {
            return Err(damaged("latents", format!("{:?} for a picture {latent:?}", run.latents.spec())));
        }
        if numbers.done > run.steps() {
            return Err(damaged(METADATA, format!("{} of {} steps", numbers.done, run.steps())));
        }
        run.done = numbers.done;
        for view in 0..run.views() {
            let Some(noise) = file.tensors.get(&format!("predicted.{view}")) else { continue };
            if noise.dims() != latent || noise.dtype() != run.latents.dtype() {
                return Err(damaged(&format!("predicted.{view}"), format!("{:?}", noise.spec())));
            }
            run.predicted[view] = Some(noise.clone());
        }
        for (name, tensor) in &file.tensors {
            if !tensor.all_finite()? {
                return Err(damaged(name, "a number that is not finite".into()));
            }
        }
        Ok(run)
    }
}
