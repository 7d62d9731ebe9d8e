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
        (y.value().unwrap().to_vec().unwrap(), gradient, tape.memory().held)
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

#[test]
fn a_chain_of_linear_ops_holds_no_value() {
    const MEGABYTE: usize = 1 << 20;
    let ones = Tensor::full(1.0, [MEGABYTE / 4], DType::F32);
    let tape = Tape::new();
    let (x, c) = (tape.leaf(ones.clone()), tape.constant(ones));
    let mut y = x.clone();
    for step in 0..50 {
        y = if step % 2 == 0 { &y + &c } else { (&y + &x).reshape([2, MEGABYTE / 8]).reshape([MEGABYTE / 4]) };
    }
    assert_eq!(tape.memory().held, 0);
    let gradients = y.sum_all().into_gradients().unwrap();
    // the cotangent on its way and the sum that waits at the leaf, with one more of each while they are added
    assert!(tape.memory().peak <= 4 * MEGABYTE, "{:?}", tape.memory());
    assert_eq!(tape.memory().held, 0);
    assert_eq!(gradients.wrt(&x).unwrap().slice::<f32>()[7], 26.0);
}

#[test]
fn what_the_wanted_derivatives_do_not_read_is_not_held() {
    let held = |of_a: bool, of_b: bool| {
        let tape = Tape::new();
        let make = |wanted: bool, size: usize| {
            let x = Tensor::full(0.5, [size, size], DType::F64);
            if wanted { tape.leaf(x) } else { tape.constant(x) }
        };
        let (a, b) = (make(of_a, 4), make(of_b, 4));
        let _ = a.matmul(&b);
        tape.memory().held
    };
    assert_eq!([held(false, false), held(true, false), held(false, true), held(true, true)], [0, 128, 128, 256]);
    // the same tensor is counted once, however often it is held
    let tape = Tape::new();
    let x = tape.leaf(list(&[1.0, 2.0]));
    let y = (0..5).map(|_| (&x * &x).sum_all()).reduce(|a, b| &a + &b).unwrap();
    assert_eq!(tape.memory().held, 16);
    assert_eq!(y.into_gradients().unwrap().wrt(&x).unwrap().slice::<f64>(), &[10.0, 20.0]);
}

#[test]
fn a_spent_tape_frees_on_the_way_back_and_says_so_afterwards() {
    const SIZE: usize = 1 << 15;
    let run = |spend: bool| {
        let tape = Tape::new();
        let x = tape.leaf(Tensor::full(0.3, [SIZE], DType::F64));
        let loss = (0..20).fold(x.clone(), |x, _| x.tanh()).sum_all();
        let forward = tape.memory().held;
        let gradients = if spend { loss.clone().into_gradients() } else { loss.backward() }.unwrap();
        (gradients.wrt(&x).unwrap().clone(), tape, loss, x, forward)
    };
    let (spent, tape, loss, x, forward) = run(true);
    assert_eq!(forward, 20 * 8 * SIZE);
    assert_eq!(tape.memory().held, 0);
    assert!(tape.memory().peak <= forward + 3 * 8 * SIZE);
    let error = loss.backward().err().unwrap();
    assert_eq!(error.kind(), ErrorKind::NoGradient);
    assert!(error.to_string().contains("into_gradients"), "{error}");
    // what is recorded afterwards is as good as ever
    assert_eq!(x.sum_all().backward().unwrap().wrt(&x).unwrap().slice::<f64>()[0], 1.0);
    let (kept, tape, loss, ..) = run(false);
    assert_eq!(kept.slice::<f64>(), spent.slice::<f64>());
    assert_eq!(tape.memory().held, forward);
    assert!(loss.backward().is_ok());
}

