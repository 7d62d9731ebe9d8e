//! The published sizes, with weights made from their paths, against an independent implementation.
//!
//! The UNet needs 5 GB and is run on demand:
//! `cargo test --release -p gradreel-models --test views -- --ignored --nocapture fullsize_unet`
//!
//! So is the same from a file, which `models/src/views/tests/write_checkpoint.py` writes with PyTorch:
//! `GRADREEL_CHECKPOINT=FILE cargo test --release -p gradreel-models --test views -- --ignored --nocapture fullsize_file`

use std::sync::LazyLock;
use std::time::Instant;

use crate::layers::{Scope, Weights};
use crate::views::training::Batch;
use crate::views::{
    Autoencoder, AutoencoderSizes, ClipSizes, ClipTower, DenoiserSizes, FileWeights, ModelSizes, Plan, Ring, Training,
    Unet, UnetSizes, VolumePath, VolumeSizes,
};
use gradreel::{DType, Device, Tape, Tensor, Var};

use super::harness::{load, setting};
use super::procedural::{Source, input};

/// The seed of the file.
fn seed() -> &'static str {
    static SEED: LazyLock<String> = LazyLock::new(|| {
        let seed = setting(&load("fullsize_procedural"), "weight_seed");
        seed.as_str().expect("a text").to_owned()
    });
    &SEED
}

/// Largest error relative to the largest number of a tensor: the tolerance of the vectors.
const TOLERANCE: f64 = 1e-3;

fn source() -> Source {
    Source { seed: seed(), tape: Tape::new() }
}

fn given(tape: &Tape, name: &str, shape: impl Into<gradreel::Shape>) -> Var {
    tape.constant(input(seed(), name, shape))
}

/// Every `steps[i]`-th element along each axis, from the first.
fn thinned(x: &Tensor, steps: &[usize]) -> Tensor {
    let mut thin = x.clone();
    for (axis, step) in steps.iter().enumerate().filter(|(_, step)| **step > 1) {
        let dims = thin.dims().to_vec();
        let (outer, inner) = (dims[..axis].iter().product::<usize>(), dims[axis + 1..].iter().product::<usize>());
        let count = dims[axis].div_ceil(*step);
        let values = thin.slice::<f32>();
        let row = |o: usize, i: usize| (o * dims[axis] + i * step) * inner;
        let rows = (0..outer).flat_map(|o| (0..count).map(move |i| (o, i)));
        let picked = rows.flat_map(|(o, i)| values[row(o, i)..row(o, i) + inner].to_vec()).collect::<Vec<f32>>();
        let shape = [&dims[..axis], &[count], &dims[axis + 1..]].concat();
        thin = Tensor::from_vec(picked, shape);
    }
    thin
}

#[track_caller]
fn compare(name: &str, found: &Var, steps: &[usize], begin: Instant) {
    compare_within(TOLERANCE, name, found, steps, begin);
}

#[track_caller]
fn compare_within(tolerance: f64, name: &str, found: &Var, steps: &[usize], begin: Instant) {
    let found = thinned(found.value().unwrap(), steps);
    let file = load("fullsize_procedural");
    let expected = file.get(name).unwrap();
    assert_eq!(found.dims(), expected.dims(), "{name}");
    let (found, expected) = (found.to_vec().unwrap(), expected.to_vec().unwrap());
    let largest = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!(found.iter().all(|v| v.is_finite()), "{name} is not finite");
    let error = found.iter().zip(&expected).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    let seconds = begin.elapsed().as_secs_f64();
    println!("{name}: error {:.1e} of the largest, {seconds:.2} s with weights, {}", error / largest, peak());
    assert!(error <= tolerance * largest, "{name}: {error} of {largest}");
}

/// The most memory this process had, and how much of what it has now are pages of files and how much is its own, where the
/// system says so.
fn peak() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = |name: &&str| status.lines().find(|line| line.starts_with(*name)).map(|l| l.replace('\t', " "));
    ["VmHWM", "RssFile", "RssAnon"].iter().filter_map(line).collect::<Vec<_>>().join(", ")
}

#[test]
#[ignore = "needs 5 GB and half a minute"]
fn fullsize_unet() {
    unet(&source(), TOLERANCE);
}

#[test]
#[ignore = "needs a file of 5.6 GB"]
fn fullsize_file() {
    let begin = Instant::now();
    let path = std::env::var_os("GRADREEL_CHECKPOINT").expect("GRADREEL_CHECKPOINT: the file to use");
    let weights = FileWeights::open(path, &Device::Cpu).unwrap();
    let report = weights.check(&ModelSizes::published().weights().unwrap());
    assert!(report.is_exact(), "{report}");
    assert_eq!(weights.archive().names().count(), 1618);
    println!("{report}opened and compared: {:.2} s, {}", begin.elapsed().as_secs_f64(), peak());
    // weights of three or four digits
    let is_rounded = weights.archive().entry("betas").unwrap().stored.size() == 2;
    let tolerance = if is_rounded { 2e-2 } else { TOLERANCE };
    decoder(&weights, tolerance);
    unet(&weights, tolerance);
}

