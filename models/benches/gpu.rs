//! What a GPU does with the crate's kernels, each beside the adapter's own rates.
//!
//! `cargo bench -p gradreel-models --bench gpu -- [filter] [small]`; `small` shrinks every case, for a software driver.
//! A line of the output is `case, quantity, value, unit`, separated by tabs; `benches/gpu.sh` makes JSON and a table of
//! them. Times are the least of several runs, each long enough to hide what a submission and a read-back cost.

mod bodies;

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::time::Instant;

use bodies::ball;
use gradreel::backend::gpu::{Gpu, Kernel, Work};
use gradreel::ops::{self, Conv, registry};
use gradreel::{DType, Device, Error, ErrorKind, Key, Result, Shape, Spec, Tape, Tensor, Var};
use gradreel_models::layers::{Init, Scope, Weights};
use gradreel_models::physics::{
    Collider, GpuSimulation, Remat, Simulation, State, Values, World, materials, neighbours,
};
use gradreel_models::views::{Condition, Denoiser, ImageBox, ModelSizes, Schedule, Target, Unet, UnetSizes};

/// Fused multiply-adds in registers: per invocation ROUNDS times 8 vectors of four numbers.
static MULTIPLY_ADD: Kernel = Kernel::new(
    "multiply_add",
    "main",
    "const ROUNDS: u32 = 512u;
    @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    @group(0) @binding(1) var<storage, read> x: array<f32>;
    @compute @workgroup_size(256)
    fn main(@builtin(global_invocation_id) id: vec3<u32>) {
        if id.x >= arrayLength(&y) {
            return;
        }
        let m = vec4(x[0]);
        let c = vec4(x[1]);
        var a0 = vec4(f32(id.x));
        var a1 = a0 + 1.0;
        var a2 = a0 + 2.0;
        var a3 = a0 + 3.0;
        var a4 = a0 + 4.0;
        var a5 = a0 + 5.0;
        var a6 = a0 + 6.0;
        var a7 = a0 + 7.0;
        for (var i = 0u; i < ROUNDS; i++) {
            a0 = fma(a0, m, c);
            a1 = fma(a1, m, c);
            a2 = fma(a2, m, c);
            a3 = fma(a3, m, c);
            a4 = fma(a4, m, c);
            a5 = fma(a5, m, c);
            a6 = fma(a6, m, c);
            a7 = fma(a7, m, c);
        }
        let sum = a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7;
        y[id.x] = sum.x + sum.y + sum.z + sum.w;
    }",
    &["y", "x"],
);

/// What all cases share.
struct Bench {
    gpu: Gpu,
    small: bool,
    /// Multiply-adds, in operations per second; measured when first needed.
    peak: Cell<f64>,
}

type Case = fn(&Bench) -> Result<()>;

const CASES: &[(&str, Case)] = &[
    ("parity", parity),
    ("rates", |bench| bench.rates()),
    ("gemm", gemm),
    ("conv2d", conv2d),
    ("conv3d", conv3d),
    ("attention", attention),
    ("mpm 100k", |bench| mpm(bench, 100_000)),
    ("mpm 1M", |bench| mpm(bench, 1_000_000)),
    ("unet", unet),
    ("training", training),
];

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let small = arguments.iter().position(|word| word == "small").map(|at| arguments.remove(at)).is_some();
    let filter = arguments.first().cloned().unwrap_or_default();
    let gpu = Gpu::open().unwrap_or_else(|error| {
        eprintln!("error: {error}");
        std::process::exit(2)
    });
    println!("adapter\tname\t{}\t", gpu.name());
    println!("adapter\tbinding\t{}\tbytes", gpu.limits().binding_bytes);
    let bench = Bench { gpu, small, peak: Cell::new(0.0) };
    let mut failed = false;
    for (name, case) in CASES.iter().filter(|(name, _)| name.contains(&filter)) {
        if let Err(error) = case(&bench) {
            println!("{name}\tfailed\t{}\t", error.to_string().replace(['\n', '\t'], " "));
            failed = true;
        }
    }
    std::process::exit(i32::from(failed));
}

fn row(case: &str, quantity: &str, value: f64, unit: &str) {
    println!("{case}\t{quantity}\t{value:.4}\t{unit}");
}

