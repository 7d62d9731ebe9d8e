//! The networks of the multi-view model at the published sizes, in seconds, and beside PyTorch where
//! `target/pytorch-views-N.json` is there (`models/benches/views_pytorch.py` writes it).
//!
//! `cargo bench -p gradreel-models --bench views -- [threads] [filter] [profile]`; with `profile` the time of each op
//! follows each case.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Instant;

use gradreel::{Key, Result, Shape, Tape, Var};
use gradreel_models::layers::{Init, Scope, Weights};
use gradreel_models::views::objects::{Sample, SampleSettings};
use gradreel_models::views::{
    Autoencoder, AutoencoderSizes, ClipSizes, ClipTower, Condition, Denoiser, FrustumNet, FrustumSizes, ImageBox,
    ModelSizes, Schedule, SpatialNet, SpatialSizes, Target, Unet, UnetSizes, VolumeSizes,
};

#[path = "../src/views/tests/procedural.rs"]
mod procedural;

use procedural::{Source, input};

/// Inputs of a network by name.
type Given<'a> = dyn Fn(&str, &[usize]) -> Var + 'a;
/// A network, waiting for inputs.
type Network = Box<dyn Fn(&Given<'_>) -> Result<Var>>;

struct Case {
    name: &'static str,
    gflop: f64,
    build: fn(&Scope<'_>) -> Result<Network>,
}

const SIZES: VolumeSizes = VolumeSizes::PUBLISHED;

const CASES: &[Case] = &[
    Case { name: "unet", gflop: 202.0, build: |scope| unet(scope, 1, false) },
    Case { name: "unet with guidance", gflop: 404.0, build: |scope| unet(scope, 1, true) },
    Case { name: "unet of four views", gflop: 808.0, build: |scope| unet(scope, 4, false) },
    Case {
        name: "spatial volume",
        gflop: 55.3,
        build: |scope| {
            let sizes = SpatialSizes { inputs: 256, widths: SIZES.spatial, time: SIZES.time };
            let net = SpatialNet::new(scope, sizes)?;
            Ok(Box::new(move |given| net.forward(&given("x", &[1, 256, 32, 32, 32]), &given("t", &[1, 256]))))
        },
    },
    Case {
        name: "frustum pyramid",
        gflop: 29.9,
        build: |scope| {
            let sizes = FrustumSizes { inputs: 64, widths: SIZES.frustum, time: SIZES.time, view: 4 };
            let net = FrustumNet::new(scope, sizes)?;
            Ok(Box::new(move |given| {
                let [x, t, v] = [("x", &[1, 64, 48, 32, 32][..]), ("t", &[1, 256]), ("v", &[1, 4])]
                    .map(|(name, shape)| given(name, shape));
                Ok(net.forward(&x, &t, &v)?[0].clone())
            }))
        },
    },
    Case {
        name: "decode",
        gflop: 622.2,
        build: |scope| {
            let net = Autoencoder::new(scope, &AutoencoderSizes::published())?;
            Ok(Box::new(move |given| Ok(net.decode(&given("z", &[1, 4, 32, 32])))))
        },
    },
    Case {
        name: "encode",
        gflop: 272.7,
        build: |scope| {
            let net = Autoencoder::new(scope, &AutoencoderSizes::published())?;
            Ok(Box::new(move |given| Ok(net.moments(&given("image", &[1, 3, 256, 256])))))
        },
    },
    Case {
        name: "clip",
        gflop: 162.0,
        build: |scope| {
            let net = ClipTower::new(scope, ClipSizes::PUBLISHED)?;
            Ok(Box::new(move |given| Ok(net.forward(&given("image", &[1, 3, 224, 224])))))
        },
    },
];

fn unet(scope: &Scope<'_>, views: usize, guided: bool) -> Result<Network> {
    let net = Unet::new(scope, &UnetSizes::PUBLISHED)?;
    Ok(Box::new(move |given| {
        let volume = |width: usize, channels: usize| {
            given(&format!("volume_{width}"), &[views, channels, width * 3 / 2, width, width])
        };
        let volumes = [volume(32, 64), volume(16, 128), volume(8, 256), volume(4, 512)];
        let (x, context) = (given("x", &[views, 8, 32, 32]), given("context", &[views, 1, 768]));
        let times = vec![501.0; views];
        let seen = net.forward(&x, &times, &context, Some(&volumes))?;
        if !guided {
            return Ok(seen);
        }
        let nothing = net.forward(&x, &times, &(&context * 0.0), None)?;
        Ok(&nothing + &(&(&seen - &nothing) * 2.0))
    }))
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let profile = arguments.iter().position(|a| a == "profile").map(|at| arguments.remove(at)).is_some();
    let threads = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(2);
    let filter = arguments.iter().find(|a| a.parse::<usize>().is_err()).cloned().unwrap_or_default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    let peer = std::fs::read(format!("{}/../target/pytorch-views-{threads}.json", env!("CARGO_MANIFEST_DIR")));
    let peer: serde_json::Value = peer.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    println!("{}, {threads} threads", gradreel::isa());
    println!("{:24} {:>9} {:>10} {:>10} {:>10}", "case", "s", "GFLOP/s", "PyTorch s", "ratio");
    for case in CASES.iter().filter(|case| case.name.contains(&filter)) {
        pool.install(|| time(case, &peer, profile));
    }
    for (name, trained) in [("small: step of the model", ""), ("small: step of the module", "spatial_aware.")] {
        if name.contains(&filter) {
            pool.install(|| step(name, trained, profile));
        }
    }
    if "small: objects of a step".contains(&filter) {
        pool.install(|| {
            let sizes = ModelSizes::small();
            let (settings, begin) = (SampleSettings::default(), Instant::now());
            for i in 0..4 {
                Sample::draw(Key::new(1).fold(i), &sizes.denoiser.ring, sizes.image, &settings);
            }
            println!("{:24} {:9.3}", "small: objects of a step", begin.elapsed().as_secs_f64());
        });
    }
}

/// Weights of which some are trained.
struct Leaves<'a> {
    tape: &'a Tape,
    trained: &'a str,
}

impl Weights for Leaves<'_> {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        let value = procedural::weight("bench", path, shape);
        Ok(if path.starts_with(self.trained) { self.tape.leaf(value) } else { self.tape.constant(value) })
    }
}

