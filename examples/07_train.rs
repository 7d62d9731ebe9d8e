//! A small training that is stopped and taken up again: AdamW with a schedule and clipping, and a checkpoint from which it
//! goes on bit for bit.
//!
//! A network of one hidden layer learns `sin 3x`; the second half of the training is done twice, once without a pause and
//! once from the file.
//!
//! ```text
//! cargo run --release --example 07_train
//! ```

use gradreel::io::{Archive, TensorFile};
use gradreel::optim::{Adam, BoundScope, Clip, Load, Params, Schedule};
use gradreel::{DType, Result, Tape, Tensor, Var, ops};

const STEPS: u64 = 600;

fn main() -> Result<()> {
    let (mut params, mut adam) = (start()?, optimiser());
    println!("{} parameters, {} of them trained", params.count(), params.count_trainable());
    let first_loss = train(&mut params, &mut adam, 0..STEPS / 2)?;

    // one file for all that is needed to go on: parameters, moments, the number of steps
    let path = std::env::temp_dir().join(format!("gradreel-train-{}.safetensors", std::process::id()));
    let mut file = TensorFile::default();
    params.save(&mut file)?;
    adam.save(&mut file);
    file.write(&path)?;

    let loss = train(&mut params, &mut adam, STEPS / 2..STEPS)?;
    println!("loss {first_loss:.5} after {} steps, {loss:.5} after {STEPS}", STEPS / 2);
    assert!(loss < 0.01 && loss < first_loss);

    // as another process would do it: the program gives the settings, the file the numbers
    let (mut resumed, mut resumed_adam) = (start()?, optimiser());
    resumed.load(&Archive::open(&path)?, &Load::strict())?;
    resumed_adam.restore(&TensorFile::read(&path)?)?;
    train(&mut resumed, &mut resumed_adam, STEPS / 2..STEPS)?;
    for (path, value) in params.iter() {
        let bits = |x: &Tensor| x.slice::<f32>().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(value), bits(resumed.get(path)?), "{path}");
    }
    println!("resumed from {}: the same bits", path.display());
    std::fs::remove_file(&path).map_err(|e| gradreel::Error::io(&path, "remove the checkpoint", &e))
}

/// Random weights and zero biases; the input's scale is not trained.
fn start() -> Result<Params> {
    let mut params = Params::new();
    params.set("input.scale", Tensor::full(3.0, [1], DType::F32));
    params.set("net.hidden.weight", ops::uniform(1, [1, 32], -1.0..1.0).cast(DType::F32)?);
    params.set("net.hidden.bias", ops::uniform(2, [32], -1.0..1.0).cast(DType::F32)?);
    params.set("net.out.weight", ops::uniform(3, [32, 1], -0.2..0.2).cast(DType::F32)?);
    params.set("net.out.bias", Tensor::zeros([1], DType::F32));
    params.freeze("input")?;
    Ok(params)
}

fn optimiser() -> Adam {
    Adam::new(0.02)
        .with_rate("net.out", 0.01)
        .with_weight_decay(1e-4)
        .with_weight_decay_of("net.hidden.bias", 0.0)
        .with_weight_decay_of("net.out.bias", 0.0)
        .with_clip(Clip::Norm(1.0))
        .with_schedule(Schedule::warmup(20, 0.1).then(20, Schedule::cosine(STEPS - 20, 0.05)))
}

/// The network is written with names relative to its own prefix, so that it may be a part of another.
fn network(x: &Var, net: &BoundScope<'_>) -> Result<Var> {
    let hidden = (x.matmul(net.get("hidden.weight")?) + net.get("hidden.bias")?).tanh();
    Ok(hidden.matmul(net.get("out.weight")?) + net.get("out.bias")?)
}

/// Trains on numbers that depend on the step alone, not on where the training began; returns the last loss.
fn train(params: &mut Params, adam: &mut Adam, steps: std::ops::Range<u64>) -> Result<f64> {
    let mut last = f64::NAN;
    for step in steps {
        let x = ops::uniform(1000 + step, [64, 1], -1.0..1.0).cast(DType::F32)?;
        let y = Tensor::from_vec(x.slice::<f32>().iter().map(|x| (3.0 * x).sin()).collect(), [64, 1]);
        let gradients = {
            let tape = Tape::new();
            let bound = params.bind(&tape);
            let scaled = tape.constant(x) * bound.get("input.scale")?;
            let loss = (network(&scaled, &bound.scope("net"))? - tape.constant(y)).square().mean_all();
            last = loss.item()?;
            bound.gradients(&loss.backward()?)?
        };
        // the tape is gone: nothing else holds the parameters, and they are updated in place
        adam.step(params, &gradients)?;
    }
    Ok(last)
}
