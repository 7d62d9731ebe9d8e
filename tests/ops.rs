//! Every op of the registry: gradient check in `f64`, `f32` against `f64`, non-finite operands, empty shapes.

use gradreel::backend::cpu::pool;
use gradreel::ops::{Case, registry};
use gradreel::{DType, Tape, Tensor, Var, gradcheck};

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
            let names: Vec<String> = (0..case.inputs.len()).map(|i| format!("x{i}")).collect();
            let (real, fixed): (Vec<_>, Vec<_>) =
                (0..case.inputs.len()).partition(|&i| case.inputs[i].dtype() == DType::F64);
            let inputs: Vec<_> = real.iter().map(|&i| (names[i].as_str(), case.inputs[i].clone())).collect();
            let specs: Vec<_> = case.inputs.iter().map(Tensor::spec).collect();
            let numbers = case.op.infer(&specs).unwrap().dtype == DType::U32;
            if numbers || inputs.iter().all(|(_, x)| x.is_empty()) {
                continue;
            }
            let name = format!("{} case {number}", entry.name);
            let report = gradcheck(&name, &inputs, |tape, vars| {
                let mut operands = vec![None; case.inputs.len()];
                real.iter().zip(vars).for_each(|(&i, var)| operands[i] = Some(var.clone()));
                fixed.iter().for_each(|&i| operands[i] = Some(tape.constant(case.inputs[i].clone())));
                let operands: Vec<Var> = operands.into_iter().flatten().collect();
                tape.apply(case.op.clone(), &operands.iter().collect::<Vec<_>>())
            })
            .unwrap();
            assert!(report.passed(), "{report}");
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