impl Bench {
    fn device(&self) -> Device {
        Device::Gpu(self.gpu.clone())
    }

    fn or(&self, full: usize, small: usize) -> usize {
        if self.small { small } else { full }
    }

    fn numbers(&self, seed: u64, shape: impl Into<Shape>) -> Result<Tensor> {
        Tensor::normal_on(&self.device(), Key::new(seed), shape, DType::F32)
    }

    /// The least seconds of one run. A run returns what has to be there when the clock stops.
    fn seconds(&self, run: impl Fn() -> Result<Tensor>) -> Result<f64> {
        let turns = |count: usize| -> Result<f64> {
            let begin = Instant::now();
            let mut last = None;
            for _ in 0..count {
                last = Some(run()?);
            }
            let tape = Tape::new();
            let last = tape.constant(last.expect("at least one run"));
            let len = last.shape().len();
            last.reshape([len]).slice(0, 0..1).item()?;
            Ok(begin.elapsed().as_secs_f64() / count as f64)
        };
        let first = turns(1)?;
        if self.small {
            return Ok(first);
        }
        let once = turns(1)?;
        let count = ((0.3 / once) as usize).clamp(1, 200);
        (0..4).try_fold(once, |least, _| Ok(least.min(turns(count)?)))
    }

    /// Operations per second of multiply-adds, measured once.
    fn peak(&self) -> Result<f64> {
        if self.peak.get() == 0.0 {
            let count = self.or(1 << 22, 1 << 12);
            let x = Tensor::from_vec(vec![0.999_f32, 1e-3], [2]).to_device(&self.device())?;
            let y = self.gpu.empty(Spec::new([count], DType::F32))?;
            let time = self.seconds(|| {
                self.gpu.dispatch(&MULTIPLY_ADD, &[&y, &x], &[], Work::Invocations(count))?;
                Ok(y.clone())
            })?;
            let rounds = MULTIPLY_ADD.reflect()?.constant("ROUNDS");
            self.peak.set((count * rounds * 8 * 4 * 2) as f64 / time);
        }
        Ok(self.peak.get())
    }

    fn rates(&self) -> Result<()> {
        row("multiply-add f32", "rate", self.peak()? * 1e-12, "TFLOP/s");
        let x = self.numbers(1, [self.or(1 << 25, 1 << 16)])?;
        let time = self.seconds(|| (&Tape::new().constant(x.clone()) * 1.5).value().cloned())?;
        row("scaling 128 MiB", "rate", 2.0 * x.bytes() as f64 / time * 1e-9, "GB/s");
        Ok(())
    }

    /// Rows of something differentiable with so many operations forward, and twice as many backward.
    fn both(&self, case: &str, flop: f64, operands: &[Tensor], run: impl Fn(&[Var]) -> Var) -> Result<()> {
        let forward = self.seconds(|| {
            let tape = Tape::new();
            let operands: Vec<Var> = operands.iter().map(|x| tape.constant(x.clone())).collect();
            run(&operands).value().cloned()
        })?;
        let with_gradients = self.seconds(|| {
            let tape = Tape::new();
            let operands: Vec<Var> = operands.iter().map(|x| tape.leaf(x.clone())).collect();
            let gradients = run(&operands).sum_all().into_gradients()?;
            let found = operands.iter().map(|x| gradients.wrt(x).cloned()).collect::<Result<Vec<_>>>()?;
            Ok(found.into_iter().next().expect("an operand"))
        })?;
        row(case, "forward", forward * 1e3, "ms");
        row(case, "forward", flop / forward * 1e-12, "TFLOP/s");
        row(case, "forward", 100.0 * flop / forward / self.peak()?, "% of multiply-add");
        row(case, "with gradients", with_gradients * 1e3, "ms");
        row(case, "with gradients", 3.0 * flop / with_gradients * 1e-12, "TFLOP/s");
        Ok(())
    }
}

