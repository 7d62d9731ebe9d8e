//! Which instruction set a block of lanes is run with.

use super::execute::Execute;
use super::lanes::{Lane, Port};
use super::lower::Code;
use super::path::Path;

/// A loop that is compiled once for each instruction set.
///
/// Mark `run` and everything it calls `inline(always)` and write plain loops: a closure, an iterator adaptor or a
/// function that is not inlined would be compiled for the baseline instruction set instead.
pub trait Job<T> {
    /// What the loop hands back.
    type Output;

    /// The loop, over vectors of type `V`.
    ///
    /// # Safety
    /// The instruction set of `V` must be enabled: call it through [`Kernel::dispatch`] only.
    unsafe fn run<V: Lane<Element = T>>(self) -> Self::Output;
}

/// The half of [`Real`](super::Real) that is nobody else's business: the vectors of this type, and running code on them.
pub trait Kernel: Sized {
    /// Runs the steps over `lanes` lanes, rounded up to whole vectors of the path.
    ///
    /// # Safety
    /// The path must be available. Every slot that a step names must have a port; a port that does not repeat must be
    /// valid for `lanes` values rounded up to a multiple of 16, for writing too where a step writes it.
    unsafe fn execute(path: Path, code: &Code, ports: &mut [Port<Self>], lanes: usize);

    /// Runs a job with the vectors of a path.
    ///
    /// # Safety
    /// The path must be available, and what the job itself asks for.
    unsafe fn dispatch<J: Job<Self>>(path: Path, job: J) -> J::Output;
}

macro_rules! kernel {
    ($float:ident, $portable:ty, $avx2:ty, $avx512:ty, $neon:ty) => {
        impl Kernel for $float {
            unsafe fn execute(path: Path, code: &Code, ports: &mut [Port<Self>], lanes: usize) {
                // SAFETY: the caller's promise.
                unsafe { Self::dispatch(path, Execute { code, ports, lanes }) }
            }

            #[inline]
            unsafe fn dispatch<J: Job<Self>>(path: Path, job: J) -> J::Output {
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx2,fma")]
                unsafe fn avx2<J: Job<$float>>(job: J) -> J::Output {
                    // SAFETY: the caller's promise.
                    unsafe { job.run::<$avx2>() }
                }
                #[cfg(target_arch = "x86_64")]
                #[target_feature(enable = "avx512f,avx2,fma")]
                unsafe fn avx512<J: Job<$float>>(job: J) -> J::Output {
                    // SAFETY: the caller's promise.
                    unsafe { job.run::<$avx512>() }
                }
                #[cfg(target_arch = "aarch64")]
                #[target_feature(enable = "neon")]
                unsafe fn neon<J: Job<$float>>(job: J) -> J::Output {
                    // SAFETY: the caller's promise.
                    unsafe { job.run::<$neon>() }
                }
                // SAFETY: the caller's promise.
                unsafe {
                    match path {
                        Path::Portable => job.run::<$portable>(),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx2 => avx2(job),
                        #[cfg(target_arch = "x86_64")]
                        Path::Avx512 => avx512(job),
                        #[cfg(target_arch = "aarch64")]
                        Path::Neon => neon(job),
                    }
                }
            }
        }
    };
}

kernel!(f32, super::portable::Portable<f32>, super::x86::F32x8, super::x86::F32x16, super::neon::F32x4);
kernel!(f64, super::portable::Portable<f64>, super::x86::F64x4, super::x86::F64x8, super::neon::F64x2);
