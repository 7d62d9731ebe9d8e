//! The gradient check itself: a derivative that is wrong, however little and wherever, must not pass.

use gradreel::ops::{Case, uniform};
use gradreel::{Backward, DType, Forward, GradCheck, GradReport, Op, Operands, Reads, Result, Spec, Tape, Tensor, Var};

/// What is wrong with a derivative.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Nothing,
    /// Every element is too large by this share.
    All(f64),
    /// One element is multiplied by this factor.
    One(usize, f64),
    /// There is no derivative at all.
    Zero,
    /// The last element gets a tiny bit of NaN.
    NotANumber,
}

impl Fault {
    /// What the derivative is multiplied by.
    fn factors(self, len: usize) -> Vec<f64> {
        let mut factors = vec![1.0; len];
        match self {
            Self::Nothing => {}
            Self::All(share) => factors.fill(1.0 + share),
            Self::One(at, factor) => factors[at] = factor,
            Self::Zero => factors.fill(0.0),
            Self::NotANumber => factors[len - 1] = f64::NAN,
        }
        factors
    }
}

/// `xⁿ`, with these faults in its derivative and in the derivative of that.
#[derive(Debug, Clone, Copy)]
struct Power(u8, [Fault; 2]);

impl Op for Power {
    fn name(&self) -> &str {
        "power"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        Ok(inputs[0].clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let values = inputs[0].slice::<f64>().iter().map(|x| x.powi(self.0.into())).collect();
        Ok(Tensor::from_vec(values, inputs[0].shape()).into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, Self(n, [first, second])) = (cx.input(0), *self);
        let slope = &x.apply(Self(n - 1, [second, Fault::Nothing]), &[])? * f64::from(n);
        let factors = x.tape().constant(Tensor::from_vec(first.factors(x.len()), x.shape()));
        Ok(vec![Some(&(&slope * &factors) * cx.gradient())])
    }
}

const FAULTS: [Fault; 9] = [
    Fault::All(1e-3),
    Fault::All(-3e-5),
    Fault::One(0, -1.0),
    Fault::One(2, -1.0),
    Fault::One(2, 0.0),
    Fault::One(2, 1.001),
    Fault::One(5, 0.999),
    Fault::Zero,
    Fault::NotANumber,
];

/// The reports of both orders; the fault is in the derivative that each of them checks.
fn reports(fault: Fault, x: &Tensor) -> [GradReport; 2] {
    let case = |faults| Case::new(Power(4, faults), [x.clone()]);
    [
        case([fault, Fault::Nothing]).gradcheck("power").unwrap().unwrap(),
        case([Fault::Nothing, fault]).gradcheck_twice("power, twice").unwrap().unwrap(),
    ]
}

#[test]
fn no_fault_passes() {
    // magnitudes from 0.03 to 3, so that the slopes differ by a factor of a million; 300 are not all perturbed one by one
    let some = Tensor::from_vec(vec![-0.03, 0.1, 0.06, 1.0, 3.0, -0.4], [2, 3]);
    for x in [some, uniform(1, [300], 0.5..2.0), uniform(2, [6], 100.0..1000.0)] {
        for report in reports(Fault::Nothing, &x) {
            assert!(report.passed(), "{report}");
        }
        for fault in FAULTS {
            for report in reports(fault, &x) {
                assert!(!report.passed(), "{fault:?}\n{report}");
            }
        }
    }
}

#[test]
fn large_outputs_beside_a_small_one_hide_nothing() {
    let x = uniform(1, [6], 0.5..2.0);
    let beside = |fault: Fault| {
        GradCheck::default().function("beside", &[("x", x.clone())], move |tape: &Tape, v: &[Var]| {
            let large = tape.constant(Tensor::full(1e12, [50], DType::F64));
            Ok(v[0].apply(Power(3, [fault, Fault::Nothing]), &[])?.concat(&[&large], 0))
        })
    };
    assert!(beside(Fault::Nothing).unwrap().passed());
    for fault in FAULTS {
        let report = beside(fault).unwrap();
        assert!(!report.passed(), "{fault:?}\n{report}");
    }
}

#[test]
fn a_large_offset_of_each_output_hides_no_thousandth() {
    let x = uniform(1, [6], 0.5..2.0);
    let above = |fault: Fault| {
        GradCheck::default().function("above", &[("x", x.clone())], move |_: &Tape, v: &[Var]| {
            Ok(&v[0].apply(Power(3, [fault, Fault::Nothing]), &[])? + 1e4)
        })
    };
    assert!(above(Fault::Nothing).unwrap().passed());
    for fault in FAULTS.into_iter().filter(|fault| !matches!(fault, Fault::All(share) if share.abs() < 1e-4)) {
        let report = above(fault).unwrap();
        assert!(!report.passed(), "{fault:?}\n{report}");
    }
}

#[test]
fn a_derivative_of_one_operand_in_place_of_another_is_found() {
    let (x, y) = (uniform(1, [4], 0.5..2.0), uniform(2, [4], 0.5..2.0));
    let swapped = GradCheck::default().function("swapped", &[("x", x), ("y", y)], |_, v| {
        // the value of x² y with the derivative of x y²
        let (wanted, other) = (&v[0].square() * &v[1], &v[0] * &v[1].square());
        Ok(&(&wanted.detach() + &other) - &other.detach())
    });
    let report = swapped.unwrap();
    assert!(report.rows.iter().all(|row| !row.passed), "{report}");
}
