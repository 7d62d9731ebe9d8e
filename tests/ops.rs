//! Every op of the registry: gradient check in `f64`, `f32` against `f64`, non-finite operands, empty shapes.

use gradreel::backend::cpu::pool;
use gradreel::ops::{Case, registry};
use gradreel::{DType, ErrorKind, GradReport, Tape, Tensor, Var};

/// Applies a case's op to operands of another dtype or device.
fn apply(case: &Case, inputs: &[Tensor]) -> Tensor {
    let tape = Tape::new();
    let inputs: Vec<Var> = inputs.iter().map(|x| tape.constant(x.clone())).collect();
    let refs: Vec<&Var> = inputs.iter().collect();
    tape.apply(case.op.clone(), &refs).unwrap().value().unwrap().clone()
}

fn real(x: &Tensor, dtype: DType) -> Tensor {
    if x.dtype() == DType::U32 { x.clone() } else { x.cast(dtype).unwrap() }
}

#[test]
fn every_derivative_agrees_with_central_differences() {
    for entry in registry() {
        let cases = (entry.cases)();
        assert!(!cases.is_empty(), "{} has no cases", entry.name);
        for (number, case) in cases.iter().enumerate() {
            let report = case.gradcheck(&format!("{} case {number}", entry.name)).unwrap();
            assert!(report.as_ref().is_none_or(GradReport::passed), "{}", report.unwrap());
        }
    }
}

#[test]
fn every_second_derivative_agrees_or_is_refused() {
    for entry in registry() {
        for (number, case) in (entry.cases)().iter().enumerate() {
            match case.gradcheck_twice(&format!("{} case {number}, twice", entry.name)) {
                Ok(report) => assert!(report.as_ref().is_none_or(GradReport::passed), "{}", report.unwrap()),
                Err(error) => {
                    let refused = error.kind() == ErrorKind::Unsupported && error.to_string().contains("twice");
                    assert!(refused, "{}: {error}", entry.name);
                }
            }
        }
    }
}

#[test]
fn single_precision_agrees_with_double() {
    // buffers hold NaN at first: a kernel that does not write all of its result is found out
    pool::set_poison(true);
    for entry in registry() {
        for case in (entry.cases)() {
            let wide = apply(&case, &case.inputs).to_vec().unwrap();
            let narrow: Vec<_> = case.inputs.iter().map(|x| real(x, DType::F32)).collect();
            for (a, b) in apply(&case, &narrow).to_vec().unwrap().iter().zip(&wide) {
                assert!(a == b || (a - b).abs() <= 1e-5 * b.abs().max(1.0), "{}: f32 {a}, f64 {b}", entry.name);
            }
        }
    }
}

#[test]
fn a_nan_operand_is_never_hidden() {
    for entry in registry() {
        for case in (entry.cases)() {
            let poisonable = |x: &&Tensor| !case.condition && !x.is_empty() && x.dtype() != DType::U32;
            let Some(first) = case.inputs.first().filter(poisonable) else { continue };
            let poisoned = Tensor::full(f64::NAN, first.shape(), DType::F64);
            let inputs: Vec<_> = std::iter::once(poisoned).chain(case.inputs[1..].iter().cloned()).collect();
            let result = apply(&case, &inputs);
            let hides = result.is_empty() || result.to_vec().unwrap().iter().any(|v| v.is_nan());
            assert!(hides, "{} made {:?} of NaN", entry.name, result.to_vec());
        }
    }
}

#[test]
fn pointwise_ops_accept_empty_tensors() {
    for entry in registry() {
        for case in (entry.cases)() {
            if !case.inputs.iter().all(|x| x.shape() == case.inputs[0].shape()) {
                continue;
            }
            let empty: Vec<_> = case.inputs.iter().map(|_| Tensor::zeros([0], DType::F32)).collect();
            let specs: Vec<_> = empty.iter().map(Tensor::spec).collect();
            if case.op.infer(&specs).is_ok_and(|spec| spec.shape.is_empty()) {
                assert!(apply(&case, &empty).is_empty(), "{}", entry.name);
            }
        }
    }
}
