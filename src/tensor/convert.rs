//! Tensors in other forms: dtypes, devices, vectors and arrays.

use half::f16;
use half::slice::HalfFloatSliceExt;
use ndarray::ArrayD;

use crate::backend::cpu::{CHUNK, filled};
use crate::tensor::storage::Storage;
use crate::tensor::{DType, Device, Element, Shape, Tensor};
use crate::{Error, ErrorKind, Result};

impl Tensor {
    /// A copy of the numbers as `f64`, read back from a GPU if need be.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// let x = Tensor::from_vec(vec![1.0f32, 2.0], [2]);
    /// assert_eq!(x.to_vec()?, [1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the read-back fails.
    pub fn to_vec(&self) -> Result<Vec<f64>> {
        let here = self.to_device(&Device::Cpu)?;
        Ok(match self.dtype() {
            DType::F64 => here.slice::<f64>().to_vec(),
            DType::F16 => here.slice::<f16>().iter().map(|v| v.to_f64()).collect(),
            DType::F32 => here.slice::<f32>().iter().map(|&v| v.into()).collect(),
            DType::U32 => here.slice::<u32>().iter().map(|&v| v.into()).collect(),
        })
    }

    /// The only number of a tensor of one element.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// assert_eq!(Tensor::from_vec(vec![7u32], [1]).item()?, 7.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when there is not exactly one; [`ErrorKind::Device`] when the read-back fails.
    pub fn item(&self) -> Result<f64> {
        if self.len() != 1 {
            return Err(Error::new(ErrorKind::Shape, "item: not a single number").found(format!("{:?}", self.spec())));
        }
        Ok(self.to_vec()?[0])
    }

    /// The same numbers in another dtype, each the nearest there is; shares storage if it is the same.
    ///
    /// Between `f16` and `f32` a GPU does it where the numbers are; other dtypes go through the CPU.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::from_vec(vec![1.0, 2.0], [2]).cast(DType::F16)?;
    /// assert_eq!(x.bytes(), 4);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when a GPU tensor cannot be read back; [`ErrorKind::Unsupported`] for a dtype that its
    /// device does not hold.
    pub fn cast(&self, dtype: DType) -> Result<Self> {
        match (self.dtype(), dtype, self.storage()) {
            (from, to, _) if from == to => Ok(self.clone()),
            (DType::F16, DType::F32, Storage::Gpu(buffer)) => buffer.gpu().widen(self),
            (DType::F32, DType::F16, Storage::Gpu(buffer)) => buffer.gpu().narrow(self),
            (.., Storage::Gpu(_)) => self.to_device(&Device::Cpu)?.cast(dtype)?.to_device(&self.device()),
            _ => Ok(self.cast_here(dtype)),
        }
    }

    fn cast_here(&self, dtype: DType) -> Self {
        match (self.dtype(), dtype) {
            // by the processor's own instructions where it has them
            (DType::F16, DType::F32) => self.convert(<[f16]>::convert_to_f32_slice),
            (DType::F16, DType::F64) => self.convert(<[f16]>::convert_to_f64_slice),
            (DType::F32, DType::F16) => self.convert(|from: &[f32], to: &mut [f16]| to.convert_from_f32_slice(from)),
            (DType::F64, DType::F16) => self.convert(|from: &[f64], to: &mut [f16]| to.convert_from_f64_slice(from)),
            (DType::F32, DType::F64) => self.convert(each(|v: f32| f64::from(v))),
            (DType::F64, DType::F32) => self.convert(each(|v: f64| v as f32)),
            (DType::U32, DType::F32) => self.convert(each(|v: u32| v as f32)),
            (DType::U32, DType::F64) => self.convert(each(|v: u32| f64::from(v))),
            (DType::U32, DType::F16) => self.convert(each(|v: u32| f16::from_f64(v.into()))),
            (DType::F16, DType::U32) => self.convert(each(|v: f16| v.to_f64() as u32)),
            (DType::F32, DType::U32) => self.convert(each(|v: f32| v as u32)),
            (DType::F64, DType::U32) => self.convert(each(|v: f64| v as u32)),
            (DType::F16, DType::F16) | (DType::F32, DType::F32) => self.clone(),
            (DType::F64, DType::F64) | (DType::U32, DType::U32) => self.clone(),
        }
    }