/// Loss and gradients of the built-in model: four samples of four views each.
fn step(name: &str, trained: &str, profile: bool) {
    let mut sizes = ModelSizes::small().denoiser;
    if trained.is_empty() {
        sizes.spatial_aware = None;
    }
    let run = |tape: &Tape| {
        let weights = Leaves { tape, trained };
        let net = Denoiser::new(&Scope::root(&weights), &sizes).expect("the sizes are sound");
        let given = |name: &str, shape: &[usize]| tape.constant(input("bench", name, Shape::from(shape)));
        let condition = Condition {
            embedding: given("embedding", &[4, 1, 32]),
            latent: given("image", &[4, 48, 16, 16]),
            elevations: vec![0.5; 4],
            boxes: vec![Some(ImageBox { low: [0.3; 2], high: [0.6; 2] }.into()); 4],
        };
        let [x0, noise] = ["x0", "noise"].map(|name| given(name, &[4, 16, 48, 16, 16]));
        let targets: Vec<Target> = (0..16).map(|i| Target { sample: i / 4, view: i }).collect();
        let begin = Instant::now();
        let times = [100, 300, 500, 900];
        let [loss, _] =
            net.loss(&Schedule::published(), [&x0, &noise], &times, &targets, &condition, &[]).expect("a loss");
        loss.into_gradients().expect("gradients");
        begin.elapsed().as_secs_f64()
    };
    run(&Tape::new());
    let best = (0..3).map(|_| run(&Tape::new())).fold(f64::INFINITY, f64::min);
    println!("{name:24} {best:9.3}");
    if profile {
        let tape = Tape::with_profile();
        run(&tape);
        println!("{}", tape.profile());
    }
}

fn time(case: &Case, peer: &serde_json::Value, profile: bool) {
    let source = Source { seed: "bench", tape: Tape::new() };
    let network = (case.build)(&Scope::root(&source)).expect("the published sizes are sound");
    let made = RefCell::new(BTreeMap::new());
    let run = |tape: &Tape| {
        let given = |name: &str, shape: &[usize]| {
            let mut made = made.borrow_mut();
            let value = made.entry(name.to_owned()).or_insert_with(|| input("bench", name, Shape::from(shape)));
            tape.constant(value.clone())
        };
        let begin = Instant::now();
        let result = network(&given).and_then(|y| y.value().cloned()).expect("a result");
        assert!(!result.is_empty());
        begin.elapsed().as_secs_f64()
    };
    run(&Tape::new());
    let best = (0..4).map(|_| run(&Tape::new())).fold(f64::INFINITY, f64::min);
    let theirs = peer[case.name]["forward"].as_f64().map(|ms| ms * 1e-3);
    let beside = theirs.map_or(String::new(), |s| format!("{s:10.3} {:10.2}", best / s));
    println!("{:24} {best:9.3} {:10.0} {beside}", case.name, case.gflop / best);
    if profile {
        let tape = Tape::with_profile();
        run(&tape);
        println!("{}", tape.profile());
    }
}
