//! Running loops with the widest vectors that the processor has.
//!
//! [`vectorised`] runs a [`Job`], a loop over explicit vectors; [`widest`] runs a [`Work`], a plain loop that the compiler
//! turns into vectors. The instruction set is picked in one place for both: where jobs are dispatched.

use crate::scalar::{Job, Lane, Path, Real};

/// Runs a job with the vectors of the run's path.
///
/// # Safety
/// What the job asks for beside the instruction set, which is there.
pub(crate) unsafe fn vectorised<T: Real, J: Job<T>>(job: J) -> J::Output {
    // SAFETY: the path is available; the rest is the caller's promise.
    unsafe { T::dispatch(Path::best(), job) }
}

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
    // SAFETY: plain work asks for nothing.
    unsafe { vectorised::<f32, _>(Plain(work)) }
}

/// Work as a job that makes no use of the vector type.
struct Plain<W>(W);

impl<W: Work> Job<f32> for Plain<W> {
    type Output = W::Output;

    #[inline(always)]
    unsafe fn run<V: Lane<Element = f32>>(self) -> W::Output {
        self.0.run()
    }
}
