//! Which instruction set a block of lanes is run with.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

use super::execute::Execute;
use super::lanes::{Lane, Port};
use super::lower::Code;

/// The instruction sets that CPU kernels are compiled for on this kind of processor, widest last. Which one runs is
/// decided when the program runs; nothing has to be set at compile time.
///
/// ```
/// use gradreel::scalar::Path;
///
/// assert_eq!(Path::available().next(), Some(Path::Portable));
/// println!("kernels run on {:?}", Path::best());
/// ```
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
    /// 128-bit vectors with fused multiply-add.
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// One more than the number of the path that all kernels are held to; 0 where they are free.
static HELD: AtomicU8 = AtomicU8::new(0);

impl Path {
    /// Every path that this processor can run.
    pub fn available() -> impl DoubleEndedIterator<Item = Self> {
        [
            Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            is_x86_feature_detected!("avx512f").then_some(Self::Avx512),
            #[cfg(target_arch = "aarch64")]
            std::arch::is_aarch64_feature_detected!("neon").then_some(Self::Neon),
        ]
        .into_iter()
        .flatten()
    }

    /// The path that kernels run on: the widest available one, unless they are held to another.
    #[inline]
    pub fn best() -> Self {
        static BEST: OnceLock<Path> = OnceLock::new();
        let held = HELD.load(Ordering::Relaxed);
        if held == 0 {
            return *BEST.get_or_init(|| Self::available().next_back().unwrap_or(Self::Portable));
        }
        Self::available().find(|path| *path as u8 + 1 == held).unwrap_or(Self::Portable)
    }

    /// Holds all kernels of the process to one path, or lets them go: to compare paths with each other, or with another
    /// machine.
    ///
    /// # Safety
    /// No kernel may be running on any thread: some ask for the path more than once, and lay out memory by the first answer.
    ///
    /// # Panics
    /// When the processor cannot run it.
    pub unsafe fn hold(path: Option<Self>) {
        if let Some(path) = path {
            assert!(Self::available().any(|available| available == path), "this processor cannot run {path:?}");
        }
        HELD.store(path.map_or(0, |path| path as u8 + 1), Ordering::Relaxed);
    }
}

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
