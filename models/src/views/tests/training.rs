//! The training step: a loss that falls, frozen weights that stay, and the same numbers however a step is cut up.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::layers::listing;
use crate::views::training::{Batch, BatchGradients, Draw};
use crate::views::{
    Autoencoder, Denoiser, DenoiserSizes, FileWeights, Plan, Ring, Told, Training, UnetSizes, VolumeSizes,
};
use gradreel::io::{Archive, TensorFile};
use gradreel::{Device, Tensor};

use super::harness::{Case, load, places};
use super::{procedural, sampling};

const SEED: &str = "training";

/// Two views of 8 × 8.
fn tiny() -> DenoiserSizes {
    let volumes = [8, 16, 16, 16];
    let unet = UnetSizes { inputs: 8, outputs: 4, base: 32, multipliers: [1; 4], heads: 2, context: 8, volumes };
    let (spatial, frustum) = (volumes, volumes);
    let volume = VolumeSizes { latent: 4, features: 4, time: 16, spatial, frustum, voxels: 8, depth: 8, input: false };
    DenoiserSizes { ring: Ring::published(2), unet, volume, spatial_aware: None, output: Default::default() }
}

fn batch(samples: usize) -> Batch {
    batch_of(samples, 8)
}

fn batch_of(samples: usize, width: usize) -> Batch {
    let input = |name: &str, shape: &[usize]| procedural::input(SEED, name, shape);
    Batch {
        latents: input("latents", &[samples, 2, 4, width, width]),
        embeddings: input("embeddings", &[samples, 1, 8]),
        images: input("images", &[samples, 4, width, width]),
        elevations: (0..samples).map(|i| 0.1 * i as f64).collect(),
        boxes: vec![],
    }
}

fn scratch(name: &str) -> PathBuf {
    super::harness::scratch("training").join(name)
}

/// A file with all weights of a model, and of one entry that is none of them.
fn file(name: &str, seed: &str, sizes: &DenoiserSizes) -> PathBuf {
    let mut file = TensorFile::default();
    for (key, shape) in listing(|scope| Denoiser::new(scope, sizes)).unwrap() {
        let value = procedural::weight(seed, &key, &shape);
        file.tensors.insert(key, value);
    }
    file.tensors.insert("first_stage_model.quant_conv.bias".into(), procedural::input(seed, "other", [8]));
    file.metadata.insert("note".into(), "kept".into());
    let path = scratch(name);
    file.write(&path).unwrap();
    path
}

fn begin(path: &PathBuf, plan: Plan) -> Training {
    begin_on(&Device::Cpu, path, plan)
}

fn begin_on(device: &Device, path: &PathBuf, plan: Plan) -> Training {
    Training::new(FileWeights::open(path, device).unwrap(), tiny(), plan).unwrap()
}

/// Rates for a few steps of a tiny model.
fn plan() -> Plan {
    let mut plan = Plan { warmup: 0, at_once: 2, recomputed: false, seed: 7, ..Plan::published() };
    plan.trained.iter_mut().for_each(|(_, rate)| *rate = 3e-3);
    plan
}

fn bits(tensors: &BTreeMap<String, Tensor>) -> Vec<(String, Vec<u64>)> {
    let of = |tensor: &Tensor| tensor.to_vec().unwrap().into_iter().map(f64::to_bits).collect();
    tensors.iter().map(|(name, tensor)| (name.clone(), of(tensor))).collect()
}

fn params(training: &Training) -> BTreeMap<String, Tensor> {
    training.params().iter().map(|(path, value)| (path.to_owned(), value.clone())).collect()
}

/// The largest difference of two sets of gradients, each relative to the largest number of its tensor; those of tensors that
/// hardly matter are rounding noise.
fn difference(a: &BatchGradients, b: &BatchGradients) -> f64 {
    assert!(a.by_path.keys().eq(b.by_path.keys()));
    let largest = |values: &[f64]| values.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let [a, b] = [a, b].map(|g| g.by_path.values().map(|t| t.to_vec().unwrap()).collect::<Vec<_>>());
    let floor = 1e-3 * a.iter().map(|a| largest(a)).fold(0.0, f64::max);
    let of = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let apart: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        largest(&apart) / largest(a).max(floor)
    };
    a.iter().zip(&b).map(of).fold(0.0, f64::max)
}

