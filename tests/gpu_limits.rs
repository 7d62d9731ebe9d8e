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
    let cases: [(&str, Vec<Vec<usize>>, Function); 28] = [
        ("fits", vec![vec![256]], |v| v[0].exp()),
        ("map", vec![vec![1000]], |v| v[0].exp()),
        ("map of two", vec![vec![31, 33], vec![31, 33]], |v| &v[0] * &v[1]),
        ("map with a number", vec![vec![700], vec![1]], |v| &v[0] / &(&v[1] + 2.0)),
        ("map with a row", vec![vec![64, 16], vec![16]], |v| &v[0] * &v[1]),
        ("broadcast", vec![vec![4, 1]], |v| v[0].broadcast_to([4, 128])),
        ("sum of all", vec![vec![999]], |v| v[0].sum_all()),
        ("sum of rows", vec![vec![64, 16]], |v| v[0].sum(&[1])),
        ("sum of columns", vec![vec![64, 16]], |v| v[0].sum(&[0])),
        ("sum of the middle", vec![vec![32, 4, 8]], |v| v[0].sum(&[1])),
        ("sum of both ends", vec![vec![2, 128, 4]], |v| v[0].sum(&[0, 2])),
        ("sum of few long rows", vec![vec![3, 500]], |v| v[0].sum(&[1])),
        ("sum of a few rows into many", vec![vec![3, 500]], |v| v[0].sum(&[0])),
        ("sum over every other axis", vec![vec![5, 7, 6, 11]], |v| v[0].sum(&[0, 2])),
        ("sum over the others", vec![vec![5, 7, 6, 11]], |v| v[0].sum(&[1, 3])),
        ("largest", vec![vec![64, 16]], |v| v[0].max(&[0])),
        ("largest of rows", vec![vec![300, 3]], |v| v[0].max(&[1])),
        ("smallest of the middle", vec![vec![4, 33, 9]], |v| v[0].min(&[1])),
        ("smallest of all", vec![vec![31, 33]], |v| v[0].min(&[0, 1])),
        ("slice", vec![vec![50, 20]], |v| v[0].slice(0, 7..48)),
        ("slice of rows", vec![vec![50, 20]], |v| v[0].slice(1, 3..18)),
        ("permute", vec![vec![40, 5, 6]], |v| v[0].permute(&[0, 2, 1])),
        ("transpose", vec![vec![32, 33]], |v| v[0].permute(&[1, 0])),
        ("flip", vec![vec![40, 20]], |v| v[0].flip(1)),
        ("flip of all", vec![vec![900]], |v| v[0].flip(0)),
        ("pad", vec![vec![20, 20]], |v| v[0].pad(1, 7, 30)),
        ("pad in front", vec![vec![33, 10]], |v| v[0].pad(0, 40, 3)),
        ("concat", vec![vec![30, 17], vec![30, 5]], |v| v[0].concat(&[&v[1], &v[0]], 1)),
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
fn ties_and_nan_are_found_by_parts_where_they_are_first() {
    let Some(gpu) = small() else { return };
    let mut values: Vec<f32> = (0..40 * 30).map(|i| (i * 7 % 13) as f32).collect();
    (values[777], values[1100], values[37]) = (f32::NAN, f32::NAN, 99.0);
    let x = Tensor::from_vec(values, [40, 30]);
    for axis in [0, 1] {
        let found = |x: Tensor| {
            let tape = Tape::new();
            let x = tape.constant(x);
            [x.argmax(axis), x.argmin(axis)].map(|y| y.value().unwrap().to_device(&Device::Cpu).unwrap())
        };
        for (a, b) in found(x.to_device(&gpu).unwrap()).iter().zip(&found(x.clone())) {
            assert_eq!(a.slice::<u32>(), b.slice::<u32>(), "axis {axis}");
        }
    }
}

#[test]
fn what_cannot_be_split_is_refused_with_size_limit_and_fix() {
    let Some(gpu) = small() else { return };
    let on_gpu =
        |tape: &Tape, shape: [usize; 2]| tape.constant(Tensor::full(1.0, shape, DType::F32).to_device(&gpu).unwrap());
    let refused: [(&str, &str, Result<Tensor>); 2] = [
        ("softmax", "4096 bytes", on_gpu(&Tape::new(), [32, 32]).softmax(1).value().cloned()),
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
