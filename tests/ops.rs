//! Every op of the registry: gradient check in `f64`, `f32` against `f64`, non-finite operands, empty shapes.

use std::collections::BTreeSet;
use std::rc::Rc;

use gradreel::backend::cpu::pool;
use gradreel::ops::{Case, registry};
use gradreel::{Backward, DType, ErrorKind, Forward, GradReport, Op, Operands, Result, Spec, Tape, Tensor, Var};

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

/// Zeros of a type, or small numbers.
fn filled(shape: &[usize], dtype: DType) -> Tensor {
    Tensor::full(if dtype == DType::U32 { 0.0 } else { 0.25 }, shape, dtype)
}

/// The operands with one of them made shorter, longer, of another rank or type; and fewer and more of them.
fn spoilt(inputs: &[Tensor]) -> Vec<Vec<Tensor>> {
    let mut all = vec![Vec::new(), inputs[..inputs.len() - 1].to_vec(), [inputs, &inputs[..1]].concat()];
    let mut with = |number: usize, x: Tensor| {
        let mut changed = inputs.to_vec();
        changed[number] = x;
        all.push(changed);
    };
    for (number, x) in inputs.iter().enumerate() {
        let dims = x.dims().to_vec();
        for axis in 0..dims.len() {
            for size in [0, dims[axis].saturating_sub(1), dims[axis] + 1, 3 * dims[axis] + 7] {
                let mut other = dims.clone();
                other[axis] = size;
                with(number, filled(&other, x.dtype()));
            }
        }
        with(number, filled(&[&dims[..], &[2]].concat(), x.dtype()));
        with(number, filled(&[], x.dtype()));
        for dtype in [DType::F16, DType::F32, DType::F64, DType::U32] {
            with(number, filled(&dims, dtype));
        }
    }
    all
}

/// What is wrong with an op's answer to some operands, if anything is.
fn fault_of(op: &dyn Op, inputs: &[Tensor]) -> Option<String> {
    let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
    let run = || match (op.infer(&specs), op.forward(inputs)) {
        (Ok(spec), Ok(found)) => (found.output.spec() != spec).then(|| format!("{spec:?} was promised")),
        // data that do not fit, such as offsets, are the forward pass's to refuse
        (Ok(_), Err(error)) => (error.kind() == ErrorKind::Shape).then(|| format!("the shape rule forgot: {error}")),
        (Err(_), Ok(_)) => Some("was computed".to_owned()),
        (Err(error), Err(_)) => {
            let said = error.to_string().contains(op.name()) || error.to_string().contains("broadcast");
            let kind = [ErrorKind::Shape, ErrorKind::Unsupported].contains(&error.kind());
            (!said || !kind).then(|| format!("was refused with {error:?}"))
        }
    };
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).unwrap_or_else(|_| Some("panics".to_owned()))
}

#[test]
fn operands_that_a_shape_rule_refuses_never_reach_a_kernel() {
    let mut wrong = BTreeSet::new();
    for entry in registry() {
        for case in (entry.cases)() {
            for inputs in spoilt(&case.inputs) {
                let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
                if let Some(fault) = fault_of(&*case.op, &inputs) {
                    wrong.insert(format!("{} of {specs:?}: {fault}", entry.name));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{:#?}", wrong);
}

/// An op of somebody's whose shape rule accepts anything, and who hands the operands on to one of the crate's.
#[derive(Debug)]
struct Careless(Rc<dyn Op>);

impl Op for Careless {
    fn name(&self) -> &'static str {
        "careless"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        Ok(inputs[0].clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        self.0.forward_cpu(inputs)
    }

    fn vjp(&self, _cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(Vec::new())
    }
}

#[test]
fn kernels_look_at_sizes_themselves_when_a_shape_rule_lies() {
    let mut caught = 0;
    for entry in registry() {
        for case in (entry.cases)() {
            let careless = Careless(case.op.clone());
            for inputs in spoilt(&case.inputs) {
                let run = || careless.forward(&inputs).map(|found| found.output.len());
                caught += usize::from(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
            }
        }
    }
    assert!(caught > 100, "only {caught} were found out");
}

#[test]
fn a_short_volume_is_refused_with_its_name() {
    let case =
        registry().into_iter().find(|entry| entry.name == "depth_attention").map(|entry| (entry.cases)().remove(0));
    let case = case.unwrap();
    let [q, k] = [case.inputs[0].clone(), case.inputs[1].clone()];
    let mut dims = k.dims().to_vec();
    dims[3] -= 1;
    let error = case.op.forward(&[q, k, filled(&dims, DType::F64)]).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Shape);
    assert!(error.to_string().contains("depth_attention"), "{error}");
}
