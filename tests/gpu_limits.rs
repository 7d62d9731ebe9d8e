//! What does not fit one binding or one axis of a dispatch, met on tiny tensors by lowering the limits.

use gradreel::backend::gpu::{Gpu, GpuLimits};
use gradreel::ops::uniform;
use gradreel::{DType, Device, ErrorKind, Result, Tape, Tensor, Var, devicecheck};

/// A GPU with bindings of 256 numbers and three workgroups an axis.
fn small() -> Option<Device> {
    let limits = GpuLimits { buffer_bytes: 1 << 16, binding_bytes: 1024, groups_per_axis: 3 };
    match Gpu::open_within(limits) {
        Ok(gpu) => {
            assert_eq!(gpu.limits(), limits);
            assert!(format!("{gpu:?}").contains("1024 a binding"), "{gpu:?}");
            Some(Device::Gpu(gpu))
        }
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => panic!("the GPU must be tested: {error}"),
        Err(error) => {
            eprintln!("skipped, because there is no GPU: {error}");
            None
        }
    }
}

#[test]
fn pointwise_ops_copies_and_reductions_run_by_parts() {
    let Some(gpu) = small() else { return };
    type Function = fn(&[Var]) -> Var;
    let cases: [(&str, Vec<Vec<usize>>, Function); 9] = [
        ("fits", vec![vec![256]], |v| v[0].exp()),
        ("map", vec![vec![1000]], |v| v[0].exp()),
        ("map of two", vec![vec![31, 33], vec![31, 33]], |v| &v[0] * &v[1]),
        ("map with a number", vec![vec![700], vec![1]], |v| &v[0] / &(&v[1] + 2.0)),
        ("map with a row", vec![vec![64, 16], vec![16]], |v| &v[0] * &v[1]),
        ("broadcast", vec![vec![4, 1]], |v| v[0].broadcast_to([4, 128])),
        ("sum of all", vec![vec![999]], |v| v[0].sum_all()),
        ("sum of rows", vec![vec![64, 16]], |v| v[0].sum(&[1])),
        ("sum of columns", vec![vec![64, 16]], |v| v[0].sum(&[0])),
    ];
    for (name, shapes, function) in cases {
        let names = ["x", "y"];
        let inputs: Vec<(&str, Tensor)> = shapes
            .iter()
            .enumerate()
            .map(|(i, shape)| (names[i], uniform(i as u64, shape.clone(), -1.0..1.0)))
            .collect();
        let run = |tape: &Tape, v: &[Var]| {
            let y = function(v);
            tape.check()?;
            Ok(y)
        };
        let report = devicecheck(name, &gpu, &inputs, 5e-6, run).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(report.passed(), "{report}");
    }
}

#[test]
fn halves_are_cast_by_parts() {
    let Some(gpu) = small() else { return };
    let values: Vec<f32> = (0..1001).map(|i| i as f32 * 0.5 - 100.0).collect();
    let x = Tensor::from_vec(values.clone(), [values.len()]).to_device(&gpu).unwrap();
    let back = x.cast(DType::F16).unwrap().cast(DType::F32).unwrap();
    assert_eq!(back.to_device(&Device::Cpu).unwrap().slice::<f32>(), values);
}

#[test]
fn what_cannot_be_split_is_refused_with_size_limit_and_fix() {
    let Some(gpu) = small() else { return };
    let on_gpu =
        |tape: &Tape, shape: [usize; 2]| tape.constant(Tensor::full(1.0, shape, DType::F32).to_device(&gpu).unwrap());
    let tape = Tape::new();
    let refused: [(&str, &str, Result<Tensor>); 2] = [
        // every part of the result takes elements from all over the operand, the first one from 1000 of them
        ("permute", "4000 bytes", on_gpu(&tape, [32, 32]).permute(&[1, 0]).value().cloned()),
        (
            "matmul",
            "4096 bytes",
            on_gpu(&Tape::new(), [32, 32]).matmul(&on_gpu(&Tape::new(), [32, 8])).value().cloned(),
        ),
    ];
    for (name, size, outcome) in refused {
        let error = outcome.unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Device, "{name}: {error}");
        let text = error.to_string();
        for part in [size, "1024 bytes", "to_device(&Device::Cpu)"] {
            assert!(text.contains(part), "{name}: {part} is not in: {text}");
        }
    }
    let error = Tensor::full(1.0, [1 << 15], DType::F32).to_device(&gpu).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Device);
    assert!(error.to_string().contains("131072 bytes") && error.to_string().contains("65536 bytes"), "{error}");
}

#[test]
fn dispatches_use_three_axes() {
    let Some(gpu) = small() else { return };
    let Device::Gpu(opened) =
        Gpu::open_within(GpuLimits { groups_per_axis: 2, ..GpuLimits::NONE }).map(Device::Gpu).unwrap()
    else {
        return;
    };
    let tape = Tape::new();
    // eight workgroups of 256: two along each axis
    let x = tape.constant(uniform(1, [2000], -1.0..1.0).cast(DType::F32).unwrap());
    let there = tape.constant(x.value().unwrap().to_device(&Device::Gpu(opened)).unwrap());
    let (a, b) = ((&x + &x).value().unwrap().to_vec().unwrap(), (&there + &there).value().unwrap().to_vec().unwrap());
    assert_eq!(a, b);
    drop(gpu);
}
