//! Tensors of random numbers, made where they will live.

use std::sync::LazyLock;

use super::{Key, normal};
use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::scalar::Real;
use crate::tensor::for_real;
use crate::{DType, Device, Result, Shape, Spec, Tensor};

/// Fills a tensor of `f32`; the normal distribution's quantile function is the program of the CPU.
pub(crate) static KERNEL: LazyLock<Kernel> = LazyLock::new(|| {
    let text = include_str!("../../kernels/random.wgsl");
    Kernel::around(normal::program().wgsl(), "random".to_owned(), text, &["y"])
});

#[derive(Debug, Clone, Copy)]
enum Distribution {
    Uniform,
    Normal,
}

/// The number from the upper bits that fit: 24 in `f32`, 53 in `f64`.
fn uniform<T: Real>(bits: u64) -> T {
    let digits = if T::DTYPE == DType::F32 { 24 } else { 53 };
    T::from_f64((bits >> (64 - digits)) as f64 * (1.0 / (1u64 << digits) as f64))
}

impl Distribution {
    fn on_cpu(self, key: Key, shape: Shape, dtype: DType) -> Tensor {
        for_real!(dtype, T => {
            let values = filled(shape.len(), CHUNK, |start, out: &mut [T]| match self {
                Self::Uniform => {
                    for (i, out) in (start as u64..).zip(out) {
                        *out = uniform(key.bits(i));
                    }
                }
                Self::Normal => normal::fill(key, start as u64, out),
            });
            Tensor::from_vec(values, shape)
        })
    }

    fn on_gpu(self, key: Key, gpu: &Gpu, shape: Shape) -> Result<Tensor> {
        let len = shape.len();
        let [low, high] = [key.0 & 0xffff_ffff, key.0 >> 32].map(|word| word as usize);
        let sizes = words([len, low, high, usize::from(matches!(self, Self::Normal))]);
        gpu.launch(&KERNEL, &[], &sizes, Spec::new(shape, DType::F32), Work::Invocations(len))
    }

    fn on(self, device: &Device, key: Key, shape: Shape, dtype: DType) -> Result<Tensor> {
        match device {
            Device::Gpu(gpu) if dtype == DType::F32 => self.on_gpu(key, gpu, shape),
            _ => self.on_cpu(key, shape, dtype).to_device(device),
        }
    }
}

impl Tensor {
    /// Uniform numbers in `[0, 1)` on the CPU, multiples of 2⁻²⁴ in `f32` and of 2⁻⁵³ in `f64`: the same ones for every
    /// thread count and platform.
    ///
    /// ```
    /// # use gradreel::{DType, Key, Tensor};
    /// let x = Tensor::uniform(Key::new(7), [3], DType::F64);
    /// assert_eq!(x.slice::<f64>(), Tensor::uniform(Key::new(7), [3], DType::F64).slice::<f64>());
    /// ```
    ///
    /// # Panics
    /// When `dtype` is not `f32` or `f64`.
    #[track_caller]
    pub fn uniform(key: Key, shape: impl Into<Shape>, dtype: DType) -> Self {
        Distribution::Uniform.on_cpu(key, shape.into(), dtype)
    }

    /// Numbers of the standard normal distribution on the CPU; see [`Key::normal`].
    ///
    /// ```
    /// # use gradreel::{DType, Key, Tensor};
    /// let x = Tensor::normal(Key::new(7), [1000], DType::F32);
    /// assert!(x.to_vec()?.iter().sum::<f64>().abs() < 150.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When `dtype` is not `f32` or `f64`.
    #[track_caller]
    pub fn normal(key: Key, shape: impl Into<Shape>, dtype: DType) -> Self {
        Distribution::Normal.on_cpu(key, shape.into(), dtype)
    }

    /// [`Tensor::uniform`], made on a device: bit for bit the same numbers.
    ///
    /// ```
    /// # use gradreel::{DType, Device, Key, Tensor};
    /// let x = Tensor::uniform_on(&Device::Cpu, Key::new(7), [3], DType::F32)?;
    /// assert_eq!(x.len(), 3);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Device`] when it does not fit; [`crate::ErrorKind::Unsupported`] for a dtype the device does
    /// not hold.
    ///
    /// # Panics
    /// When `dtype` is not `f32` or `f64`.
    pub fn uniform_on(device: &Device, key: Key, shape: impl Into<Shape>, dtype: DType) -> Result<Self> {
        Distribution::Uniform.on(device, key, shape.into(), dtype)
    }

    /// [`Tensor::normal`], made on a device: the same numbers but for rounding.
    ///
    /// ```
    /// # use gradreel::{DType, Device, Key, Tensor};
    /// let x = Tensor::normal_on(&Device::Cpu, Key::new(7), [3], DType::F32)?;
    /// assert_eq!(x.len(), 3);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Tensor::uniform_on`].
    ///
    /// # Panics
    /// When `dtype` is not `f32` or `f64`.
    pub fn normal_on(device: &Device, key: Key, shape: impl Into<Shape>, dtype: DType) -> Result<Self> {
        Distribution::Normal.on(device, key, shape.into(), dtype)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_depend_neither_on_the_number_of_threads_nor_on_the_length() {
        let key = Key::new(11);
        let make = |len: usize| (Tensor::uniform(key, [len], DType::F32), Tensor::normal(key, [len], DType::F32));
        let few = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let (u, z) = make(50_000);
        let (one_u, one_z) = few.install(|| make(50_001));
        assert_eq!(u.slice::<f32>(), &one_u.slice::<f32>()[..50_000]);
        assert_eq!(z.slice::<f32>(), &one_z.slice::<f32>()[..50_000]);
        assert!(u.slice::<f32>().iter().all(|u| (0.0..1.0).contains(u)));
    }

    #[test]
    fn dtypes_and_iterators_agree() {
        let key = Key::new(3);
        let wide: Vec<f64> = key.uniform(1000).collect();
        assert_eq!(Tensor::uniform(key, [1000], DType::F64).slice::<f64>(), wide);
        for (a, b) in Tensor::uniform(key, [1000], DType::F32).slice::<f32>().iter().zip(&wide) {
            assert!((0.0..6e-8).contains(&(b - f64::from(*a))));
        }
        let wide: Vec<f64> = key.normal(1000).collect();
        assert_eq!(Tensor::normal(key, [1000], DType::F64).slice::<f64>(), wide);
        for (a, b) in Tensor::normal(key, [1000], DType::F32).slice::<f32>().iter().zip(&wide) {
            assert!((f64::from(*a) - b).abs() < 2e-6 * b.abs().max(1.0), "{a} {b}");
        }
    }
}