#[test]
fn the_vectors_training_step() {
    let vectors = load("training_step");
    let place = &places()[1];
    let case = Case::new(&vectors, place);
    let sizes = sampling::sizes(&case, case.dims("in.x0")[2]);
    let path = file("vectors.safetensors", case.setting("weight_seed").as_str().unwrap(), &sizes);
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    let training = Training::new(weights, sizes, Plan { at_once: 1, ..Plan::published() }).unwrap();
    let given = |name: &str| vectors.get(name).unwrap().clone();
    let latent = (&case.given("in.x_input") / Autoencoder::SCALE).value().unwrap().clone();
    let batch = Batch {
        latents: given("in.x0"),
        embeddings: given("in.clip_embed"),
        images: latent,
        elevations: case.numbers("elevation"),
        boxes: vec![],
    };
    let noise = case.given("in.noise");
    let draws = case.numbers("t").into_iter().zip(case.numbers("target_index")).enumerate();
    let draws: Vec<Draw> = draws
        .map(|(sample, (time, view))| Draw {
            time: time as usize,
            views: vec![view as usize],
            told: Told::All,
            noise: noise.select(0, sample).value().unwrap().clone(),
        })
        .collect();
    let found = training.gradients_at(&batch, &draws).unwrap();
    let expected = given("out.loss").item().unwrap();
    assert!((found.loss - expected).abs() < 1e-4 * expected, "{} for {expected}", found.loss);
    let mut compared = 0;
    for (name, expected) in vectors.tensors.iter().filter(|(name, _)| name.starts_with("grad.w.")) {
        // a rounding error may switch the ReLU of a whole region of a volume: compare by norm
        let limit = if name.contains("diffusion_model") { 1e-3 } else { 2e-2 };
        let found = found.by_path[&name["grad.w.".len()..]].to_vec().unwrap();
        let expected = expected.to_vec().unwrap();
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let error = norm(&mut found.iter().zip(&expected).map(|(a, b)| a - b));
        let size = norm(&mut expected.iter().copied());
        assert!(error <= limit * size + 1e-9, "{name}: off by {error:.1e} of {size:.1e}");
        compared += 1;
    }
    assert!(compared > 0, "no gradients in the file");
    assert!(found.by_path.keys().all(|path| {
        let rest = path.strip_prefix("model.diffusion_model.").unwrap_or(path);
        ["middle_conditions.", "output_conditions.", "spatial_volume.", "time_embed."]
            .iter()
            .any(|prefix| rest.starts_with(prefix))
            && path != "model.diffusion_model.time_embed.0.weight"
    }));
}

#[test]
fn groups_side_by_side_change_no_bit() {
    let path = file("side.safetensors", SEED, &tiny());
    let batch = batch(3);
    let [one, two] = [1, 2].map(|side_by_side| {
        let training = begin(&path, Plan { at_once: 1, side_by_side, ..plan() });
        let BatchGradients { loss, by_path, .. } = training.gradients(&batch).unwrap();
        (loss.to_bits(), bits(&by_path))
    });
    assert!(one == two);
}

#[test]
fn the_loss_falls_and_frozen_weights_stay() {
    let path = file("falls.safetensors", SEED, &tiny());
    let mut training = begin(&path, Plan { average: Some(0.9), ..plan() });
    let batch = batch(2);
    let validate = |training: &Training| (0..4).map(|turn| training.validate(&batch, turn).unwrap()).sum::<f64>();
    let before = validate(&training);
    assert_eq!(before.to_bits(), validate(&training).to_bits());
    for number in 1..=20 {
        let step = training.step(&batch).unwrap();
        assert!(step.loss.is_finite() && step.update.gradient_norm > 0.0);
        assert_eq!((step.update.step, training.steps()), (number, number));
    }
    let after = validate(&training);
    assert!(after < 0.9 * before, "{before} → {after}");

    let exported = scratch("exported.safetensors");
    training.export(&exported).unwrap();
    let (start, end) = (Archive::open(&path).unwrap(), Archive::open(&exported).unwrap());
    assert!(start.names().eq(end.names()) && end.metadata()["note"] == "kept");
    for name in start.names() {
        let [a, b] = [&start, &end].map(|archive| archive.load(name).unwrap());
        let is_trained = plan().trains(name);
        assert_eq!(is_trained, a.slice::<f32>() != b.slice::<f32>(), "{name}");
        // the average lags behind
        let now = training.params().get(name).ok().filter(|_| name.ends_with("conv0.weight"));
        assert!(now.is_none_or(|now| now.slice::<f32>() != b.slice::<f32>()), "{name}");
    }
    let mut plain = begin(&path, plan());
    plain.step(&batch).unwrap();
    plain.export(&exported).unwrap();
    let end = Archive::open(&exported).unwrap();
    for (name, value) in plain.params().iter() {
        assert_eq!(value.slice::<f32>(), end.load(name).unwrap().slice::<f32>(), "{name}");
    }
}

