//! Casts: every `f16` there is, rounding, gradients, on the CPU and on a GPU.

use std::panic::{AssertUnwindSafe, catch_unwind};

use gradreel::{DType, Device, Tape, Tensor};
use half::f16;

/// The CPU, and the GPU where there is one.
fn devices() -> Vec<Device> {
    match Device::gpu() {
        Ok(gpu) => vec![Device::Cpu, gpu],
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => panic!("the GPU must be tested: {error}"),
        Err(error) => {
            eprintln!("the CPU only, because there is no GPU: {error}");
            vec![Device::Cpu]
        }
    }
}

fn cast(values: Tensor, dtype: DType, device: &Device) -> Tensor {
    values.to_device(device).unwrap().cast(dtype).unwrap().to_device(&Device::Cpu).unwrap()
}

#[test]
fn every_half_widens_to_the_same_number() {
    // an odd number of them, so that the last word on a GPU is half empty
    let all: Vec<f16> = (0..=u16::MAX).chain([0x3c01]).map(f16::from_bits).collect();
    for device in devices() {
        let wide = cast(Tensor::from_vec(all.clone(), [all.len()]), DType::F32, &device);
        for (half, wide) in all.iter().zip(wide.slice::<f32>()) {
            let expected = half.to_f32();
            let same = wide.to_bits() == expected.to_bits() || (wide.is_nan() && expected.is_nan());
            assert!(same, "{device}: {:#06x} became {wide}, not {expected}", half.to_bits());
        }
    }
}

#[test]
fn every_float_narrows_to_the_nearest_half() {
    // each half, what lies around the middle to the next one, and what is too large or too small
    let mut floats = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MAX, -f32::MAX, 1e-10, -1e-40];
    for bits in (0..0x7c00u16).step_by(3).chain(0..40).chain(0x03f0..0x0410).chain(0x7bf0..0x7c00) {
        let (low, high) = (f16::from_bits(bits).to_f32(), f16::from_bits(bits + 1).to_f32());
        let middle = if high.is_finite() { 0.5 * (low + high) } else { 65520.0 };
        for value in [low, middle, middle.next_up(), middle.next_down()] {
            floats.extend([value, -value]);
        }
    }
    floats.push(1.0);
    for device in devices() {
        let narrow = cast(Tensor::from_vec(floats.clone(), [floats.len()]), DType::F16, &device);
        for (float, half) in floats.iter().zip(narrow.slice::<f16>()) {
            let expected = f16::from_f32(*float);
            let same = half.to_bits() == expected.to_bits() || (half.is_nan() && expected.is_nan());
            assert!(same, "{device}: {float:e} became {half:?}, not {expected:?}");
        }
    }
}

#[test]
fn large_tensors_are_cast_in_chunks() {
    let values: Vec<f64> = (0..100_003).map(|i| f64::from(i % 2048) * 0.25).collect();
    let x = Tensor::from_vec(values.clone(), [values.len()]);
    for dtype in [DType::F16, DType::F32] {
        let there = x.cast(dtype).unwrap();
        assert_eq!(there.dtype(), dtype);
        assert_eq!(there.cast(DType::F64).unwrap().slice::<f64>(), values);
    }
    let whole = x.cast(DType::U32).unwrap().cast(DType::F32).unwrap();
    assert!(whole.slice::<f32>().iter().zip(&values).all(|(a, b)| f64::from(*a) == b.floor()));
}

#[test]
fn gradients_of_halves_are_floats() {
    for device in devices() {
        let stored = Tensor::from_vec(vec![0.5f32, -2.0, 0.25], [3, 1]).cast(DType::F16).unwrap();
        let tape = Tape::new();
        let weight = tape.leaf(stored.to_device(&device).unwrap());
        let x = tape.constant(Tensor::from_vec(vec![1e-9f32, 1.0, 3.0], [1, 3]).to_device(&device).unwrap());
        let used = weight.reshape([1, 3]).to_dtype(DType::F32);
        // two paths, so that cotangents are added at the half
        let y = (&used * &x).sum_all() + x.matmul(&weight.to_dtype(DType::F32)).sum_all();
        assert!((y.item().unwrap() + 2.5).abs() < 1e-6);
        let gradients = y.into_gradients().unwrap();
        let gradient = gradients.wrt(&weight).unwrap();
        assert_eq!((gradient.dtype(), gradient.dims()), (DType::F32, &[3, 1][..]));
        assert_eq!(gradient.to_device(&Device::Cpu).unwrap().slice::<f32>(), &[2e-9, 2.0, 6.0]);
    }
    // and the other way: what is cast to half and back
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 3.0], [2]));
    let y = x.to_dtype(DType::F16).to_dtype(DType::F64).square().sum_all();
    assert_eq!(y.backward().unwrap().wrt(&x).unwrap().slice::<f64>(), &[2.0, 6.0]);
}

#[test]
fn kernels_of_floats_refuse_halves() {
    for device in devices() {
        let Device::Gpu(_) = device else { continue };
        let tape = Tape::new();
        let x = tape.constant(Tensor::full(1.0, [4], DType::F16).to_device(&device).unwrap());
        let refused = catch_unwind(AssertUnwindSafe(|| x.broadcast_to([2, 4]))).unwrap_err();
        let message = refused.downcast_ref::<String>().unwrap();
        assert!(message.contains("broadcast_to") && message.contains("f16"), "{message}");
    }
}

#[test]
#[should_panic(expected = "only floats have derivatives")]
fn indices_are_not_differentiable() {
    let _ = Tape::new().leaf(Tensor::full(1.0, [2], DType::F32)).to_dtype(DType::U32);
}
