//! The views around an object, sampled from one picture: the stages behind `gradreel synthesize`, with a model small enough
//! to run in a second.
//!
//! Its weights are fresh, so that the views show nothing yet; everything else is as with the published weights, for which
//! `FileWeights::open` takes the place of `initialise` and `ModelSizes::published` that of the small sizes. A run is a value:
//! it can be written to a file after any view and gone on with, and however many views run at once, it ends in the same
//! bits.
//!
//! ```text
//! cargo run --release --example 09_synthesize
//! ```

use gradreel::{DType, Device, Key, Result, Tape, Tensor};
use gradreel_models::layers::initialise;
use gradreel_models::views::{
    AutoencoderSizes, ClipSizes, Ensemble, MemoryEstimate, Model, ModelSizes, SamplerSettings, Sampling, Subject,
    decode,
};

/// The published model with fewer channels, pixels and views.
fn small() -> Result<ModelSizes> {
    let mut sizes = ModelSizes::published();
    let (unet, volume) = (&mut sizes.denoiser.unet, &mut sizes.denoiser.volume);
    (unet.base, unet.heads, unet.context, unet.volumes) = (32, 4, 16, [8, 8, 16, 16]);
    (volume.features, volume.time, volume.voxels, volume.depth) = (4, 32, 8, 8);
    (volume.spatial, volume.frustum) = ([8, 8, 16, 16], [8, 8, 16, 16]);
    sizes.denoiser.ring.views = 6;
    sizes.autoencoder = AutoencoderSizes { base: 32, multipliers: vec![1, 1, 2], blocks: 1, latent: 4 }.into();
    sizes.clip = Some(ClipSizes { resolution: 28, patch: 14, width: 32, layers: 2, heads: 2, outputs: 16 });
    sizes.image = 32;
    sizes.check().map(|()| sizes)
}

fn main() -> Result<()> {
    let (sizes, device) = (small()?, Device::Cpu);
    let params = initialise(Key::new(1), DType::F32, |scope| Model::new(scope, &sizes))?;
    let weights = params.bind(&Tape::new());
    println!("{} weights", params.count());

    // a picture in −1..1; `open_picture` reads one from a file
    let picture: Vec<f32> = (0..3 * 32 * 32).map(|i| if (i / 32 % 32) < 16 { 0.5 } else { -0.5 }).collect();
    let picture = Tensor::from_vec(picture, [1, 3, 32, 32]);
    let settings = SamplerSettings { steps: 4, guidance: 2.0, seed: 7 };
    let subject = Subject::encode(&weights, &sizes, &picture, 20f64.to_radians(), settings.picture_key(), &device)?;

    let memory_estimate = MemoryEstimate::of(&sizes, size_of::<f32>());
    let most = memory_estimate.at_once(100_000_000, sizes.denoiser.ring.views)?;
    println!("{most} views fit into 100 MB at once");
    let [one, two] = [1, 2].map(|at_once| Ensemble::new(&weights, &sizes.denoiser, &device, at_once));
    let (one, two) = (one?, two?);

    let mut run = Sampling::begin(subject, settings, sizes.denoiser.ring.views)?;
    run.step(&one, &mut |_| Ok(()))?;
    // what a file would hold, and the run that is read from it
    let mut other = Sampling::from_file(&run.to_file())?;
    while !run.is_finished() {
        run.step(&one, &mut |_| Ok(()))?;
        other.step(&two, &mut |_| Ok(()))?;
        println!("step {} of {}", run.done(), run.steps());
    }
    assert_eq!(run.latents().slice::<f32>(), other.latents().slice::<f32>());

    decode(&weights, &sizes, run.latents(), &[0, 3], &device, &mut |view, picture| {
        let values = picture.slice::<f32>();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        println!("view {view}: {} values, {mean:.3} on average", values.len());
        Ok(())
    })
}