/// The largest difference of two tensors' finite numbers relative to the largest number of the second, at least 1.
fn apart(found: &Tensor, wanted: &Tensor) -> Result<f64> {
    let (found, wanted) = (found.to_vec()?, wanted.to_vec()?);
    let largest = wanted.iter().filter(|x| x.is_finite()).fold(1.0, |m: f64, x| m.max(x.abs()));
    let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
    let pairs = found.iter().zip(&wanted).filter(|(a, b)| !same(**a, **b));
    Ok(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, |m: f64, x| if x.is_finite() { m.max(x) } else { f64::INFINITY })
        / largest)
}

/// Every op of the registry against the CPU in the same precision: the worst of all cases, so that an op that is wrong hides no
/// other one.
fn parity(bench: &Bench) -> Result<()> {
    for entry in registry().iter().filter(|entry| entry.gpu) {
        let (mut forward, mut gradient) = (0.0f64, 0.0f64);
        for case in (entry.cases)() {
            let on = |device: &Device| -> Result<(Tensor, Vec<Tensor>)> {
                let tape = Tape::new();
                let place = |x: &Tensor| -> Result<Var> {
                    Ok(match x.dtype() {
                        DType::U32 => tape.constant(x.to_device(device)?),
                        _ => tape.leaf(x.cast(DType::F32)?.to_device(device)?),
                    })
                };
                let inputs = case.inputs.iter().map(place).collect::<Result<Vec<Var>>>()?;
                let y = tape.apply(case.op.clone(), &inputs.iter().collect::<Vec<_>>())?;
                let value = y.value()?.to_device(&Device::Cpu)?;
                if y.dtype() == DType::U32 {
                    return Ok((value, Vec::new()));
                }
                let w = ops::uniform(9, y.shape(), 0.5..1.5).cast(DType::F32)?.to_device(device)?;
                let gradients = (&y * &tape.constant(w)).sum_all().backward()?;
                let leaves = inputs.iter().filter(|x| x.is_differentiable());
                let found = leaves.map(|x| gradients.wrt(x)?.to_device(&Device::Cpu)).collect::<Result<_>>()?;
                Ok((value, found))
            };
            let (found, wanted) = (on(&bench.device())?, on(&Device::Cpu)?);
            forward = forward.max(apart(&found.0, &wanted.0)?);
            for (found, wanted) in found.1.iter().zip(&wanted.1) {
                gradient = gradient.max(apart(found, wanted)?);
            }
        }
        row(entry.name, "forward off by", forward * 1e6, "millionths");
        row(entry.name, "gradients off by", gradient * 1e6, "millionths");
    }
    Ok(())
}

fn gemm(bench: &Bench) -> Result<()> {
    for side in if bench.small { vec![64] } else { vec![1024, 4096] } {
        let operands = [bench.numbers(1, [side, side])?, bench.numbers(2, [side, side])?];
        let flop = 2.0 * (side as f64).powi(3);
        bench.both(&format!("gemm {side}^3"), flop, &operands, |v| v[0].matmul(&v[1]))?;
    }
    Ok(())
}

fn convolution(bench: &Bench, x: &[usize], weight: &[usize]) -> Result<()> {
    let operands = [bench.numbers(1, x)?, bench.numbers(2, weight)?];
    let places: usize = x[2..].iter().product();
    let flop = 2.0 * (weight.iter().product::<usize>() * x[0] * places) as f64;
    let name = format!("conv{}d {}->{} @{}^{} x {}", x.len() - 2, x[1], weight[0], x[2], x.len() - 2, x[0]);
    bench.both(&name, flop, &operands, |v| v[0].conv(&v[1], None, &Conv::new().padding(1)))
}

fn conv2d(bench: &Bench) -> Result<()> {
    let channels = bench.or(320, 8);
    for batch in [1, bench.or(16, 2)] {
        convolution(bench, &[batch, channels, 32, 32], &[channels, channels, 3, 3])?;
    }
    Ok(())
}

fn conv3d(bench: &Bench) -> Result<()> {
    let (channels, side) = (bench.or(64, 4), bench.or(32, 8));
    for batch in [1, bench.or(8, 2)] {
        convolution(bench, &[batch, channels, side, side, side], &[channels, channels, 3, 3, 3])?;
    }
    Ok(())
}

