//! The tape: sums of paths, gradients of gradients, remat, anomaly mode, faults, depth.

use gradreel::{DType, ErrorKind, Tape, Tensor, gradcheck};

fn list(values: &[f64]) -> Tensor {
    Tensor::from_vec(values.to_vec(), [values.len()])
}

#[test]
fn gradients_of_several_paths_add_up() {
    let tape = Tape::new();
    let x = tape.leaf(list(&[2.0, -1.0]));
    let y = &(&x * &x) + &(&x * 3.0);
    let gradients = y.sum_all().backward().unwrap();
    assert_eq!(gradients.wrt(&x).unwrap().slice::<f64>(), &[7.0, 1.0]);
}

#[test]
fn gradients_of_gradients() {
    let tape = Tape::new();
    let x = tape.leaf(list(&[0.7, -0.3]));
    let cubic = (&x.square() * &x).sum_all();
    let slope = &cubic.gradients_of(&[&x]).unwrap()[0];
    let curvature = slope.sum_all().backward().unwrap();
    for (found, x) in curvature.wrt(&x).unwrap().slice::<f64>().iter().zip([0.7, -0.3]) {
        assert!((found - 6.0 * x).abs() < 1e-12);
    }
}

#[test]
fn remat_changes_no_bit_and_holds_less() {
    let model = |x: &gradreel::Var| (&x.exp() * &x.tanh()).logistic();
    let run = |remat: bool| {
        let tape = Tape::new();
        let x = tape.leaf(list(&[0.3, 1.7, -2.0]));
        let y = if remat { tape.remat(&[&x], move |_, v| Ok(model(&v[0]))).unwrap() } else { model(&x) };
        let gradient = y.sum_all().backward().unwrap().wrt(&x).unwrap().to_vec().unwrap();
        (y.value().unwrap().to_vec().unwrap(), gradient, tape.memory())
    };
    let (plain, rematerialised) = (run(false), run(true));
    assert_eq!(plain.0, rematerialised.0);
    assert_eq!(plain.1, rematerialised.1);
    assert!(rematerialised.2 < plain.2);
}

#[test]
fn remat_refuses_to_be_differentiated_twice() {
    let tape = Tape::new();
    let x = tape.leaf(list(&[0.3]));
    let y = tape.remat(&[&x], |_, v| Ok(v[0].square())).unwrap();
    let error = y.sum_all().gradients_of(&[&x]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
}

#[test]
fn a_hundred_thousand_nodes_do_not_overflow_the_stack() {
    let tape = Tape::new();
    let x = tape.leaf(list(&[1.0]));
    let mut y = x.clone();
    for _ in 0..100_000 {
        y = -&y;
    }
    assert_eq!(tape.len(), 100_001);
    assert_eq!(y.sum_all().backward().unwrap().wrt(&x).unwrap().slice::<f64>(), &[1.0]);
}

#[test]
fn missing_gradients_are_reported() {
    let tape = Tape::new();
    let (x, other) = (tape.leaf(list(&[1.0])), tape.leaf(list(&[1.0])));
    let constant = tape.constant(list(&[1.0]));
    let gradients = x.sum_all().backward().unwrap();
    for var in [&other, &constant, &Tape::new().leaf(list(&[1.0]))] {
        assert_eq!(gradients.wrt(var).unwrap_err().kind(), ErrorKind::NoGradient);
    }
    assert_eq!(constant.sum_all().backward().err().unwrap().kind(), ErrorKind::NoGradient);
}

#[test]
fn anomaly_mode_names_op_line_and_ranges() {
    let tape = Tape::with_anomaly_mode();
    let x = tape.leaf(list(&[1.0, -4.0]));
    let y = x.ln();
    let error = y.sum_all().backward().err().unwrap();
    assert_eq!(error.kind(), ErrorKind::NonFinite);
    let text = error.to_string();
    for part in ["ln", "tape.rs", "-4.000e0", "1 of 2 non-finite"] {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
    // a finite value with an infinite derivative
    let tape = Tape::with_anomaly_mode();
    let x = tape.leaf(list(&[0.0]));
    let error = x.sqrt().sum_all().backward().err().unwrap();
    assert!(error.to_string().contains("derivative of sqrt"), "{error}");
}

#[test]
#[should_panic(expected = "matmul: the operands do not fit")]
fn a_wrong_shape_panics_with_both_shapes() {
    let tape = Tape::new();
    let a = tape.constant(Tensor::zeros([2, 3], DType::F32));
    let _ = a.matmul(&a);
}

#[test]
fn gradcheck_finds_a_wrong_derivative() {
    // detaching one factor makes the tape's derivative half of the true one
    let report = gradcheck("x·x", &[("x", list(&[0.5, 1.5]))], |_, v| Ok(&v[0] * &v[0].detach())).unwrap();
    assert!(!report.passed());
    let table = report.to_string();
    assert!(table.contains("FAIL") && table.contains("difference"), "{table}");
}

#[test]
fn gradcheck_prints_a_table() {
    let report = gradcheck("tanh", &[("x", list(&[0.5, 1.5]))], |_, v| Ok(v[0].tanh())).unwrap();
    assert!(report.passed(), "{report}");
    assert!(report.to_string().contains("x                       2"), "{report}");
}
