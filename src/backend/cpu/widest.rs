//! Running a piece of plain Rust with the widest vectors that the processor has.

use crate::scalar::Path;

/// A piece of work that the compiler turns into vectors of the instruction set it is compiled for.
///
/// `run` must be `#[inline(always)]`, with plain loops inside: what is not inlined, closures among it, is compiled for
/// the least processor.
pub(crate) trait Work {
    type Output;
    fn run(self) -> Self::Output;
}

/// Runs the work compiled for the widest available instruction set. Sums keep their order: the results are the same.
pub(crate) fn widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx2,fma")]
        unsafe fn avx512<W: Work>(work: W) -> W::Output {
            work.run()
        }
        #[target_feature(enable = "avx2,fma")]
        unsafe fn avx2<W: Work>(work: W) -> W::Output {
            work.run()
        }
        match Path::best() {
            // SAFETY: the path was found to be available.
            Path::Avx512 => return unsafe { avx512(work) },
            // SAFETY: as above.
            Path::Avx2 => return unsafe { avx2(work) },
            Path::Portable => {}
        }
    }
    work.run()
}
