//! The tensor itself: a shape over shared, immutable storage.

use std::fmt;
use std::sync::{Arc, LazyLock};

use half::f16;
use ndarray::{ArrayD, ArrayViewD, IxDyn};

use crate::backend::cpu::{CHUNK, filled, pool};
use crate::backend::gpu::GpuBuffer;
use crate::tensor::{DType, Device, Element, Shape, Spec};
use crate::{Error, ErrorKind, Result};

/// The numbers of a tensor, on the device where they live.
#[derive(Debug)]
pub(crate) enum Storage {
    F16(Vec<f16>),
    F32(Vec<f32>),
    F64(Vec<f64>),
    U32(Vec<u32>),
    Gpu(GpuBuffer),
    /// No numbers any more: they were on this device.
    Hollow(Device),
}

impl Drop for Storage {
    /// Buffers go back to the pools that results come from.
    fn drop(&mut self) {
        match self {
            Self::F16(values) => pool::give(std::mem::take(values)),
            Self::F32(values) => pool::give(std::mem::take(values)),
            Self::F64(values) => pool::give(std::mem::take(values)),
            Self::U32(values) => pool::give(std::mem::take(values)),
            // its own drop does so
            Self::Gpu(_) | Self::Hollow(_) => {}
        }
    }
}

/// A contiguous, row-major, immutable array; cloning shares its storage.
///
/// ```
/// use gradreel::Tensor;
///
/// let x = Tensor::from_vec(vec![1.0f32, 2.0, 3.0, 4.0], [2, 2]);
/// assert_eq!(x.reshape([4]).slice::<f32>(), &[1.0, 2.0, 3.0, 4.0]);
/// assert_eq!(x.view::<f32>()[[1, 0]], 3.0);
/// ```
#[derive(Clone)]
pub struct Tensor {
    shape: Shape,
    dtype: DType,
    storage: Arc<Storage>,
}

impl Tensor {
    /// A tensor on the CPU that takes over `values`.
    ///
    /// # Panics
    /// When the number of values is not that of the shape.
    #[track_caller]
    pub fn from_vec<T: Element>(values: Vec<T>, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(values.len(), shape.len(), "from_vec: {} values do not fill shape {shape}", values.len());
        Self { shape, dtype: T::DTYPE, storage: Arc::new(wrap(values)) }
    }

    /// A tensor on the CPU filled with one value.
    pub fn full(value: f64, shape: impl Into<Shape>, dtype: DType) -> Self {
        let shape = shape.into();
        let len = shape.len();
        fn constant<T: Element>(value: f64, len: usize) -> Storage {
            let value = T::from_f64(value);
            wrap(filled(len, CHUNK, |_, part: &mut [T]| part.fill(value)))
        }
        let storage = match dtype {
            DType::F16 => constant::<f16>(value, len),
            DType::F32 => constant::<f32>(value, len),
            DType::F64 => constant::<f64>(value, len),
            DType::U32 => constant::<u32>(value, len),
        };
        Self { shape, dtype, storage: Arc::new(storage) }
    }

    /// A tensor of zeros on the CPU.
    pub fn zeros(shape: impl Into<Shape>, dtype: DType) -> Self {
        Self::full(0.0, shape, dtype)
    }

    /// A single number without axes, on the CPU.
    pub fn scalar(value: f64, dtype: DType) -> Self {
        Self::full(value, Shape::scalar(), dtype)
    }

    /// A tensor over a device buffer.
    pub(crate) fn from_gpu(buffer: GpuBuffer, spec: Spec) -> Self {
        Self { shape: spec.shape, dtype: spec.dtype, storage: Arc::new(Storage::Gpu(buffer)) }
    }

    /// Sizes per axis.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Sizes per axis as a slice.
    pub fn dims(&self) -> &[usize] {
        self.shape.dims()
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.shape.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.shape.is_empty()
    }

    /// Element type.
    pub fn dtype(&self) -> DType {
        self.dtype
    }

    /// Shape and dtype together.
    pub fn spec(&self) -> Spec {
        Spec::new(&self.shape, self.dtype)
    }

    /// Bytes of the numbers.
    pub fn bytes(&self) -> usize {
        self.len() * self.dtype.size()
    }

