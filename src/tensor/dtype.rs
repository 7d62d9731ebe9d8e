//! Element types and their names.

use std::fmt;

use half::f16;

/// The type of a tensor's elements.
///
/// ```
/// # use gradreel::DType;
/// assert_eq!(DType::F64.size(), 8);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DType {
    /// 16-bit floats: storage of weights; cast before computing.
    F16,
    /// 32-bit floats: the default, on every device.
    F32,
    /// 64-bit floats: gradient checks and reference runs, on the CPU.
    F64,
    /// Unsigned 32-bit integers: indices.
    U32,
}

impl DType {
    /// Bytes per element.
    ///
    /// ```
    /// # use gradreel::DType;
    /// assert_eq!(DType::F16.size(), 2);
    /// ```
    pub fn size(self) -> usize {
        match self {
            Self::F16 => 2,
            Self::F32 | Self::U32 => 4,
            Self::F64 => 8,
        }
    }

    /// The type of gradients with respect to tensors of this type: `f32` for `f16`, whose range is too small for them.
    ///
    /// ```
    /// # use gradreel::DType;
    /// assert_eq!(DType::F16.of_cotangent(), DType::F32);
    /// ```
    pub fn of_cotangent(self) -> Self {
        match self {
            Self::F16 => Self::F32,
            other => other,
        }
    }

    /// Whether ops compute in this type (`f32` and `f64`; `f16` is for storage only).
    ///
    /// ```
    /// # use gradreel::DType;
    /// assert!(DType::F32.is_real() && !DType::U32.is_real());
    /// ```
    pub fn is_real(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

impl fmt::Display for DType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F16 => "f16",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::U32 => "u32",
        })
    }
}

/// A Rust type that tensors can hold.
///
/// ```
/// use gradreel::{DType, Element};
/// fn name<T: Element>() -> DType { T::DTYPE }
/// assert_eq!(name::<f32>(), DType::F32);
/// ```
pub trait Element: bytemuck::Pod + Send + Sync + fmt::Debug + PartialOrd {
    /// Its name at run time.
    const DTYPE: DType;

    /// The nearest value of this type.
    fn from_f64(value: f64) -> Self;

    /// The same number as `f64`.
    fn to_f64(self) -> f64;
}

macro_rules! element {
    ($type:ty, $dtype:ident, $from:expr, $to:expr) => {
        impl Element for $type {
            const DTYPE: DType = DType::$dtype;

            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                ($from)(value)
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                ($to)(self)
            }
        }
    };
}

element!(f16, F16, f16::from_f64, f16::to_f64);
element!(f32, F32, |v| v as f32, f64::from);
element!(f64, F64, |v| v, |v| v);
element!(u32, U32, |v| v as u32, f64::from);

/// Runs a block with a type name bound to the Rust type of a real dtype (`f32` or `f64`).
///
/// # Panics
/// At the block, for a dtype that ops do not compute in; [`crate::tape::Op::infer`] refuses those first.
macro_rules! for_real {
    ($dtype:expr, $type:ident => $body:expr) => {
        match $dtype {
            $crate::DType::F32 => {
                type $type = f32;
                $body
            }
            $crate::DType::F64 => {
                type $type = f64;
                $body
            }
            other => panic!("ops compute in f32 or f64, not {other}"),
        }
    };
}
pub(crate) use for_real;
