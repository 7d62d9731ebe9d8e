//! The tensor itself: a shape over shared, immutable storage.

use std::ops::Range;
use std::sync::Arc;

use half::f16;
use ndarray::{ArrayViewD, IxDyn};

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::GpuBuffer;
use crate::io::Bytes;
use crate::tape::deriving;
use crate::tensor::storage::{Buffer, Role, Storage};
use crate::tensor::{DType, Device, Element, Shape, Spec};

/// A contiguous, row-major, immutable array; cloning copies a pointer.
///
/// ```
/// use gradreel::Tensor;
///
/// let x = Tensor::from_vec(vec![1.0f32, 2.0, 3.0, 4.0], [2, 2]);
/// assert_eq!(x.reshape([4]).slice::<f32>(), &[1.0, 2.0, 3.0, 4.0]);
/// assert_eq!(x.view::<f32>()[[1, 0]], 3.0);
/// ```
#[derive(Clone)]
pub struct Tensor(Arc<Inner>);

struct Inner {
    shape: Shape,
    dtype: DType,
    storage: Storage,
}

impl Tensor {
    pub(super) fn new(shape: Shape, dtype: DType, storage: Storage) -> Self {
        Self(Arc::new(Inner { shape, dtype, storage }))
    }

    /// A tensor on the CPU that takes over `values`.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// let x = Tensor::from_vec(vec![1.0f32, 2.0, 3.0, 4.0], [2, 2]);
    /// assert_eq!(x.dims(), [2, 2]);
    /// ```
    ///
    /// # Panics
    /// When the number of values is not that of the shape.
    #[track_caller]
    pub fn from_vec<T: Element>(values: Vec<T>, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(values.len(), shape.len(), "from_vec: {} values do not fill shape {shape}", values.len());
        Self::new(shape, T::DTYPE, Storage::of(values))
    }

    /// A tensor on the CPU filled with one value.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// assert_eq!(Tensor::full(2.5, [2], DType::F64).slice::<f64>(), [2.5, 2.5]);
    /// ```
    pub fn full(value: f64, shape: impl Into<Shape>, dtype: DType) -> Self {
        fn constant<T: Element>(value: f64, shape: Shape) -> Tensor {
            let (value, len) = (T::from_f64(value), shape.len());
            match len {
                1 => Tensor::one(value, shape),
                _ => Tensor::from_vec(filled(len, CHUNK, |_, part: &mut [T]| part.fill(value)), shape),
            }
        }
        let shape = shape.into();
        match dtype {
            DType::F16 => constant::<f16>(value, shape),
            DType::F32 => constant::<f32>(value, shape),
            DType::F64 => constant::<f64>(value, shape),
            DType::U32 => constant::<u32>(value, shape),
        }
    }

    /// A tensor on the CPU of one element, whatever its axes.
    pub(crate) fn one<T: Element>(value: T, shape: Shape) -> Self {
        debug_assert_eq!(shape.len(), 1, "one element");
        Self::new(shape, T::DTYPE, Storage::one(value))
    }

    /// A tensor of zeros on the CPU.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// assert_eq!(Tensor::zeros([2], DType::F32).slice::<f32>(), [0.0, 0.0]);
    /// ```
    pub fn zeros(shape: impl Into<Shape>, dtype: DType) -> Self {
        Self::full(0.0, shape, dtype)
    }