#[test]
fn an_interrupted_training_goes_on_bit_for_bit() {
    let path = file("resumed.safetensors", SEED, &tiny());
    let plan = Plan { average: Some(0.99), dropped: 0.1, warmup: 5, ..plan() };
    let (batch, saved) = (batch(3), scratch("saved.safetensors"));
    let mut through = begin(&path, plan.clone());
    for _ in 0..2 {
        through.step(&batch).unwrap();
    }
    through.save(&saved).unwrap();
    let losses: Vec<f64> = (0..3).map(|_| through.step(&batch).unwrap().loss).collect();

    let mut resumed = begin(&path, plan.clone());
    resumed.resume(&saved).unwrap();
    assert_eq!(resumed.steps(), 2);
    let again: Vec<f64> = (0..3).map(|_| resumed.step(&batch).unwrap().loss).collect();
    assert_eq!(losses, again);
    assert_eq!(bits(&params(&through)), bits(&params(&resumed)));
    let files = [scratch("a.safetensors"), scratch("b.safetensors")];
    through.export(&files[0]).unwrap();
    resumed.export(&files[1]).unwrap();
    let [a, b] = files.map(|file| bits(&TensorFile::read(file).unwrap().tensors));
    assert_eq!(a, b);

    let other = begin(&path, Plan { seed: 8, ..plan.clone() }).resume(&saved).unwrap_err().to_string();
    assert!(other.contains("seed") && other.contains("saved.safetensors"), "{other}");
    let fewer = Plan { trained: vec![("time_embed".into(), 1e-3)], ..plan };
    let mut fewer = begin(&path, fewer);
    let error = fewer.resume(&saved).unwrap_err().to_string();
    assert!(error.contains("unexpected"), "{error}");
    assert_eq!(fewer.steps(), 0);
}

#[test]
fn recomputing_gives_the_same_gradients_in_less_memory() {
    let path = file("recomputed.safetensors", SEED, &tiny());
    let of = |recomputed| begin(&path, Plan { recomputed, ..plan() }).gradients(&batch(2)).unwrap();
    let (kept, again) = (of(false), of(true));
    assert_eq!(kept.loss.to_bits(), again.loss.to_bits());
    assert!(difference(&kept, &again) < 1e-5, "{}", difference(&kept, &again));
    let (kept, again) = (kept.memory.peak, again.memory.peak);
    assert!(3 * again < 2 * kept, "{again} of {kept} bytes");
}

#[test]
fn a_batch_in_parts_equals_the_whole() {
    let path = file("parts.safetensors", SEED, &tiny());
    let plan = Plan { dropped: 0.2, ..plan() };
    let of = |at_once| begin(&path, Plan { at_once, ..plan.clone() }).gradients(&batch(4)).unwrap();
    let whole = of(4);
    for at_once in [2, 3] {
        let parts = of(at_once);
        assert!((whole.loss - parts.loss).abs() < 1e-6 * whole.loss, "{} for {}", parts.loss, whole.loss);
        assert!(difference(&whole, &parts) < 1e-4, "{}", difference(&whole, &parts));
        assert!(parts.memory.peak < whole.memory.peak);
    }
}

#[test]
fn a_gpu_takes_the_same_steps() {
    let path = file("gpu.safetensors", SEED, &tiny());
    let Some(place) = places().into_iter().find(|place| place.device != Device::Cpu) else { return };
    let plan = Plan { average: Some(0.5), recomputed: true, ..plan() };
    let [mut here, mut there] = [&Device::Cpu, &place.device].map(|device| begin_on(device, &path, plan.clone()));
    let (a, b) = (here.gradients(&batch(1)).unwrap(), there.gradients(&batch(1)).unwrap());
    assert!((a.loss - b.loss).abs() < 1e-4 * a.loss, "{} for {}", b.loss, a.loss);
    assert!(difference(&a, &b) < 2e-3, "{}", difference(&a, &b));
    assert!(there.params().iter().all(|(_, weight)| weight.device() == place.device));
    for training in [&mut here, &mut there] {
        training.step(&batch(1)).unwrap();
    }
    let saved = scratch("gpu-saved.safetensors");
    there.save(&saved).unwrap();
    here.resume(&saved).unwrap();
    assert!(here.params().iter().all(|(_, weight)| weight.device() == Device::Cpu));
    let [a, b] = [&here, &there].map(|training| training.validate(&batch(1), 0).unwrap());
    assert!((a - b).abs() < 1e-4 * a, "{b} for {a}");
}

