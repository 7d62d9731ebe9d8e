//! Noise schedule, sampler and a whole denoising step.

use crate::layers::Scope;
use crate::views::{Condition, Ddim, Denoiser, DenoiserSizes, Output, Ring, Schedule, Target, UnetSizes};
use gradreel::io::TensorFile;
use gradreel::{DType, Tape, Tensor};

use super::harness::{Case, close, gradient, load, places};
use super::{procedural, volumes};

fn table(values: &[f32]) -> Tensor {
    Tensor::from_vec(values.to_vec(), [values.len()])
}

#[test]
fn schedule() {
    let file = load("schedule");
    let schedule = Schedule::published();
    for (name, values) in
        [("betas", &schedule.betas), ("alphas", &schedule.alphas), ("alphas_cumprod", &schedule.alphas_cumprod)]
    {
        close(name, &table(values), file.get(name).unwrap(), 2e-5);
    }
    let told = |name: &str| name.strip_prefix("ddim")?.strip_suffix(".timesteps")?.parse::<usize>().ok();
    let all: Vec<usize> = file.tensors.keys().filter_map(|name| told(name)).collect();
    assert!(!all.is_empty());
    for steps in all {
        let of = |name: &str| file.get(&format!("ddim{steps}.{name}")).unwrap();
        let ddim = Ddim::new(&schedule, steps).unwrap();
        let times: Vec<f64> = ddim.times.iter().map(|t| *t as f64).collect();
        assert_eq!(times, of("timesteps").to_vec().unwrap());
        close("alphas", &table(&ddim.alphas), of("alphas"), 2e-5);
        close("alphas_prev", &table(&ddim.alphas_prev), of("alphas_prev"), 2e-5);
        close("sigmas", &table(&ddim.sigmas), of("sigmas"), 2e-5);
    }
    assert!(Ddim::new(&schedule, 0).is_err() && Ddim::new(&schedule, 1001).is_err());
    assert!(Ddim::new(&schedule, 1000).unwrap().times.iter().all(|t| *t < 1000));
}

#[test]
fn forward_noising_and_a_trajectory() {
    let file = load("schedule");
    let schedule = Schedule::published();
    let tape = Tape::new();
    let var = |name: &str| tape.constant(file.get(name).unwrap().cast(DType::F64).unwrap());
    let times: Vec<usize> = file.get("add_noise.t").unwrap().to_vec().unwrap().iter().map(|t| *t as usize).collect();
    let noised = schedule.add_noise(&var("add_noise.x0"), &var("add_noise.noise"), &times).unwrap();
    close("add_noise", noised.value().unwrap(), file.get("add_noise.out").unwrap(), 2e-5);

    let (x, eps, noise) = (var("traj.x"), var("traj.eps"), var("traj.noise"));
    let steps = eps.dims()[0];
    let ddim = Ddim::new(&schedule, steps).unwrap();
    let mut now = x.select(0, 0);
    for step in 0..steps {
        now = ddim.step(steps - 1 - step, &now, &eps.select(0, step), &noise.select(0, step));
        close(&format!("step {step}"), now.value().unwrap(), x.select(0, step + 1).value().unwrap(), 2e-5);
    }
}

/// The sizes that a file of the whole model tells, for latents of so many channels.
pub fn sizes(case: &Case<'_>, latent: usize) -> DenoiserSizes {
    DenoiserSizes {
        ring: Ring::published(case.size("views")),
        unet: UnetSizes {
            inputs: 2 * latent,
            outputs: latent,
            base: case.size("mc"),
            multipliers: case.sizes("mult"),
            heads: case.size("heads"),
            context: case.size("ctx"),
            volumes: case.sizes("vdims"),
        },
        volume: volumes::sizes(case, latent),
        spatial_aware: None,
        output: Default::default(),
    }
}

/// The steps of a file of denoising.
pub fn turns(file: &TensorFile) -> Vec<String> {
    let of = |name: &String| Some(name.strip_prefix("in.")?.strip_suffix(".index")?.to_owned());
    let all: Vec<String> = file.tensors.keys().filter_map(of).collect();
    assert!(!all.is_empty());
    all
}

/// The guidance of the results of a step.
pub fn guidances(file: &TensorFile, turn: &str) -> Vec<f64> {
    let start = format!("out.{turn}.cfg");
    let of = |name: &String| name.strip_prefix(&start)?.strip_suffix(".eps")?.parse().ok();
    let all: Vec<f64> = file.tensors.keys().filter_map(of).collect();
    assert!(!all.is_empty());
    all
}

#[test]
fn a_denoising_step_of_all_views() {
    let file = load("denoise_step");
    for place in places() {
        let case = Case::new(&file, &place);
        let sizes = sizes(&case, case.dims("in.x")[2]);
        let net = Denoiser::new(&case.scope(), &sizes).unwrap();
        let condition = Condition {
            embedding: case.given("in.clip_embed"),
            // the input image's latent is given scaled, and the model wants it as the encoder made it
            latent: &case.given("in.x_input") / crate::views::Autoencoder::SCALE,
            elevations: case.numbers("elevation"),
            boxes: vec![],
        };
        let x = case.given("in.x");
        let ddim = Ddim::new(&Schedule::published(), case.size("ddim_steps")).unwrap();
        for turn in turns(&file) {
            let index = case.numbers(&format!("{turn}.index"))[0] as usize;
            assert_eq!(ddim.times[index] as f64, case.numbers(&format!("{turn}.timestep"))[0]);
            let look = net.look(&x, &[ddim.times[index]], &condition).unwrap();
            for guidance in guidances(&file, &turn) {
                // in two unequal groups, which must not matter
                let targets: Vec<_> = (0..sizes.ring.views).map(|view| Target { sample: 0, view }).collect();
                let parts =
                    [&targets[..1], &targets[1..]].map(|group| net.noise(&look, &condition, group, guidance).unwrap());
                let predicted = parts[0].concat(&[&parts[1]], 0).reshape(x.shape());
                let next = ddim.step(index, &x, &predicted, &case.given(&format!("in.{turn}.noise")));
                for (what, value) in [("eps", predicted), ("x_prev", next)] {
                    let name = format!("out.{turn}.cfg{guidance}.{what}");
                    close(&name, value.value().unwrap(), file.get(&name).unwrap(), 1e-4);
                }
            }
        }
    }
}

