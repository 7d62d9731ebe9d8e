//! Plain loops compiled for the widest instruction set that the processor has.

use crate::scalar::Path;

/// A piece of work as plain loops. Implement [`Job::run`] with `#[inline(always)]`, call only functions that have it too,
/// and use neither closures nor iterator adaptors in it: only what is inlined is compiled for the wide registers.
pub(crate) trait Job {
    /// Does the work.
    fn run(self);
}

/// Runs a job with the widest instruction set.
pub(crate) fn widest(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
        unsafe fn avx512(job: impl Job) {
            job.run();
        }
        #[target_feature(enable = "avx2,fma")]
        unsafe fn avx2(job: impl Job) {
            job.run();
        }
        let modern = is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw");
        // SAFETY: the instruction sets were detected.
        unsafe {
            match Path::best() {
                Path::Avx512 if modern => return avx512(job),
                Path::Avx512 | Path::Avx2 => return avx2(job),
                Path::Portable => {}
            }
        }
    }
    job.run();
}