#[test]
fn a_derivative_that_reads_what_it_left_out_is_found_out() {
    #[derive(Debug)]
    struct Forgetful;
    impl gradreel::Op for Forgetful {
        fn name(&self) -> &str {
            "forgetful"
        }
        fn infer(&self, inputs: &[gradreel::Spec]) -> gradreel::Result<gradreel::Spec> {
            Ok(inputs[0].clone())
        }
        fn forward_cpu(&self, inputs: gradreel::Operands<'_>) -> gradreel::Result<gradreel::Forward> {
            Ok(inputs[0].clone().into())
        }
        fn reads(&self, _: &[bool]) -> gradreel::Reads {
            gradreel::Reads::nothing()
        }
        fn vjp(&self, cx: &gradreel::Backward<'_>) -> gradreel::Result<Vec<Option<gradreel::Var>>> {
            assert_eq!(cx.input(0).dims(), [2]);
            Ok(vec![Some(cx.gradient() * cx.input(0))])
        }
    }
    let tape = Tape::new();
    let y = tape.leaf(list(&[1.0, 2.0])).apply(Forgetful, &[]).unwrap();
    let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| y.sum_all().backward().is_ok())).unwrap_err();
    let text = caught.downcast_ref::<String>().unwrap();
    for part in ["forgetful", "operand 0", "f64[2]", "`reads` leaves out", "fix: add .input(0)"] {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
#[should_panic(expected = "is differentiable on another tape")]
fn a_variable_of_another_tape_is_refused() {
    let x = Tape::new().leaf(list(&[1.0]));
    let _ = &Tape::new().leaf(list(&[2.0])) * &x;
}

#[test]
#[should_panic(expected = "hand it to the segment of a remat as an operand")]
fn a_remat_refuses_to_lose_the_gradient_of_what_it_captures() {
    let tape = Tape::new();
    let (x, captured) = (tape.leaf(list(&[1.0])), tape.leaf(list(&[2.0])));
    let _ = tape.remat(&[&x], move |_, v| Ok(&v[0] * &captured));
}

#[test]
fn anomaly_mode_looks_into_remat() {
    // forward: the op inside the segment is named, at its own line
    let tape = Tape::with_anomaly_mode();
    let x = tape.leaf(list(&[1.0, -4.0]));
    let error = tape.remat(&[&x], |_, v| Ok(&v[0].ln() * 2.0)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite);
    assert!(error.to_string().contains("ln made a non-finite value"), "{error}");
    // backward: a finite value whose derivative is infinite
    let tape = Tape::with_anomaly_mode();
    let x = tape.leaf(list(&[0.0, 4.0]));
    let y = tape.remat(&[&x], |_, v| Ok(v[0].sqrt())).unwrap();
    let error = y.sum_all().backward().err().unwrap();
    assert_eq!(error.kind(), ErrorKind::NonFinite);
    let text = error.to_string();
    for part in
        ["the derivative of sqrt", "operand 0", "f64[2]", "1 of 2 non-finite", "cotangent of the result", "tape.rs"]
    {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
}

#[test]
fn a_hundred_thousand_nodes_are_spent_and_dropped_without_a_deep_stack() {
    // on a thread with a small stack: forward, backward, drop
    let thread = std::thread::Builder::new().stack_size(128 << 10).spawn(|| {
        let tape = Tape::new();
        let x = tape.leaf(list(&[1.0, 2.0]));
        let mut y = x.clone();
        for step in 0..100_000 {
            y = if step % 3 == 0 { y.square().sqrt() } else { &y * 1.0 };
        }
        let gradients = y.sum_all().into_gradients().unwrap();
        drop(tape);
        gradients.wrt(&x).unwrap().slice::<f64>().to_vec()
    });
    for slope in thread.unwrap().join().unwrap() {
        assert!((slope - 1.0).abs() < 1e-9, "{slope}");
    }
}

#[test]
fn an_op_that_is_recorded_refuses_operands_of_other_tapes() {
    let (tape, other) = (Tape::new(), Tape::new());
    let x = tape.leaf(list(&[1.0]));
    let (constant, leaf) = (other.constant(list(&[2.0])), other.leaf(list(&[2.0])));
    let mul = |a, b| {
        tape.apply(
            gradreel::ops::registry().iter().find(|e| e.name == "mul").map(|e| (e.cases)()[0].op.clone()).unwrap(),
            &[a, b],
        )
    };
    for (operand, said, fix) in [
        (&constant, "operand 1 is a constant of another tape", "tape.constant("),
        (&leaf, "operand 1 is differentiable on another tape", "detach"),
    ] {
        let error = mul(&x, operand).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoGradient);
        let text = error.to_string();
        for part in ["mul", said, fix, "tests/tape.rs"] {
            assert!(text.contains(part), "{part:?} is not in: {text}");
        }
    }
    // nothing is recorded of constants, and so nothing can be lost
    assert_eq!((&tape.constant(list(&[3.0])) * &constant).item().unwrap(), 6.0);
}

#[test]
#[should_panic(expected = "mul: operand 1 is a constant of another tape")]
fn operators_refuse_constants_of_other_tapes() {
    let _ = &Tape::new().leaf(list(&[2.0])) * &Tape::new().constant(list(&[1.0]));
}

#[test]
fn the_segment_of_a_remat_may_use_constants_from_outside() {
    let tape = Tape::new();
    let (x, two) = (tape.leaf(list(&[3.0])), tape.constant(list(&[2.0])));
    let y = tape.remat(&[&x], move |_, v| Ok(&v[0] * &two)).unwrap();
    assert_eq!(y.backward().unwrap().wrt(&x).unwrap().slice::<f64>(), [2.0]);
}

#[test]
fn mixed_dtypes_are_refused_with_the_op_and_the_cast_that_helps() {
    let tape = Tape::new();
    let (double, single) = (tape.leaf(list(&[1.0, 2.0])), tape.leaf(Tensor::from_vec(vec![1.0f32, 2.0], [2])));
    let of = |name: &str| (gradreel::ops::registry().iter().find(|e| e.name == name).unwrap().cases)()[0].op.clone();
    for (name, operands, fix) in [
        ("add", [&double, &single], "cast operand 1 to f64, with .cast(DType::F64)"),
        ("add", [&single, &double], "cast operand 0 to f64, with .cast(DType::F64)"),
        ("concat", [&single, &double], "cast operand 0 to f64"),
        ("matmul", [&double, &single], "cast operand 1 to f64"),
    ] {
        let error = tape.apply(of(name), &operands).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Shape);
        let text = error.to_string();
        assert!(text.contains(name) && text.contains(fix), "{text}");
    }
    let whole = tape.constant(Tensor::from_vec(vec![1u32, 2], [2]));
    let text = tape.apply(of("sum"), &[&whole]).unwrap_err().to_string();
    assert!(text.contains("sum does not compute in u32") && text.contains(".cast(DType::F32)"), "{text}");
}