fn attention(bench: &Bench) -> Result<()> {
    let (heads, tokens, channels) = (8, bench.or(1024, 64), 40);
    for batch in [1, bench.or(16, 2)] {
        let operand = |seed| bench.numbers(seed, [batch, heads, tokens, channels]);
        let operands = [operand(1)?, operand(2)?, operand(3)?];
        let flop = (4 * batch * heads * tokens * tokens * channels) as f64;
        let scale = (channels as f64).powf(-0.5);
        let name = format!("attention {tokens}x{heads}x{channels} x {batch}");
        bench.both(&name, flop, &operands, |v| v[0].attention(&v[1], &v[2], scale, None))?;
    }
    Ok(())
}

/// A ball that rests on a sticky floor: grid spacing 2 cm, 8 particles per cell. Nanoseconds per particle and substep are
/// differences of two runs, so that copying the state counts in neither.
fn mpm(bench: &Bench, full: usize) -> Result<()> {
    let count = bench.or(full, full / 200);
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
    let positions = ball(count, world.dx);
    let order = neighbours(world.dx, &positions, |_| 0);
    let positions: Vec<[f32; 3]> = order.iter().map(|&p| positions[p as usize].map(|x| x as f32)).collect();
    let start = State::at_rest(&positions, &vec![[0.0, -1.0, 0.0]; count])?;
    let [few, many] = if bench.small { [2, 4] } else { [20, 20 + (60_000_000 / count).clamp(40, 400)] };
    for (name, parameters) in [
        ("neo_hookean", vec![1e5, 0.3]),
        ("von_mises", vec![1e5, 0.3, 2e3]),
        ("drucker_prager", vec![1e5, 0.3, 35.0, 0.0]),
    ] {
        let law = materials::find(name).expect("a shipped material");
        let parameters = parameters.into_iter().map(Values::Same).collect();
        let plan = Simulation::new(&world, &law, 2e-4, count, &Values::Same(1000.0), parameters)?;
        let simulation = GpuSimulation::new(&bench.gpu, plan)?;
        let per = |run: &dyn Fn(usize) -> Result<()>| -> Result<f64> {
            let time = |steps: usize| -> Result<f64> {
                let begin = Instant::now();
                run(steps)?;
                Ok(begin.elapsed().as_secs_f64())
            };
            time(few)?;
            let mut least = [f64::INFINITY; 2];
            for _ in 0..if bench.small { 1 } else { 3 } {
                least = [least[0].min(time(few)?), least[1].min(time(many)?)];
            }
            Ok((least[1] - least[0]) / ((many - few) * count) as f64 * 1e9)
        };
        let forward = per(&|steps| simulation.run(&start, steps).map(drop))?;
        let both = per(&|steps| simulation.run_vjp(&start, steps, Remat::None, &start).map(drop))?;
        let case = format!("mpm {name} {count}");
        row(&case, "forward", forward, "ns per particle and substep");
        row(&case, "reverse", both - forward, "ns per particle and substep");
    }
    Ok(())
}

/// Random weights that stay on the device, each made when it is first asked for.
struct OnDevice<'a> {
    bench: &'a Bench,
    made: &'a RefCell<BTreeMap<String, Tensor>>,
    tape: &'a Tape,
    trained: bool,
}

impl OnDevice<'_> {
    fn tensor(&self, name: &str, shape: &Shape, scale: f64, offset: f64) -> Result<Tensor> {
        if let Some(known) = self.made.borrow().get(name) {
            return Ok(known.clone());
        }
        let key = Key::new(self.made.borrow().len() as u64);
        let values = Tensor::normal_on(&self.bench.device(), key, shape.clone(), DType::F32)?;
        let tape = Tape::new();
        let values = (&(&tape.constant(values) * scale) + offset).value()?.clone();
        self.made.borrow_mut().insert(name.to_owned(), values.clone());
        Ok(values)
    }

    /// An input of variance 1.
    fn given(&self, name: &str, shape: &[usize]) -> Result<Var> {
        Ok(self.tape.constant(self.tensor(&format!("input {name}"), &Shape::from(shape), 1.0, 0.0)?))
    }
}

impl Weights for OnDevice<'_> {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        let dims = shape.dims();
        let value = match dims.len() {
            0 | 1 => self.tensor(path, shape, 0.1, if path.ends_with("weight") { 1.0 } else { 0.0 })?,
            _ => self.tensor(path, shape, (dims[1..].iter().product::<usize>() as f64).powf(-0.5), 0.0)?,
        };
        Ok(if self.trained { self.tape.leaf(value) } else { self.tape.constant(value) })
    }
}