#[test]
fn what_is_not_told_has_no_influence() {
    let path = file("told.safetensors", SEED, &tiny());
    let training = begin(&path, plan());
    let draw =
        |told| vec![Draw { time: 300, views: vec![1], told, noise: procedural::input(SEED, "noise", [2, 4, 8, 8]) }];
    let one = batch(1);
    let changed = |image: bool, token: bool| {
        let other = |name: &str, now: &Tensor| procedural::input(SEED, name, now.shape());
        let images = if image { other("image", &one.images) } else { one.images.clone() };
        let embeddings = if token { other("token", &one.embeddings) } else { one.embeddings.clone() };
        Batch { images, embeddings, ..one.clone() }
    };
    let loss = |batch: &Batch, told| training.gradients_at(batch, &draw(told)).unwrap().loss;
    for (told, image, token) in [
        (Told::All, true, true),
        (Told::NoImage, false, true),
        (Told::NoToken, true, false),
        (Told::NoVolumes, true, true),
        (Told::Nothing, false, false),
    ] {
        let before = loss(&one, told);
        assert_eq!(loss(&changed(true, false), told) != before, image, "image, {told:?}");
        assert_eq!(loss(&changed(false, true), told) != before, token, "token, {told:?}");
    }
    // volumes of zeros leave nothing to learn on the volume side
    let found = training.gradients_at(&one, &draw(Told::NoVolumes)).unwrap();
    let of_volumes = found.by_path.iter().filter(|(path, _)| path.starts_with("spatial_volume"));
    assert!(of_volumes.clone().count() > 10);
    for (path, gradient) in of_volumes {
        assert!(gradient.to_vec().unwrap().iter().all(|g| *g == 0.0), "{path}");
    }
}

#[test]
fn everything_can_be_trained() {
    let path = file("everything.safetensors", SEED, &tiny());
    for trained in ["", "model.diffusion_model"] {
        let mut training = begin(&path, Plan { trained: vec![(trained.into(), 1e-3)], ..plan() });
        let before = params(&training);
        // with 8 there would be a single pixel in the middle, whose attention to itself is not a matter of its query
        training.step(&batch_of(1, 16)).unwrap();
        let still = |(path, value): (&str, &Tensor)| before[path].slice::<f32>() == value.slice::<f32>();
        assert_eq!(training.params().iter().filter(|x| still(*x)).count(), 0);
        assert_eq!(before.contains_key("cc_projection.bias"), trained.is_empty());
        let of_block = |name: &str| format!("model.diffusion_model.input_blocks.1.1.transformer_blocks.0.{name}");
        assert!(
            before.contains_key(&of_block("attn1.to_q.weight")) && before.contains_key(&of_block("attn2.to_v.weight"))
        );
        assert!(!before.contains_key(&of_block("attn2.to_q.weight")));
    }
}

#[test]
fn a_single_view_model_gets_fresh_volumes() {
    let path = file("whole.safetensors", SEED, &tiny());
    let mut single = TensorFile::read(&path).unwrap();
    let plan = plan();
    single.tensors.retain(|name, _| !plan.trains(name));
    let path = scratch("single.safetensors");
    single.write(&path).unwrap();
    let mut training = begin(&path, plan.clone());
    assert!(training.params().iter().all(|(name, _)| plan.trains(name)));
    // the depth-wise attention of a fresh model starts as the identity
    let zeros = training.params().get("model.diffusion_model.output_conditions.0.proj_out.5.weight").unwrap();
    assert!(zeros.slice::<f32>().iter().all(|w| *w == 0.0));
    training.step(&batch(1)).unwrap();
    single.tensors.remove("cc_projection.bias");
    single.write(&path).unwrap();
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    let error = Training::new(weights, tiny(), plan).err().unwrap().to_string();
    assert!(error.contains("cc_projection.bias") && !error.contains("spatial_volume"), "{error}");
}

#[test]
fn plans_and_batches_that_do_not_fit_are_refused() {
    let path = file("refused.safetensors", SEED, &tiny());
    let refuse = |plan: Plan| {
        let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
        Training::new(weights, tiny(), plan).err().unwrap().to_string()
    };
    assert!(refuse(Plan { trained: vec![("spatial_volumes".into(), 1e-3)], ..plan() }).contains("spatial_volumes"));
    assert!(refuse(Plan { at_once: 0, ..plan() }).contains("0 samples at once"));
    assert!(refuse(Plan { side_by_side: 0, ..plan() }).contains("0 groups side by side"));
    assert!(refuse(Plan { dropped: 0.3, ..plan() }).contains("0.3"));
    let training = begin(&path, plan());
    let wrong = Batch { images: procedural::input(SEED, "x", [2, 4, 4, 4]), ..batch(2) };
    let error = training.gradients(&wrong).err().unwrap().to_string();
    assert!(error.contains("images") && error.contains("[2, 4, w, w]"), "{error}");
    assert!(training.gradients(&Batch { elevations: vec![], ..batch(1) }).is_err());
    let draw =
        Draw { time: 1000, views: vec![0], told: Told::All, noise: procedural::input(SEED, "noise", [2, 4, 8, 8]) };
    assert!(training.gradients_at(&batch(1), &[draw]).err().unwrap().to_string().contains("1000"));
    assert!(training.gradients_at(&batch(1), &[]).is_err());
}