    /// A single number without axes, on the CPU.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// assert_eq!(Tensor::scalar(9.81, DType::F64).item()?, 9.81);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn scalar(value: f64, dtype: DType) -> Self {
        Self::full(value, Shape::scalar(), dtype)
    }

    /// A tensor over a device buffer.
    pub(crate) fn from_gpu(buffer: GpuBuffer, spec: Spec) -> Self {
        Self::new(spec.shape, spec.dtype, Storage::Gpu(Arc::new(buffer)))
    }

    /// A tensor of numbers that lie in a file, in place; `None` where they do not lie there as this machine reads them.
    pub(crate) fn in_file(file: &Arc<Bytes>, place: Range<usize>, spec: Spec) -> Option<Self> {
        let (count, size) = (spec.shape.len(), spec.dtype.size());
        if count < 2 || cfg!(target_endian = "big") {
            return None;
        }
        let bytes = file.get(place.clone()).filter(|bytes| bytes.len() == count * size)?;
        if !bytes.as_ptr().addr().is_multiple_of(size) {
            return None;
        }
        let buffer = Buffer::Mapped(file.clone(), place);
        Some(Self::new(spec.shape, spec.dtype, Storage::Cpu(Arc::new(buffer))))
    }

    /// Shape, dtype and device alone: what a tape keeps of a tensor whose numbers nobody will read. A single number is
    /// kept as it is; it takes no more room.
    pub(crate) fn hollow(&self, role: Role) -> Self {
        match self.storage() {
            Storage::One(_) | Storage::Hollow(..) => self.clone(),
            _ => Self::new(self.shape().clone(), self.dtype(), Storage::Hollow(self.device(), role)),
        }
    }

    pub(super) fn storage(&self) -> &Storage {
        &self.0.storage
    }

    /// Sizes per axis.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.shape().rank(), 2);
    /// ```
    pub fn shape(&self) -> &Shape {
        &self.0.shape
    }

    /// Sizes per axis as a slice.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.dims(), [2, 3]);
    /// ```
    pub fn dims(&self) -> &[usize] {
        self.shape().dims()
    }

    /// Number of elements.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.len(), 6);
    /// ```
    pub fn len(&self) -> usize {
        self.shape().len()
    }

    /// Whether there are no elements.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// assert!(Tensor::zeros([0, 3], DType::F32).is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.shape().is_empty()
    }

    /// Element type.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.dtype(), DType::F32);
    /// ```
    pub fn dtype(&self) -> DType {
        self.0.dtype
    }

    /// Shape and dtype together.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.spec(), gradreel::Spec::new([2, 3], DType::F32));
    /// ```
    pub fn spec(&self) -> Spec {
        Spec::new(self.shape(), self.dtype())
    }

    /// Bytes of the numbers.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.bytes(), 24);
    /// ```
    pub fn bytes(&self) -> usize {
        self.len() * self.dtype().size()
    }

    /// What tells arrays of numbers apart; `None` for a single number and where there are none.
    pub(crate) fn storage_address(&self) -> Option<usize> {
        match self.storage() {
            Storage::Cpu(buffer) => Some(Arc::as_ptr(buffer).addr()),
            Storage::Gpu(buffer) => Some(Arc::as_ptr(buffer).addr()),
            Storage::One(_) | Storage::Hollow(..) => None,
        }
    }

    /// Where the numbers live.
    ///
    /// ```
    /// # use gradreel::{DType, Tensor};
    /// let x = Tensor::zeros([2, 3], DType::F32);
    /// assert_eq!(x.device(), gradreel::Device::Cpu);
    /// ```
    pub fn device(&self) -> Device {
        match self.storage() {
            Storage::Cpu(_) | Storage::One(_) => Device::Cpu,
            Storage::Gpu(buffer) => Device::Gpu(buffer.gpu().clone()),
            Storage::Hollow(device, _) => device.clone(),
        }
    }

    /// The device buffer of a tensor on a GPU.
    ///
    /// # Panics
    /// When the tensor is on the CPU.
    #[track_caller]
    pub(crate) fn gpu_buffer(&self) -> &GpuBuffer {
        match self.storage() {
            Storage::Gpu(buffer) => buffer,
            Storage::Hollow(..) => self.panic_hollow(),
            _ => panic!("the tensor {:?} is on the CPU; move it with to_device first", self.spec()),
        }
    }

    /// Elements of a tensor on a GPU from `start` on, without copying them. `start` is at a multiple of
    /// [`GpuBuffer::ALIGNMENT`] bytes.
    pub(crate) fn gpu_part(&self, start: usize, shape: impl Into<Shape>) -> Self {
        let Storage::Gpu(buffer) = self.storage() else { panic!("gpu_part: {self:?} is not on a GPU") };
        let (shape, size) = (shape.into(), self.dtype().size());
        let bytes = (shape.len() * size).next_multiple_of(4);
        let part = GpuBuffer::part(buffer, start * size, bytes);
        Self::new(shape, self.dtype(), Storage::Gpu(Arc::new(part)))
    }

    /// The numbers of a CPU tensor.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// let x = Tensor::from_vec(vec![1.0, 2.0], [2]);
    /// assert_eq!(x.slice::<f64>(), [1.0, 2.0]);
    /// ```
    ///
    /// # Panics
    /// When `T` is not the tensor's dtype, or the tensor is on a GPU (see [`Tensor::to_vec`]).
    #[track_caller]
    pub fn slice<T: Element>(&self) -> &[T] {
        assert_eq!(T::DTYPE, self.dtype(), "slice: the tensor {:?} was read as {}", self.spec(), T::DTYPE);
        match self.storage() {
            Storage::Cpu(buffer) => buffer.slice(),
            Storage::One(bits) => &bytemuck::cast_slice(std::slice::from_ref(bits))[..1],
            Storage::Gpu(_) => panic!("slice: the tensor {:?} is on a GPU; read it with to_vec", self.spec()),
            Storage::Hollow(..) => self.panic_hollow(),
        }
    }

    /// The numbers of a CPU tensor for writing. Tensors that share them keep what they have: they are copied first then.
    ///
    /// # Panics
    /// As [`Tensor::slice`].
    #[track_caller]
    pub(crate) fn slice_mut<T: Element>(&mut self) -> &mut [T] {
        if !self.is_unshared() {
            let old = self.slice::<T>();
            let copy = filled(old.len(), CHUNK, |start, part: &mut [T]| {
                part.copy_from_slice(&old[start..start + part.len()]);
            });
            *self = Self::new(self.shape().clone(), self.dtype(), Storage::of(copy));
        }
        assert_eq!(T::DTYPE, self.dtype(), "slice_mut: the tensor {:?} was written as {}", self.spec(), T::DTYPE);
        match &mut Arc::get_mut(&mut self.0).expect("nobody shares it").storage {
            Storage::Cpu(buffer) => Arc::get_mut(buffer).expect("nobody shares it").slice_mut(),
            Storage::One(bits) => &mut bytemuck::cast_slice_mut(std::slice::from_mut(bits))[..1],
            Storage::Gpu(_) | Storage::Hollow(..) => panic!("slice_mut: the tensor is not on the CPU"),
        }
    }

    /// Whether it is on the CPU and no other tensor shares its numbers.
    pub(crate) fn is_unshared(&mut self) -> bool {
        match Arc::get_mut(&mut self.0).map(|inner| &mut inner.storage) {
            Some(Storage::Cpu(buffer)) => Arc::get_mut(buffer).is_some_and(|buffer| !buffer.is_mapped()),
            Some(Storage::One(_)) => true,
            _ => false,
        }
    }

    /// The numbers of a CPU tensor as an ndarray view.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// let x = Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]);
    /// assert_eq!(x.view::<f64>()[[1, 0]], 3.0);
    /// ```
    ///
    /// # Panics
    /// As [`Tensor::slice`].
    #[track_caller]
    pub fn view<T: Element>(&self) -> ArrayViewD<'_, T> {
        ArrayViewD::from_shape(IxDyn(self.dims()), self.slice()).expect("tensors are contiguous")
    }

    /// The same numbers under another shape; shares storage.
    ///
    /// ```
    /// # use gradreel::Tensor;
    /// let x = Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [4]);
    /// assert_eq!(x.reshape([2, 2]).dims(), [2, 2]);
    /// ```
    ///
    /// # Panics
    /// When the number of elements differs.
    #[track_caller]
    pub fn reshape(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(self.len(), shape.len(), "reshape: {} does not fit {shape}", self.shape());
        Self::new(shape, self.dtype(), self.storage().clone())
    }

    #[track_caller]
    pub(super) fn panic_hollow(&self) -> ! {
        let op = deriving().unwrap_or_else(|| "an op".to_owned());
        let (what, fix) = match self.storage() {
            Storage::Hollow(_, Role::Operand(number)) => (format!("operand {number}"), format!(".input({number})")),
            _ => ("the result".to_owned(), ".output()".to_owned()),
        };
        panic!(
            "{op}: the derivative reads {what}, {:?}, whose numbers were freed, because `reads` leaves out that it does\n  \
             fix: add {fix} to what Op::reads of {op} returns",
            self.spec()
        )
    }
}
