//! The tape in one page: leaves, a loss, its gradient, the gradient of a gradient, and memory traded for time.
//!
//! A tape lives for one evaluation. `leaf` marks what is to be differentiated, `constant` what is not; every op computes
//! at once and appends one node. There is no global state and nothing to reset.
//!
//! ```text
//! cargo run --release --example 01_tape
//! ```

use gradreel::{Result, Tape, Tensor};

fn main() -> Result<()> {
    // A straight line through four points: loss = mean (slope·x + offset − y)²
    let tape = Tape::new();
    let x = tape.constant(Tensor::from_vec(vec![0.0, 1.0, 2.0, 3.0], [4]));
    let y = tape.constant(Tensor::from_vec(vec![1.0, 3.0, 5.0, 7.0], [4]));
    let slope = tape.leaf(Tensor::from_vec(vec![1.5], [1]));
    let offset = tape.leaf(Tensor::from_vec(vec![0.0], [1]));

    let residual = &x * &slope + &offset - &y;
    let loss = residual.square().mean_all();
    let gradients = loss.backward()?;
    println!("loss {:.4} from {} nodes on the tape", loss.item()?, tape.len());
    println!("  d loss/d slope   {:.4}", gradients.wrt(&slope)?.item()?);
    println!("  d loss/d offset  {:.4}", gradients.wrt(&offset)?.item()?);
    // residuals −1, −1.5, −2, −2.5: 2 mean(r x) = −6.5, 2 mean(r) = −3.5
    assert_eq!(gradients.wrt(&slope)?.item()?, -6.5);
    assert_eq!(gradients.wrt(&offset)?.item()?, -3.5);

    // Derivatives are written in ops, so they can be recorded and differentiated again: f = Σ x³, f' = 3x², Σf'' = 6x.
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, -3.0], [3]));
    let cubes = (x.square() * &x).sum_all();
    let first = cubes.gradients_of(&[&x])?.remove(0);
    let second = first.sum_all().backward()?;
    println!("\nx³ at 1, 2, −3:  first derivative {:?}", first.value()?.to_vec()?);
    println!("                second derivative {:?}", second.wrt(&x)?.to_vec()?);
    assert_eq!(first.value()?.to_vec()?, [3.0, 12.0, 27.0]);
    assert_eq!(second.wrt(&x)?.to_vec()?, [6.0, 12.0, -18.0]);

    // A long chain keeps every intermediate value for its backward pass. Inside `remat` it keeps none and computes them
    // again when they are needed: the same gradient, bit for bit.
    const STEPS: usize = 100;
    let start = Tensor::full(0.3, [1000], gradreel::DType::F64);
    let chain = |x: &gradreel::Var| (0..STEPS).fold(x.clone(), |x, _| &x + x.tanh() * 0.01);

    let kept = Tape::new();
    let x = kept.leaf(start.clone());
    let plain = chain(&x).sum_all().backward()?.wrt(&x)?.to_vec()?;

    let spared = Tape::new();
    let x = spared.leaf(start);
    let end = spared.remat(&[&x], move |_, inputs| Ok(chain(&inputs[0])))?;
    let again = end.sum_all().backward()?.wrt(&x)?.to_vec()?;
    let [all, few] = [&kept, &spared].map(|tape| tape.memory().held);
    println!("\n{STEPS} steps: {all} bytes kept, with remat {few}");
    assert_eq!(plain, again);
    assert!(few * 50 < all);
    Ok(())
}
