//! What the emitted WGSL computes, against the same program in `f64` on the CPU.
//!
//! Needs an adapter, real or software; says so and passes where there is none, unless `CI` is `true`.

use gradreel::scalar::{Mat3, Program, Scalar};
use wgpu::util::DeviceExt;

struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl Gpu {
    fn open() -> Option<Self> {
        let instance = wgpu::Instance::default();
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).ok()?;
        Some(Self { device, queue })
    }

    /// A program of one input and one output over all of `x`.
    fn map(&self, program: &Program, x: &[f32]) -> Vec<f32> {
        let source = format!(
            "{}
            @group(0) @binding(0) var<storage, read> x: array<f32>;
            @group(0) @binding(1) var<storage, read_write> y: array<f32>;
            @compute @workgroup_size(64)
            fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
                if id.x < arrayLength(&x) {{
                    y[id.x] = {}(x[id.x]);
                }}
            }}",
            program.wgsl(),
            program.wgsl_name()
        );
        let device = &self.device;
        let label = Some(program.name());
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let contents = bytemuck::cast_slice(x);
        let usage = wgpu::BufferUsages::STORAGE;
        let input = device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label, contents, usage });
        let size = contents.len() as u64;
        let buffer =
            |usage| device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false });
        let output = buffer(usage | wgpu::BufferUsages::COPY_SRC);
        let read_back = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: input.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: output.as_entire_binding() },
            ],
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.dispatch_workgroups(x.len().div_ceil(64) as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&output, 0, &read_back, 0, size);
        self.queue.submit([encoder.finish()]);
        read_back.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the buffer can be mapped"));
        device.poll(wgpu::PollType::wait_indefinitely()).expect("the device answers");
        let bytes = read_back.slice(..).get_mapped_range().expect("the buffer is mapped");
        bytemuck::cast_slice(&bytes[..]).to_vec()
    }
}

type Function = fn(Scalar) -> Scalar;

/// A matrix that grows with `x`, regular and singular by turns.
fn sheared(x: Scalar) -> Mat3 {
    let number = |value: f64| Scalar::from(value);
    Mat3([[number(1.0), x, number(0.0)], [0.3 * x, number(1.0), 0.2 * x], [number(0.0), number(0.1), 1.0 - x]])
}

/// Functions with the relative error they may have; differences below 1e-37 do not count, since devices may flush
/// subnormal numbers.
const FUNCTIONS: [(&str, f64, Function); 26] = [
    ("abs", 0.0, |x| x.abs()),
    ("sign", 0.0, |x| x.sign()),
    ("floor", 0.0, |x| x.floor()),
    ("recip", 5e-7, |x| x.recip()),
    ("sqrt", 5e-7, |x| x.sqrt()),
    ("exp", 1e-5, |x| x.exp()),
    ("ln", 2e-7, |x| x.ln()),
    ("sine", 2e-7, |x| x.min(8000.0).max(-8000.0).sin() + 2.0),
    ("cosine", 2e-7, |x| x.min(8000.0).max(-8000.0).cos() + 2.0),
    ("tanh", 1e-6, |x| x.tanh()),
    ("logistic", 1e-5, |x| x.logistic()),
    ("softplus", 1e-5, |x| x.softplus()),
    ("ln_1p", 1e-6, |x| x.ln_1p()),
    ("erf", 1e-6, |x| x.erf()),
    ("exp_m1", 1e-5, |x| x.exp_m1()),
    ("powf", 1e-5, |x| x.abs().powf(2.2)),
    ("whole_power", 1e-5, |x| x.powf((2.0 * x.lt(0.0).to_scalar() + 3.0) * (x * 0.0 + 1.0))),
    ("slope_of_power", 1e-5, |x| {
        // 0⁰, 0 to −3 and −1 to 3 among them
        let exponent = x.eq(0.0).select(-3.0, 3.0 * x.abs().gt(0.5).to_scalar());
        Program::trace("f", &["x", "b"], &["y"], |v| vec![v[0].powf(v[1])]).vjp().apply(&[
            x.floor(),
            exponent,
            1.0.into(),
        ])[0]
    }),
    ("min", 0.0, |x| x.min(0.5)),
    ("max", 0.0, |x| Scalar::from(0.5).max(x)),
    ("minus_infinity", 0.0, |x| x.max(f64::NEG_INFINITY)),
    ("nan", 0.0, |x| x + f64::NAN),
    ("choice", 0.0, |x| x.lt(0.5).select(x, 2.0 * x)),
    ("stretches", 5e-6, |x| {
        let s = sheared(x).principal().stretches();
        s[0].abs() + s[1].abs() + s[2].abs()
    }),
    ("squares", 2e-5, |x| {
        let principal = sheared(x.tanh()).principal();
        principal.left(principal.stretches().map(|s| s.square())).trace()
    }),
    ("adjoint", 2e-5, |x| {
        Program::trace("f", &["x"], &["y"], |x| vec![x[0].softplus().max(0.25) * x[0].logistic()])
            .vjp()
            .apply(&[x, 1.0.into()])[0]
    }),
];

#[test]
fn emitted_functions_compute_the_same_on_a_gpu() {
    let Some(gpu) = Gpu::open() else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no adapter, and CI wants one");
        eprintln!("skipped: no adapter; install a Vulkan driver (a software one will do) to run this test");
        return;
    };
    let mut x: Vec<f32> = (-2000..2000).map(|i| i as f32 * 0.0433).collect();
    x.extend((-1000..1000).map(|i| i as f32 * 1e-4));
    x.extend((-1000..1000).map(|i| 1.0 + i as f32 * 1e-4));
    x.extend([0.0, 1e30, -1e30, 1e-30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, -1.0]);
    let mut wrong = Vec::new();
    for (name, tolerance, f) in FUNCTIONS {
        let program = Program::trace(name, &["x"], &["y"], |x| vec![f(x[0])]);
        for (&x, y) in x.iter().zip(gpu.map(&program, &x)) {
            let wanted = program.eval(&[f64::from(x)])[0];
            let single = wanted as f32;
            let close = if single.is_finite() && y.is_finite() {
                (f64::from(y) - f64::from(single)).abs() <= tolerance * wanted.abs() + 1e-37
            } else {
                single == y || (single.is_nan() && y.is_nan())
            };
            if !close {
                wrong.push(format!("{name} of {x:e}: {y:e}, wanted {wanted:e}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