/// The denoising network at the published size (of the built-in model if `small`): a pass, and a step with guidance.
fn unet(bench: &Bench) -> Result<()> {
    let (sizes, gflop) = match bench.small {
        true => (ModelSizes::small().denoiser.unet, 0.0),
        false => (UnetSizes::PUBLISHED, 202.0),
    };
    let made = RefCell::new(BTreeMap::new());
    let width = if bench.small { 16 } else { 32 };
    let run = |views: usize, guided: bool| -> Result<Tensor> {
        let tape = Tape::new();
        let source = OnDevice { bench, made: &made, tape: &tape, trained: false };
        let net = Unet::new(&Scope::root(&source), &sizes)?;
        let given = |name: &str, shape: &[usize]| source.given(&format!("{name} {views}"), shape);
        let volumes = (0..4)
            .map(|level| {
                let side = width >> level;
                let depth = if bench.small { side } else { side * 3 / 2 };
                given(&format!("volume {level}"), &[views, sizes.volumes[level], depth, side, side])
            })
            .collect::<Result<Vec<Var>>>()?;
        let volumes: [Var; 4] = volumes.try_into().map_err(|_| Error::new(ErrorKind::Shape, "four volumes"))?;
        let x = given("x", &[views, sizes.inputs, width, width])?;
        let context = given("context", &[views, 1, sizes.context])?;
        let times = vec![501.0; views];
        let seen = net.forward(&x, &times, &context, Some(&volumes))?;
        if !guided {
            return seen.value().cloned();
        }
        let nothing = net.forward(&x, &times, &(&context * 0.0), None)?;
        (&nothing + &(&(&seen - &nothing) * 2.0)).value().cloned()
    };
    for (name, views, guided) in [("unet", 1, false), ("unet with guidance", 1, true), ("unet of 16 views", 16, false)]
    {
        let views = if bench.small { views.min(2) } else { views };
        let time = bench.seconds(|| run(views, guided))?;
        row(name, "forward", time * 1e3 / views as f64, "ms per view");
        let passes = if guided { 2.0 } else { 1.0 };
        if gflop > 0.0 {
            row(name, "forward", passes * gflop * views as f64 / time * 1e-3, "TFLOP/s");
        }
    }
    Ok(())
}

/// Loss and gradients of the built-in model, four views of each sample; the optimiser is not in it.
fn training(bench: &Bench) -> Result<()> {
    let mut sizes = ModelSizes::small().denoiser;
    sizes.spatial_aware = None;
    let made = RefCell::new(BTreeMap::new());
    for samples in if bench.small { vec![1] } else { vec![4, 16] } {
        let run = || -> Result<Tensor> {
            let tape = Tape::new();
            let source = OnDevice { bench, made: &made, tape: &tape, trained: true };
            let net = Denoiser::new(&Scope::root(&source), &sizes)?;
            let given = |name: &str, shape: &[usize]| source.given(&format!("{name} {samples}"), shape);
            let condition = Condition {
                embedding: given("embedding", &[samples, 1, sizes.unet.context])?,
                latent: given("image", &[samples, 48, 16, 16])?,
                elevations: vec![0.5; samples],
                boxes: vec![Some(ImageBox { low: [0.3; 2], high: [0.6; 2] }.into()); samples],
            };
            let shape = [samples, 16, 48, 16, 16];
            let (x0, noise) = (given("x0", &shape)?, given("noise", &shape)?);
            let targets: Vec<Target> = (0..4 * samples).map(|i| Target { sample: i / 4, view: 4 * (i % 4) }).collect();
            let times: Vec<usize> = (0..samples).map(|i| 100 + 800 * i / samples).collect();
            let [loss, _] = net.loss(&Schedule::published(), [&x0, &noise], &times, &targets, &condition, &[])?;
            let value = loss.value()?.clone();
            loss.into_gradients()?;
            Ok(value)
        };
        let time = bench.seconds(run)?;
        row(&format!("training, {samples} samples"), "loss and gradients", time * 1e3, "ms");
    }
    Ok(())
}
