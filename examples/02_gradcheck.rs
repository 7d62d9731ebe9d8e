//! Is a derivative right? Compare it with central differences, entry by entry, and read the table.
//!
//! `gradcheck` takes any function of variables: an op, a loss, a whole simulation. It works in `f64`, contracts the
//! result with fixed weights so that every element counts, and names the entry that disagrees most. Here it checks the
//! length √(a² + b²) with a derivative written by hand: once right, once with a slip that no shape rule would notice.
//!
//! ```text
//! cargo run --release --example 02_gradcheck
//! ```

use gradreel::{Backward, Forward, GradReport, Op, Operands, Result, Spec, Tensor, Var, gradcheck};

/// `√(a² + b²)`, element by element.
#[derive(Debug)]
struct Length {
    /// Whether its derivative forgets to divide one of its terms.
    slip: bool,
}

impl Op for Length {
    fn name(&self) -> &str {
        "length"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [a, _] = Spec::exactly(self.name(), inputs)?;
        Ok(a.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [a, b] = inputs.array();
        let pairs = a.slice::<f64>().iter().zip(b.slice::<f64>());
        Ok(Tensor::from_vec(pairs.map(|(a, b)| a.hypot(*b)).collect(), a.shape()).into())
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let per_length = cx.gradient() / cx.output();
        let by_a = cx.input(0) * &per_length;
        let by_b = if self.slip { cx.input(1) * cx.gradient() } else { cx.input(1) * &per_length };
        Ok(vec![Some(by_a), Some(by_b)])
    }
}

fn check(name: &str, slip: bool) -> Result<GradReport> {
    let a = Tensor::from_vec(vec![3.0, -1.0, 0.5, 2.0, 7.0, -4.0], [2, 3]);
    let b = Tensor::from_vec(vec![4.0, 2.0, -0.5, 0.1, 1.0, 3.0], [2, 3]);
    gradcheck(name, &[("a", a), ("b", b)], |_, v| v[0].apply(Length { slip }, &[&v[1]]))
}

fn main() -> Result<()> {
    let right = check("length", false)?;
    println!("{right}");
    assert!(right.passed());

    let wrong = check("length, with a slip", true)?;
    println!("{wrong}");
    assert!(wrong.rows[0].passed, "the derivative with respect to a is right in both");
    assert!(!wrong.rows[1].passed, "the slip must be found");

    // The most common slip needs no op at all: a path that was cut by accident.
    let x = Tensor::from_vec(vec![0.3, -1.2, 4.0], [3]);
    let cut = gradcheck("x tanh(x), half of it detached", &[("x", x)], |_, v| Ok(&v[0] * &v[0].tanh().detach()))?;
    println!("{cut}");
    assert!(!cut.passed());
    Ok(())
}