#[test]
fn a_training_step() {
    let file = load("training_step");
    let case_of = |place| Case::new(&file, place);
    for place in &places() {
        let case = case_of(place);
        let net = Denoiser::new(&case.scope(), &sizes(&case, case.dims("in.x0")[2])).unwrap();
        let counts = |name: &str| case.numbers(name).iter().map(|v| *v as usize).collect::<Vec<_>>();
        let condition = Condition {
            embedding: case.given("in.clip_embed"),
            latent: &case.given("in.x_input") / crate::views::Autoencoder::SCALE,
            elevations: case.numbers("elevation"),
            boxes: vec![],
        };
        let pair = [&case.given("in.x0"), &case.given("in.noise")];
        let times = counts("t");
        let views = counts("target_index").into_iter().enumerate();
        let targets: Vec<Target> = views.map(|(sample, view)| Target { sample, view }).collect();
        let [loss, predicted] = net.loss(&Schedule::published(), pair, &times, &targets, &condition, &[]).unwrap();
        close("out.pred", predicted.value().unwrap(), file.get("out.pred").unwrap(), 5e-5);
        let expected = file.get("out.loss").unwrap().item().unwrap();
        assert!((loss.item().unwrap() - expected).abs() < 1e-4 * expected, "{}", loss.item().unwrap());
        let gradients = loss.backward().unwrap();
        for (name, expected) in file.tensors.iter().filter(|(name, _)| name.starts_with("grad.w.")) {
            let path = &name["grad.".len()..];
            // a rounding error may switch the ReLU of a whole region of a volume: compare by norm
            let limit = if name.contains("diffusion_model") { 1e-3 } else { 2e-2 };
            let found = gradient(&gradients, &case.leaf_of(path)).to_vec().unwrap();
            let expected = expected.to_vec().unwrap();
            let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
            let error = norm(&mut found.iter().zip(&expected).map(|(a, b)| a - b));
            let size = norm(&mut expected.iter().copied());
            assert!(error <= limit * size + 1e-9, "{name}: off by {error:.1e} of {size:.1e}");
        }
    }
}

/// A network whose result is the clean latents has the noise that the definition says, whatever the guidance.
#[test]
fn clean_latents_mean_a_noise() {
    let (time, sizes) = (400, super::tiny::sizes().denoiser);
    let source = procedural::Source { seed: "velocity", tape: Tape::new() };
    let given = |name: &str, shape: &[usize]| source.tape.constant(procedural::input("velocity", name, shape));
    let x = given("x", &[1, 4, 4, 8, 8]);
    let condition = Condition {
        embedding: given("embedding", &[1, 1, 8]),
        latent: given("latent", &[1, 4, 8, 8]),
        elevations: vec![0.3],
        boxes: vec![],
    };
    let targets = [1, 3].map(|view| Target { sample: 0, view });
    for guidance in [1.0, 2.5] {
        let [noise, clean] = [Output::Noise, Output::Clean].map(|output| {
            let sizes = DenoiserSizes { output, ..sizes.clone() };
            let net = Denoiser::new(&Scope::root(&source), &sizes).unwrap();
            let look = net.look(&x, &[time], &condition).unwrap();
            net.noise(&look, &condition, &targets, guidance).unwrap()
        });
        let [signal, left] = Schedule::published().weights(time);
        assert!((signal * signal + left * left - 1.0).abs() < 1e-6);
        let of_view = |view: usize| x.slice(1, view..view + 1).reshape([1, 4, 8, 8]);
        // the other network has the same weights: its noise read as clean latents
        let expected = &(&of_view(1).concat(&[&of_view(3)], 0) - &(&noise * signal)) * (1.0 / left);
        close("noise", clean.value().unwrap(), expected.value().unwrap(), 1e-6);
    }
}

/// The loss of clean latents is their own error, however much noise there was.
#[test]
fn clean_latents_are_judged_by_themselves() {
    let (time, sizes) = (700, super::tiny::sizes().denoiser);
    let source = procedural::Source { seed: "velocity", tape: Tape::new() };
    let given = |name: &str, shape: &[usize]| source.tape.constant(procedural::input("velocity", name, shape));
    let (x0, noise) = (given("x", &[1, 4, 4, 8, 8]), given("noise", &[1, 4, 4, 8, 8]));
    let condition = Condition {
        embedding: given("embedding", &[1, 1, 8]),
        latent: given("latent", &[1, 4, 8, 8]),
        elevations: vec![0.3],
        boxes: vec![],
    };
    let schedule = Schedule::published();
    let net = Denoiser::new(&Scope::root(&source), &DenoiserSizes { output: Output::Clean, ..sizes }).unwrap();
    let targets = [Target { sample: 0, view: 2 }];
    let [loss, clean] = net.loss(&schedule, [&x0, &noise], &[time], &targets, &condition, &[]).unwrap();
    let expected = (&clean - &x0.select(1, 2)).square().mean_all().item().unwrap();
    let found = loss.item().unwrap();
    assert!((found - expected).abs() < 1e-5 * expected, "{found} for {expected}");
}
