//! Where the numbers of tensors are.

use std::ops::Range;
use std::sync::Arc;

use half::f16;

use crate::Element;
use crate::backend::cpu::pool;
use crate::backend::gpu::GpuBuffer;
use crate::io::Bytes;
use crate::tensor::{DType, Device};

/// The numbers of a tensor on the device where they live; cloning shares them.
#[derive(Debug, Clone)]
pub(super) enum Storage {
    Cpu(Arc<Buffer>),
    /// A single number of any type, at the beginning of eight bytes.
    One(u64),
    Gpu(Arc<GpuBuffer>),
    /// No numbers any more: they were on this device, and a tape let go of them in this role.
    Hollow(Device, Role),
}

/// What a tensor was to the op that a tape recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// The operand of this number.
    Operand(usize),
    /// The result.
    Result,
}

/// Numbers in the memory of the CPU.
#[derive(Debug)]
pub(super) enum Buffer {
    F16(Vec<f16>),
    F32(Vec<f32>),
    F64(Vec<f64>),
    U32(Vec<u32>),
    /// Numbers of any type where a file that is mapped into memory has them; read-only.
    Mapped(Arc<Bytes>, Range<usize>),
}

impl Storage {
    /// Takes a vector over without copying it.
    pub(super) fn of<T: Element>(values: Vec<T>) -> Self {
        if let [one] = values[..] {
            return Self::one(one);
        }
        Self::Cpu(Arc::new(match T::DTYPE {
            DType::F16 => Buffer::F16(bytemuck::cast_vec(values)),
            DType::F32 => Buffer::F32(bytemuck::cast_vec(values)),
            DType::F64 => Buffer::F64(bytemuck::cast_vec(values)),
            DType::U32 => Buffer::U32(bytemuck::cast_vec(values)),
        }))
    }

    pub(super) fn one<T: Element>(value: T) -> Self {
        let mut bits = 0u64;
        bytemuck::bytes_of_mut(&mut bits)[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(&value));
        Self::One(bits)
    }
}

impl Buffer {
    /// Whether the numbers belong to a file, where nothing may write.
    pub(super) fn is_mapped(&self) -> bool {
        matches!(self, Self::Mapped(..))
    }

    pub(super) fn slice<T: Element>(&self) -> &[T] {
        match self {
            Self::F16(values) => bytemuck::cast_slice(values),
            Self::F32(values) => bytemuck::cast_slice(values),
            Self::F64(values) => bytemuck::cast_slice(values),
            Self::U32(values) => bytemuck::cast_slice(values),
            Self::Mapped(file, range) => bytemuck::cast_slice(&file[range.clone()]),
        }
    }

    pub(super) fn slice_mut<T: Element>(&mut self) -> &mut [T] {
        match self {
            Self::F16(values) => bytemuck::cast_slice_mut(values),
            Self::F32(values) => bytemuck::cast_slice_mut(values),
            Self::F64(values) => bytemuck::cast_slice_mut(values),
            Self::U32(values) => bytemuck::cast_slice_mut(values),
            Self::Mapped(..) => unreachable!("what is mapped counts as shared, and is copied before it is written"),
        }
    }
}

impl Drop for Buffer {
    /// Vectors go back to the pool that results come from.
    fn drop(&mut self) {
        match self {
            Self::F16(values) => pool::give(std::mem::take(values)),
            Self::F32(values) => pool::give(std::mem::take(values)),
            Self::F64(values) => pool::give(std::mem::take(values)),
            Self::U32(values) => pool::give(std::mem::take(values)),
            Self::Mapped(..) => {}
        }
    }
}