    fn convert<A: Element, B: Element>(&self, convert: impl Fn(&[A], &mut [B]) + Sync) -> Self {
        let values = self.slice::<A>();
        let converted = filled(values.len(), CHUNK, |start, part: &mut [B]| {
            convert(&values[start..start + part.len()], part);
        });
        Self::from_vec(converted, self.shape())
    }

    /// The same tensor on another device; shares storage if it is there already.
    ///
    /// ```
    /// # use gradreel::{Device, Tensor};
    /// let x = Tensor::from_vec(vec![1.0f32], [1]);
    /// let there = x.to_device(&Device::Cpu)?; // or &Device::gpu()?
    /// assert_eq!(there.item()?, 1.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the transfer fails; [`ErrorKind::Unsupported`] for a dtype the device does not hold.
    pub fn to_device(&self, device: &Device) -> Result<Self> {
        match (self.storage(), device) {
            (Storage::Hollow(..), _) => self.panic_hollow(),
            (Storage::Cpu(_) | Storage::One(_), Device::Cpu) => Ok(self.clone()),
            (Storage::Gpu(buffer), Device::Gpu(gpu)) if buffer.gpu().same(gpu) => Ok(self.clone()),
            (Storage::Gpu(_), Device::Gpu(_)) => self.to_device(&Device::Cpu)?.to_device(device),
            (Storage::Gpu(buffer), Device::Cpu) => match self.dtype() {
                DType::F16 => {
                    // two to a word: the last may be alone
                    let mut halves = buffer.read::<f16>()?;
                    halves.truncate(self.len());
                    Ok(Self::from_vec(halves, self.shape()))
                }
                DType::U32 => Ok(Self::from_vec(buffer.read::<u32>()?, self.shape())),
                _ => Ok(Self::from_vec(buffer.read::<f32>()?, self.shape())),
            },
            (_, Device::Gpu(gpu)) => {
                let buffer = match self.dtype() {
                    DType::F32 => gpu.upload(bytemuck::cast_slice(self.slice::<f32>()))?,
                    DType::F16 => gpu.upload(bytemuck::cast_slice(self.slice::<f16>()))?,
                    DType::U32 => {
                        let indices = self.slice::<u32>();
                        gpu.upload(bytemuck::cast_slice(indices))?.remember(indices)
                    }
                    DType::F64 => {
                        return Err(Error::new(
                            ErrorKind::Unsupported,
                            "the GPU backend holds f32, f16 and u32 tensors",
                        )
                        .found(format!("{:?}", self.spec()))
                        .fix("cast to f32 first"));
                    }
                };
                Ok(Self::from_gpu(buffer, self.spec()))
            }
        }
    }

    /// Whether no element is NaN or infinite.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// assert!(!Tensor::from_vec(vec![1.0, f64::NAN], [2]).all_finite()?);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the read-back fails.
    pub fn all_finite(&self) -> Result<bool> {
        let here = self.to_device(&Device::Cpu)?;
        Ok(match self.dtype() {
            DType::F16 => here.slice::<f16>().iter().all(|v| v.is_finite()),
            DType::F32 => here.slice::<f32>().iter().all(|v| v.is_finite()),
            DType::F64 => here.slice::<f64>().iter().all(|v| v.is_finite()),
            DType::U32 => true,
        })
    }
}

/// A conversion of slices from one of elements.
fn each<A: Element, B: Element>(convert: impl Fn(A) -> B + Sync) -> impl Fn(&[A], &mut [B]) + Sync {
    move |from, to| from.iter().zip(to).for_each(|(&from, to)| *to = convert(from))
}

impl<T: Element> From<ArrayD<T>> for Tensor {
    fn from(array: ArrayD<T>) -> Self {
        let shape = Shape::from(array.shape());
        let array = if array.is_standard_layout() { array } else { array.as_standard_layout().into_owned() };
        let (values, offset) = array.into_raw_vec_and_offset();
        let start = offset.unwrap_or(0);
        let len = shape.len();
        let exact = if start == 0 && values.len() == len { values } else { values[start..start + len].to_vec() };
        Self::from_vec(exact, shape)
    }
}