    /// Shape, dtype and device alone: what a tape keeps of a tensor whose numbers nobody will read.
    pub(crate) fn hollow(&self) -> Self {
        static ON_CPU: LazyLock<Arc<Storage>> = LazyLock::new(|| Arc::new(Storage::Hollow(Device::Cpu)));
        let storage = match self.device() {
            Device::Cpu => ON_CPU.clone(),
            device => Arc::new(Storage::Hollow(device)),
        };
        Self { shape: self.shape.clone(), dtype: self.dtype, storage }
    }

    #[track_caller]
    fn panic_hollow(&self) -> ! {
        panic!(
            "the numbers of {:?} were freed: this derivative reads a value that its op's `reads` leaves out",
            self.spec()
        )
    }

    /// What tells storages apart; `None` where there are no numbers.
    pub(crate) fn storage_address(&self) -> Option<usize> {
        match &*self.storage {
            Storage::Hollow(_) => None,
            _ => Some(Arc::as_ptr(&self.storage) as usize),
        }
    }

    /// Where the numbers live.
    pub fn device(&self) -> Device {
        match &*self.storage {
            Storage::Gpu(buffer) => Device::Gpu(buffer.gpu().clone()),
            Storage::Hollow(device) => device.clone(),
            _ => Device::Cpu,
        }
    }

    /// The device buffer of a tensor on a GPU.
    ///
    /// # Panics
    /// When the tensor is on the CPU.
    #[track_caller]
    pub(crate) fn gpu_buffer(&self) -> &GpuBuffer {
        match &*self.storage {
            Storage::Gpu(buffer) => buffer,
            Storage::Hollow(_) => self.panic_hollow(),
            _ => panic!("the tensor {:?} is on the CPU; move it with to_device first", self.spec()),
        }
    }

    /// The numbers of a CPU tensor.
    ///
    /// # Panics
    /// When `T` is not the tensor's dtype, or the tensor is on a GPU (see [`Tensor::to_vec`]).
    #[track_caller]
    pub fn slice<T: Element>(&self) -> &[T] {
        assert_eq!(T::DTYPE, self.dtype, "slice: the tensor {:?} was read as {}", self.spec(), T::DTYPE);
        match &*self.storage {
            Storage::F16(values) => bytemuck::cast_slice(values),
            Storage::F32(values) => bytemuck::cast_slice(values),
            Storage::F64(values) => bytemuck::cast_slice(values),
            Storage::U32(values) => bytemuck::cast_slice(values),
            Storage::Gpu(_) => panic!("slice: the tensor {:?} is on a GPU; read it with to_vec", self.spec()),
            Storage::Hollow(_) => self.panic_hollow(),
        }
    }

    /// The numbers of a CPU tensor for writing. Tensors that share them keep what they have: they are copied first then.
    ///
    /// # Panics
    /// As [`Tensor::slice`].
    #[track_caller]
    pub(crate) fn slice_mut<T: Element>(&mut self) -> &mut [T] {
        if Arc::get_mut(&mut self.storage).is_none() {
            let old = self.slice::<T>();
            let copy = filled(old.len(), CHUNK, |start, part: &mut [T]| {
                part.copy_from_slice(&old[start..start + part.len()]);
            });
            *self = Self::from_vec(copy, &self.shape);
        }
        assert_eq!(T::DTYPE, self.dtype, "slice_mut: the tensor {:?} was written as {}", self.spec(), T::DTYPE);
        match Arc::get_mut(&mut self.storage).expect("nobody shares it") {
            Storage::F16(values) => bytemuck::cast_slice_mut(values),
            Storage::F32(values) => bytemuck::cast_slice_mut(values),
            Storage::F64(values) => bytemuck::cast_slice_mut(values),
            Storage::U32(values) => bytemuck::cast_slice_mut(values),
            Storage::Gpu(_) => panic!("slice_mut: the tensor is on a GPU"),
            Storage::Hollow(_) => panic!("slice_mut: the tape has freed the numbers of this tensor"),
        }
    }

