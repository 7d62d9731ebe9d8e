//! An op of one's own, outside the crate: shape rule, forward pass, derivative written in ops.
//!
//! The op is the running sum `yᵢ = x₀ + … + xᵢ`. Its derivative is a running sum from the other end, written with the op
//! itself; it therefore can be differentiated any number of times. A *pointwise* function needs none of this: `map` takes
//! it as it is, differentiates it and runs it on the CPU or, as WGSL, on a GPU.
//!
//! ```text
//! cargo run --release --example 03_new_op
//! ```

use gradreel::ops::uniform;
use gradreel::{Backward, DType, Device, Error, ErrorKind, Forward, Op, Result, Spec, Tape, Tensor, Var, gradcheck};

/// `yᵢ = x₀ + … + xᵢ` of a vector.
#[derive(Debug)]
struct RunningSum;

impl Op for RunningSum {
    fn name(&self) -> &str {
        "running_sum"
    }

    /// What comes out, or why the operands do not fit; runs before anything is computed.
    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        match inputs {
            [x] if x.shape.rank() == 1 => Ok(x.clone()),
            _ => Err(Error::new(ErrorKind::Shape, "running_sum takes one vector").found(format!("{inputs:?}"))),
        }
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let mut sum = 0.0;
        let values = inputs[0].to_vec()?.into_iter().map(|x| {
            sum += x;
            sum
        });
        Ok(Tensor::from_vec(values.collect(), inputs[0].shape()).cast(inputs[0].dtype())?.into())
    }

    /// `x_i` is part of `y_i, y_{i+1}, …`: its cotangent is the sum of theirs, `total − running sum + own`.
    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let g = cx.gradient();
        let before = g.apply(Self, &[])?;
        Ok(vec![Some(&(&g.sum_all() - &before) + g)])
    }
}

fn main() -> Result<()> {
    let x = uniform(1, [7], -1.0..1.0);
    let report = gradcheck("running_sum", &[("x", x.clone())], |_, v| v[0].apply(RunningSum, &[]))?;
    println!("{report}");
    assert!(report.passed());

    let refused = Tape::new().constant(x.reshape([1, 7])).apply(RunningSum, &[]).unwrap_err();
    println!("a matrix is refused:\n{refused}\n");

    // Pointwise: nothing to write but the function.
    let report = gradcheck("swish", &[("x", x.clone())], |_, v| Ok(v[0].map("swish", |x| x * x.logistic())))?;
    println!("{report}");
    assert!(report.passed());

    let swish = |x: Tensor| -> Result<(Vec<f64>, Vec<f64>)> {
        let tape = Tape::new();
        let x = tape.leaf(x);
        let y = x.map("swish", |x| x * x.logistic());
        Ok((y.value()?.to_vec()?, y.sum_all().backward()?.wrt(&x)?.to_vec()?))
    };
    match Device::gpu() {
        Ok(gpu) => {
            let (y, slope) = swish(x.clone())?;
            let (y_gpu, slope_gpu) = swish(x.cast(DType::F32)?.to_device(&gpu)?)?;
            let pairs = y.iter().zip(&y_gpu).chain(slope.iter().zip(&slope_gpu));
            let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            println!("{gpu}: value and derivative differ by {apart:.1e} from f64 on the CPU");
            assert!(apart < 1e-5);
        }
        Err(error) => println!("no GPU here, so the same map was not run there: {error}"),
    }
    Ok(())
}