#[test]
fn a_tensor_shows_its_numbers() {
    let text = |x: Tensor| format!("{x:?}");
    assert_eq!(text(list(&[1.0, 2.5])), "f64[2] on cpu: [1.0, 2.5]");
    assert_eq!(text(Tensor::scalar(-3.0, DType::F32)), "f32[] on cpu: -3.0");
    assert_eq!(text(Tensor::from_vec(vec![1u32, 2, 3, 4], [2, 2])), "u32[2, 2] on cpu: [[1, 2], [3, 4]]");
    assert_eq!(text(Tensor::zeros([2, 0], DType::F16)), "f16[2, 0] on cpu: [[], []]");
    let many = Tensor::from_vec((0..125).map(f64::from).collect(), [125]);
    assert_eq!(text(many.reshape([125])), "f64[125] on cpu: [0.0, 1.0, 2.0, …, 124.0]");
    assert_eq!(
        text(many.reshape([5, 5, 5])),
        "f64[5, 5, 5] on cpu: [[[0.0, 1.0, 2.0, …, 4.0], [5.0, 6.0, 7.0, …, 9.0], [10.0, 11.0, 12.0, …, 14.0], …, \
         [20.0, 21.0, 22.0, …, 24.0]], …, [[100.0, 101.0, 102.0, …, 104.0], [105.0, 106.0, 107.0, …, 109.0], \
         [110.0, 111.0, 112.0, …, 114.0], …, [120.0, 121.0, 122.0, …, 124.0]]]"
    );
    // a shape that no memory could hold is not made in the first place
    assert!(std::panic::catch_unwind(|| Tensor::from_vec(vec![1.0, 2.0], [(1usize << 63) + 1, 2])).is_err());
}
