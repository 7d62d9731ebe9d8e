//! Which instruction set a block of lanes is run with.

use super::lanes::{self, Port};
use super::lower::Code;

/// The ways to run register code on this kind of processor, widest last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// Plain Rust over small arrays; the compiler's baseline instruction set.
    Portable,
    /// 256-bit vectors with fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Path {
    /// Every path that this processor can run.
    pub fn available() -> impl DoubleEndedIterator<Item = Self> {
        [
            Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            is_x86_feature_detected!("avx512f").then_some(Self::Avx512),
        ]
        .into_iter()
        .flatten()
    }

    /// The widest available path.
    pub fn best() -> Self {
        Self::available().next_back().unwrap_or(Self::Portable)
    }
}

/// The half of [`Real`](super::Real) that is nobody else's business: running register code in this type.
pub trait Kernel: Sized {
    /// Runs the steps over `lanes` lanes, rounded up to whole vectors of the path.
    ///
    /// # Safety
    /// The path must be available. Every slot that a step names must have a port; a port that does not repeat must be
    /// valid for `lanes` values rounded up to a multiple of 16, for writing too where a step writes it.
    unsafe fn execute(path: Path, code: &Code, ports: &mut [Port<Self>], lanes: usize);
}

macro_rules! kernel {
    ($float:ident, $portable:ty, $avx2:ty, $avx512:ty) => {
        impl Kernel for $float {
            unsafe fn execute(path: Path, code: &Code, ports: &mut [Port<Self>], lanes: usize) {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                unsafe fn avx2(code: &Code, ports: &mut [Port<$float>], lanes: usize) {
                    // SAFETY: the caller's promise.
                    unsafe { lanes::execute::<$avx2>(code, ports, lanes) }
                }
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx512f,avx2,fma")]
                unsafe fn avx512(code: &Code, ports: &mut [Port<$float>], lanes: usize) {
                    // SAFETY: the caller's promise.
                    unsafe { lanes::execute::<$avx512>(code, ports, lanes) }
                }
                // SAFETY: the caller's promise.
                unsafe {
                    match path {
                        Path::Portable => lanes::execute::<$portable>(code, ports, lanes),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx2 => avx2(code, ports, lanes),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx512 => avx512(code, ports, lanes),
                    }
                }
            }
        }
    };
}

kernel!(f32, super::portable::Portable<f32>, super::x86::F32x8, super::x86::F32x16);
kernel!(f64, super::portable::Portable<f64>, super::x86::F64x4, super::x86::F64x8);
