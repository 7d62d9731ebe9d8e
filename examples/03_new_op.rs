//! An op of one's own, outside the crate: shape rule, a forward pass per device, derivative written in ops.
//!
//! The op is one step of heat conduction along a rod whose ends are held at zero, `yᵢ = xᵢ + r (xᵢ₋₁ − 2 xᵢ + xᵢ₊₁)`. Its
//! matrix is symmetric, so that the derivative is the op itself: it can be differentiated any number of times. It is
//! checked against central differences, and on a GPU against the CPU, by the functions that check the ops of the crate.
//!
//! A *pointwise* function needs none of this: `map` takes it as it is, differentiates it and runs it on the CPU or, as
//! WGSL, on a GPU.
//!
//! ```text
//! cargo run --release --example 03_new_op
//! ```

use gradreel::backend::gpu::{Gpu, Kernel, Work};
use gradreel::ops::uniform;
use gradreel::scalar::Real;
use gradreel::{
    Backward, DType, Device, Error, ErrorKind, Forward, Op, Operands, Reads, Result, Spec, Tape, Tensor, Var,
    devicecheck, gradcheck,
};

/// One step of heat conduction along a vector.
#[derive(Debug, Clone, Copy)]
struct Conduct {
    /// Conductivity times time step over the square of the spacing.
    rate: f64,
}

/// The kernel: its result first, then its operands. Workgroups are numbered over three axes.
static KERNEL: Kernel = Kernel::new(
    "conduct",
    "main",
    "
    struct Sizes { len: u32, rate: f32 }
    @group(0) @binding(0) var<uniform> sizes: Sizes;
    @group(0) @binding(1) var<storage, read_write> y: array<f32>;
    @group(0) @binding(2) var<storage, read> x: array<f32>;

    @compute @workgroup_size(256)
    fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(num_workgroups) num: vec3<u32>,
            @builtin(local_invocation_index) local: u32) {
        let i = ((id.z * num.y + id.y) * num.x + id.x) * 256u + local;
        if i >= sizes.len { return; }
        var around = 0.0;
        if i > 0u { around += x[i - 1u]; }
        if i + 1u < sizes.len { around += x[i + 1u]; }
        y[i] = x[i] + sizes.rate * (around - 2.0 * x[i]);
    }",
    &["y", "x"],
);

impl Conduct {
    fn run<T: Real>(self, x: &[T]) -> Vec<T> {
        let (rate, two) = (T::from_f64(self.rate), T::from_f64(2.0));
        let at = |i: usize| x.get(i).copied().unwrap_or(T::ZERO);
        (0..x.len()).map(|i| x[i] + rate * (at(i.wrapping_sub(1)) + at(i + 1) - two * x[i])).collect()
    }
}

impl Op for Conduct {
    fn name(&self) -> &str {
        "conduct"
    }

    /// What comes out, or why the operands do not fit; runs before anything is computed.
    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        match inputs {
            [x] if x.shape.rank() == 1 && x.dtype.is_real() => Ok(x.clone()),
            _ => Err(Error::new(ErrorKind::Shape, "conduct takes one vector")
                .found(format!("{inputs:?}"))
                .wanted("[n] of f32 or f64")),
        }
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        Ok(match x.dtype() {
            DType::F64 => Tensor::from_vec(self.run::<f64>(x.slice()), x.shape()),
            _ => Tensor::from_vec(self.run::<f32>(x.slice()), x.shape()),
        }
        .into())
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let parameters = [x.len() as u32, (self.rate as f32).to_bits()];
        Ok(gpu.launch(&KERNEL, &[x], &parameters, x.spec(), Work::Invocations(x.len()))?.into())
    }

    /// The derivative looks at no value: the tape need not keep the operand.
    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().apply(*self, &[])?)])
    }
}

fn main() -> Result<()> {
    let rod = uniform(1, [7], 0.0..1.0);
    let step = |x: &Var| x.apply(Conduct { rate: 0.2 }, &[]);
    // squared, so that there is a second derivative to check
    let heat = |_: &Tape, v: &[Var]| Ok(step(&step(&v[0])?)?.square());
    let report = gradcheck("conduct", &[("x", rod.clone())], heat)?;
    println!("{report}");
    assert!(report.passed());
    let report = gradreel::GradCheck::default().gradient("conduct, twice", &[("x", rod.clone())], heat)?;
    println!("{report}");
    assert!(report.passed());

    let refused = Tape::new().constant(rod.reshape([1, 7])).apply(Conduct { rate: 0.2 }, &[]).unwrap_err();
    println!("a matrix is refused:\n{refused}\n");

    // Pointwise: nothing to write but the function.
    let swish = |_: &Tape, v: &[Var]| Ok(v[0].map("swish", |x| x * x.logistic()));
    let report = gradcheck("swish", &[("x", rod.clone())], swish)?;
    println!("{report}");
    assert!(report.passed());

    match Device::gpu() {
        Ok(gpu) => {
            let long = uniform(2, [1000], 0.0..1.0);
            for report in [
                devicecheck("conduct", &gpu, &[("x", long.clone())], 2e-6, heat)?,
                devicecheck("swish", &gpu, &[("x", long)], 2e-6, swish)?,
            ] {
                println!("{report}");
                assert!(report.passed());
            }
        }
        Err(error) => println!("no GPU here, so the same ops were not run there: {error}"),
    }

    // What it is for: the temperature before ten steps, from the temperature after them.
    let tape = Tape::new();
    let start = tape.leaf(rod);
    let mut end = start.clone();
    for _ in 0..10 {
        end = step(&end)?;
    }
    println!("ten steps hold {} bytes for the backward pass", tape.memory().held);
    assert_eq!(tape.memory().held, 0);
    let gradient = end.square().sum_all().into_gradients()?.wrt(&start)?.to_vec()?;
    println!("d (final heat²) / d (first temperatures) = {gradient:.3?}");
    Ok(())
}