    /// The numbers of a CPU tensor as an ndarray view.
    ///
    /// # Panics
    /// As [`Tensor::slice`].
    #[track_caller]
    pub fn view<T: Element>(&self) -> ArrayViewD<'_, T> {
        ArrayViewD::from_shape(IxDyn(self.dims()), self.slice()).expect("tensors are contiguous")
    }

    /// A copy of the numbers as `f64`, read back from a GPU if need be.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the read-back fails.
    pub fn to_vec(&self) -> Result<Vec<f64>> {
        fn wide<T: Element>(values: &[T]) -> Vec<f64> {
            values.iter().map(|v| v.to_f64()).collect()
        }
        Ok(match &*self.storage {
            Storage::F16(values) => wide(values),
            Storage::F32(values) => wide(values),
            Storage::F64(values) => values.clone(),
            Storage::U32(values) => wide(values),
            Storage::Gpu(_) => return self.to_device(&Device::Cpu)?.to_vec(),
            Storage::Hollow(_) => self.panic_hollow(),
        })
    }

    /// The only number of a tensor of one element.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when there is not exactly one; [`ErrorKind::Device`] when the read-back fails.
    pub fn item(&self) -> Result<f64> {
        match self.to_vec()?[..] {
            [value] => Ok(value),
            _ => Err(Error::new(ErrorKind::Shape, "item: not a single number").found(format!("{:?}", self.spec()))),
        }
    }

    /// The same numbers under another shape; shares storage.
    ///
    /// # Panics
    /// When the number of elements differs.
    #[track_caller]
    pub fn reshape(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(self.len(), shape.len(), "reshape: {} does not fit {shape}", self.shape);
        Self { shape, ..self.clone() }
    }

    /// The same numbers in another dtype; shares storage if it is the same.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when a GPU tensor cannot be read back.
    pub fn cast(&self, dtype: DType) -> Result<Self> {
        if dtype == self.dtype {
            return Ok(self.clone());
        }
        let values = self.to_vec()?;
        let narrow = match dtype {
            DType::F16 => Self::from_vec(values.into_iter().map(f16::from_f64).collect(), &self.shape),
            DType::F32 => Self::from_vec(values.into_iter().map(|v| v as f32).collect(), &self.shape),
            DType::F64 => Self::from_vec(values, &self.shape),
            DType::U32 => Self::from_vec(values.into_iter().map(|v| v as u32).collect(), &self.shape),
        };
        narrow.to_device(&self.device())
    }

    /// The same tensor on another device; shares storage if it is there already.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the transfer fails; [`ErrorKind::Unsupported`] for a dtype the device does not hold.
    pub fn to_device(&self, device: &Device) -> Result<Self> {
        match (&*self.storage, device) {
            (Storage::Hollow(_), _) => self.panic_hollow(),
            (Storage::Gpu(buffer), Device::Cpu) => match self.dtype {
                DType::U32 => Ok(Self::from_vec(buffer.read::<u32>()?, &self.shape)),
                _ => Ok(Self::from_vec(buffer.read::<f32>()?, &self.shape)),
            },
            (Storage::F32(values), Device::Gpu(gpu)) => {
                Ok(Self::from_gpu(gpu.upload(bytemuck::cast_slice(values))?, self.spec()))
            }
            (Storage::U32(values), Device::Gpu(gpu)) => {
                Ok(Self::from_gpu(gpu.upload(bytemuck::cast_slice(values))?.remember(values), self.spec()))
            }
            (Storage::Gpu(_), Device::Gpu(_)) if self.device() != *device => {
                self.to_device(&Device::Cpu)?.to_device(device)
            }
            (Storage::F16(_) | Storage::F64(_), Device::Gpu(_)) => {
                Err(Error::new(ErrorKind::Unsupported, "the GPU backend holds f32 and u32 tensors")
                    .found(format!("{:?}", self.spec()))
                    .fix("cast to f32 first"))
            }
            _ => Ok(self.clone()),
        }
    }

    /// Whether no element is NaN or infinite.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the read-back fails.
    pub fn all_finite(&self) -> Result<bool> {
        Ok(match &*self.storage {
            Storage::F16(values) => values.iter().all(|v| v.is_finite()),
            Storage::F32(values) => values.iter().all(|v| v.is_finite()),
            Storage::F64(values) => values.iter().all(|v| v.is_finite()),
            Storage::U32(_) => true,
            Storage::Gpu(_) => return self.to_device(&Device::Cpu)?.all_finite(),
            Storage::Hollow(_) => self.panic_hollow(),
        })
    }
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

impl fmt::Debug for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} on {}", self.spec(), self.device())
    }
}

/// Puts a vector into the storage of its dtype without copying it.
fn wrap<T: Element>(values: Vec<T>) -> Storage {
    match T::DTYPE {
        DType::F16 => Storage::F16(bytemuck::cast_vec(values)),
        DType::F32 => Storage::F32(bytemuck::cast_vec(values)),
        DType::F64 => Storage::F64(bytemuck::cast_vec(values)),
        DType::U32 => Storage::U32(bytemuck::cast_vec(values)),
    }
}
