//! Rematerialisation: which states of a rollout are kept for its backward pass, and which are recomputed.

/// The states that a rollout keeps. Gradients do not depend on it, bit for bit; time and memory do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remat {
    /// Keep every state: fastest, 96 bytes per particle and substep in `f32`.
    None,
    /// Keep every `k`-th state and recompute the others, one segment at a time.
    Every(usize),
    /// Keep as many states as fit into this many bytes, but segments no longer than the square root of the number of
    /// substeps, beyond which memory would grow again.
    Auto {
        /// Memory for states \[bytes\].
        bytes: usize,
    },
}

impl Default for Remat {
    /// At most 2 GiB of states.
    fn default() -> Self {
        Self::Auto { bytes: 2 << 30 }
    }
}

impl Remat {
    /// Substeps between kept states.
    pub(crate) fn segment(self, steps: usize, state_bytes: usize) -> usize {
        match self {
            Self::None => 1,
            Self::Every(k) => k.max(1),
            Self::Auto { bytes } => {
                let fit = bytes / state_bytes.max(1);
                let least = (steps as f64).sqrt().ceil() as usize;
                let kept = |k: usize| if k == 1 { steps } else { steps.div_ceil(k) + k };
                (1..least).find(|&k| kept(k) <= fit).unwrap_or(least).max(1)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn automatic_segments_fit_the_memory() {
        assert_eq!(Remat::Auto { bytes: 1000 * 10 }.segment(1000, 10), 1);
        assert_eq!(Remat::Auto { bytes: 510 * 10 }.segment(1000, 10), 2);
        let tight = Remat::Auto { bytes: 100 * 10 }.segment(1000, 10);
        assert!(1000_usize.div_ceil(tight) + tight <= 100);
        assert_eq!(Remat::Auto { bytes: 0 }.segment(1000, 10), 32);
        assert_eq!(Remat::default().segment(0, 96), 1);
    }
}
