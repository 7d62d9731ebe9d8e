//! Flushing of denormal numbers to zero.
//!
//! Arithmetic on denormals (below 1e-38 in `f32`) is several times slower, and they carry no information here. Worker
//! closures hold a [`Flush`] while they run; dropping it restores the thread's previous state. It has no effect except
//! on x86-64 and 64-bit ARM.

/// While it exists, this thread treats denormal operands and results as zero.
pub(crate) struct Flush {
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    before: Register,
}

#[cfg(target_arch = "x86_64")]
type Register = u32;
#[cfg(target_arch = "aarch64")]
type Register = u64;

/// Flush-to-zero (bit 15) and denormals-are-zero (bit 6) of the control register.
#[cfg(target_arch = "x86_64")]
const FLUSH: Register = (1 << 15) | (1 << 6);
/// Flush-to-zero (bit 24), for operands and results.
#[cfg(target_arch = "aarch64")]
const FLUSH: Register = 1 << 24;

impl Flush {
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[inline]
    pub fn start() -> Self {
        let before = read();
        if before & FLUSH != FLUSH {
            write(before | FLUSH);
        }
        Self { before }
    }

    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    pub fn start() -> Self {
        Self {}
    }
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl Drop for Flush {
    #[inline]
    fn drop(&mut self) {
        if self.before & FLUSH != FLUSH {
            write(self.before);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn read() -> Register {
    let mut state: Register = 0;
    // SAFETY: stores 4 bytes to a local.
    unsafe { core::arch::asm!("stmxcsr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
    state
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn write(state: Register) {
    // SAFETY: only the two denormal bits change.
    unsafe { core::arch::asm!("ldmxcsr [{}]", in(reg) &raw const state, options(nostack, preserves_flags)) };
}

#[cfg(target_arch = "aarch64")]
#[inline]
fn read() -> Register {
    let state: Register;
    // SAFETY: reads a register that every thread has.
    unsafe { core::arch::asm!("mrs {}, fpcr", out(reg) state, options(nomem, nostack, preserves_flags)) };
    state
}

#[cfg(target_arch = "aarch64")]
#[inline]
fn write(state: Register) {
    // SAFETY: only the denormal bit changes.
    unsafe { core::arch::asm!("msr fpcr, {}", in(reg) state, options(nostack, preserves_flags)) };
}

#[cfg(all(test, any(target_arch = "x86_64", target_arch = "aarch64")))]
mod tests {
    use super::*;

    #[test]
    fn denormals_vanish_inside_and_return_outside() {
        let tiny = std::hint::black_box(1e-40_f32);
        let inside = {
            let _flush = Flush::start();
            std::hint::black_box(tiny) * std::hint::black_box(1.0)
        };
        assert_eq!(inside, 0.0);
        assert!(std::hint::black_box(tiny) * std::hint::black_box(1.0) > 0.0);
    }
}
