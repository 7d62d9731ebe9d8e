//! Which instruction set a block of lanes is run with.

use super::lanes::{self, Lane, Port};
use super::lower::Step;

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

/// A hand-written loop over vectors, compiled once for each instruction set and run by [`Kernel::vectorised`].
pub trait Vectorised<T> {
    /// What it returns.
    type Output;

    /// Runs it. Must be `inline(always)`, and so must every function it calls, or the instruction set is lost there.
    ///
    /// # Safety
    /// The instruction set of `V` must be enabled.
    unsafe fn run<V: Lane<Element = T>>(self) -> Self::Output;
}

/// The half of [`Real`](super::Real) that is nobody else's business: running register code in this type.
pub trait Kernel: Sized {
    /// Runs the steps over `lanes` lanes, rounded up to whole vectors of the path.
    ///
    /// # Safety
    /// The path must be available. Every slot that a step names must have a port; a port that does not repeat must be
    /// valid for `lanes` values rounded up to a multiple of 16, for writing too where a step writes it.
    unsafe fn execute(path: Path, steps: &[Step], ports: &[Port<Self>], lanes: usize);

    /// Runs a loop over vectors with the widest instruction set that the processor has.
    fn vectorised<K: Vectorised<Self>>(kernel: K) -> K::Output;
}

macro_rules! kernel {
    ($float:ident, $portable:ty, $avx2:ty, $avx512:ty) => {
        impl Kernel for $float {
            unsafe fn execute(path: Path, steps: &[Step], ports: &[Port<Self>], lanes: usize) {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                unsafe fn avx2(steps: &[Step], ports: &[Port<$float>], lanes: usize) {
                    // SAFETY: the caller's promise.
                    unsafe { lanes::execute::<$avx2>(steps, ports, lanes) }
                }
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx512f,avx2,fma")]
                unsafe fn avx512(steps: &[Step], ports: &[Port<$float>], lanes: usize) {
                    // SAFETY: the caller's promise.
                    unsafe { lanes::execute::<$avx512>(steps, ports, lanes) }
                }
                // SAFETY: the caller's promise.
                unsafe {
                    match path {
                        Path::Portable => lanes::execute::<$portable>(steps, ports, lanes),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx2 => avx2(steps, ports, lanes),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx512 => avx512(steps, ports, lanes),
                    }
                }
            }

            fn vectorised<K: Vectorised<Self>>(kernel: K) -> K::Output {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                unsafe fn avx2<K: Vectorised<$float>>(kernel: K) -> K::Output {
                    // SAFETY: the instruction set is enabled here.
                    unsafe { kernel.run::<$avx2>() }
                }
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx512f,avx2,fma")]
                unsafe fn avx512<K: Vectorised<$float>>(kernel: K) -> K::Output {
                    // SAFETY: the instruction set is enabled here.
                    unsafe { kernel.run::<$avx512>() }
                }
                // SAFETY: the path is available.
                unsafe {
                    match Path::best() {
                        Path::Portable => kernel.run::<$portable>(),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx2 => avx2(kernel),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx512 => avx512(kernel),
                    }
                }
            }
        }
    };
}

kernel!(f32, super::portable::Portable<f32>, super::x86::F32x8, super::x86::F32x16);
kernel!(f64, super::portable::Portable<f64>, super::x86::F64x4, super::x86::F64x8);