/// One training step of the published model: `GRADREEL_CHECKPOINT` as above, `GRADREEL_RECOMPUTED=no` to keep all values.
#[test]
#[ignore = "needs a file of 5.6 GB and as much memory"]
fn fullsize_training() {
    let path = std::env::var_os("GRADREEL_CHECKPOINT").expect("GRADREEL_CHECKPOINT: the file to use");
    let kept = std::env::var("GRADREEL_RECOMPUTED").is_ok_and(|recomputed| recomputed == "no");
    let weights = FileWeights::open(path, &Device::Cpu).unwrap();
    let plan = Plan { recomputed: !kept, ..Plan::published() };
    let mut training = Training::new(weights, DenoiserSizes::published(), plan).unwrap();
    let count: usize = training.params().iter().map(|(_, weight)| weight.len()).sum();
    println!("{count} numbers trained, {}", peak());
    assert_eq!(count, 57_321_472 + 131_584 + 48_567_552);
    let made = |name: &str, shape: &[usize]| input(seed(), name, shape);
    let batch = Batch {
        latents: made("training.latents", &[1, 16, 4, 32, 32]),
        embeddings: made("training.embeddings", &[1, 1, 768]),
        images: made("training.images", &[1, 4, 32, 32]),
        elevations: vec![0.2],
        boxes: vec![],
    };
    for _ in 0..2 {
        let begin = Instant::now();
        let step = training.step(&batch).unwrap();
        assert!(step.loss.is_finite() && step.update.gradient_norm > 0.0);
        let (seconds, held) = (begin.elapsed().as_secs_f64(), step.memory.peak as f64 * 1e-9);
        println!("loss {:.3}: {seconds:.1} s, the tape held {held:.2} GB, {}", step.loss, peak());
    }
}

fn unet(source: &dyn Weights, tolerance: f64) {
    let begin = Instant::now();
    let tape = &Tape::new();
    let net = Unet::new(&Scope::root(source).at("model.diffusion_model"), &UnetSizes::PUBLISHED).unwrap();
    println!("weights: {:.2} s", begin.elapsed().as_secs_f64());
    let volume = |width: usize, channels: usize| {
        given(tape, &format!("unet.volume_{width}"), [1, channels, width * 3 / 2, width, width])
    };
    let volumes = [volume(32, 64), volume(16, 128), volume(8, 256), volume(4, 512)];
    let (x, context) = (given(tape, "unet.x", [1, 8, 32, 32]), given(tape, "unet.context", [1, 1, 768]));
    let begin = Instant::now();
    let noise = net.forward(&x, &[501.0], &context, Some(&volumes)).unwrap();
    compare_within(tolerance, "unet.eps", &noise, &[], begin);
}

fn decoder(source: &dyn Weights, tolerance: f64) {
    let begin = Instant::now();
    let tape = &Tape::new();
    let net = Autoencoder::new(&Scope::root(source).at("first_stage_model"), &AutoencoderSizes::published()).unwrap();
    let image = net.decode(&given(tape, "vae.z", [1, 4, 32, 32]));
    compare_within(tolerance, "vae.decoded_stride8", &image, &[1, 1, 8, 8], begin);
}

#[test]
fn fullsize_volumes() {
    let begin = Instant::now();
    let source = source();
    let tape = &source.tape;
    let scope = Scope::root(&source).at("spatial_volume");
    let path = VolumePath::new(&scope, VolumeSizes::PUBLISHED, Ring::published(16)).unwrap();
    let noised = given(tape, "vol.x", [1, 16, 4, 32, 32]);
    let time = given(tape, "vol.t_embed", [1, 256]);
    let viewpoints = given(tape, "vol.v_embed", [1, 16, 4]);
    let unprojected = path.unproject(&noised, &time, &viewpoints).unwrap();
    let volume = path.spatial_volume(&unprojected, &time).unwrap();
    compare("vol.spatial_volume_stride4", &volume, &[1, 1, 4, 4, 4], begin);
    let samples = path.frustum_samples(&volume, &[3], 32).unwrap();
    let pyramid = path.pyramid(&samples, &time, &viewpoints.slice(1, 3..4).reshape([1, 4])).unwrap();
    for ((width, steps), level) in [(32, [6, 4, 4]), (16, [6, 2, 2]), (8, [3, 2, 2]), (4, [1; 3])].iter().zip(&pyramid)
    {
        compare(&format!("vol.frustum_{width}_view3"), level, &[&[1, 1], &steps[..]].concat(), begin);
    }
}

#[test]
fn fullsize_autoencoder() {
    let begin = Instant::now();
    let source = source();
    decoder(&source, TOLERANCE);
    let tape = &source.tape;
    let scope = Scope::root(&source).at("first_stage_model");
    let net = Autoencoder::new(&scope, &AutoencoderSizes::published()).unwrap();
    let image = given(tape, "vae.image", [1, 3, 256, 256]);
    let image = &image / 3f64.sqrt();
    compare("vae.moments", &net.moments(&image), &[], begin);
}

#[test]
fn fullsize_clip() {
    let begin = Instant::now();
    let source = source();
    let scope = Scope::root(&source).at("clip_image_encoder.model.visual");
    let tower = ClipTower::new(&scope, ClipSizes::PUBLISHED).unwrap();
    let image = given(&source.tape, "clip.normalized_image", [1, 3, 224, 224]);
    assert_eq!(image.dtype(), DType::F32);
    compare("clip.embedding", &tower.forward(&image), &[], begin);
}
