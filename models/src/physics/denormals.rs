//! Flushing of denormal numbers to zero while a worker computes.
//!
//! Numbers below 1e-38 (`f32`) cost several times as much as others and carry no information here. Worker closures hold a
//! [`Flush`] while they run; the thread's previous state returns when it is dropped. Elsewhere than on x86-64 it does
//! nothing.

/// While it lives, this thread treats denormal operands and results as zero.
pub(crate) struct Flush {
    #[cfg(target_arch = "x86_64")]
    before: u32,
}

/// Flush to zero (bit 15) and denormals are zero (bit 6) of the control register.
#[cfg(target_arch = "x86_64")]
const FLUSH: u32 = (1 << 15) | (1 << 6);

impl Flush {
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub fn start() -> Self {
        let before = read();
        if before & FLUSH != FLUSH {
            write(before | FLUSH);
        }
        Self { before }
    }

    #[cfg(not(target_arch = "x86_64"))]
    pub fn start() -> Self {
        Self {}
    }
}

#[cfg(target_arch = "x86_64")]
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
fn read() -> u32 {
    let mut state = 0_u32;
    // SAFETY: stores 4 bytes to a local.
    unsafe { core::arch::asm!("stmxcsr [{}]", in(reg) &raw mut state, options(nostack, preserves_flags)) };
    state
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn write(state: u32) {
    // SAFETY: only the two denormal bits differ from what the thread had.
    unsafe { core::arch::asm!("ldmxcsr [{}]", in(reg) &raw const state, options(nostack, preserves_flags)) };
}

#[cfg(all(test, target_arch = "x86_64"))]
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
