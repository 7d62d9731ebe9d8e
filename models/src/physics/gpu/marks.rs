//! Marks that substeps leave on the device: the box of cells that the next one needs, and failures. Mirrors
//! `models/kernels/shared/node_grid.wgsl`.

const HEADER: usize = 8;
const PER_STEP: usize = 8;
const BROKEN: usize = 6;
const CULPRIT: usize = 7;
const NONE: u32 = u32::MAX;

/// The marks of a rollout, read back.
#[derive(Debug)]
pub(super) struct Marks(pub Vec<u32>);

/// The outcome of a rollout.
#[derive(Debug, PartialEq)]
pub(super) enum Outcome {
    /// Success.
    Finished,
    /// The grid had no room for this many nodes in a substep.
    TooLarge { step: usize, nodes: f64 },
    /// A particle broke a limit in a substep; `culprit` is the first particle with a non-finite stress in it.
    Broken { step: usize, particle: usize, culprit: Option<usize> },
}

impl Marks {
    /// The marks of a rollout that has not begun.
    pub fn blank(steps: usize) -> Self {
        let mut marks = vec![NONE; HEADER + PER_STEP * (steps + 1)];
        for step in 0..=steps {
            marks[HEADER + PER_STEP * step + 3..][..3].fill(0);
        }
        Self(marks)
    }

    /// Decodes the outcome.
    pub fn outcome(&self) -> Outcome {
        if self.0[0] == NONE {
            return Outcome::Finished;
        }
        let step = self.0[0] as usize;
        let own = &self.0[HEADER + PER_STEP * step..][..PER_STEP];
        let particle = |k: usize| (own[k] != NONE).then_some(own[k] as usize);
        match particle(BROKEN) {
            Some(broken) => Outcome::Broken { step, particle: broken, culprit: particle(CULPRIT) },
            None => {
                let nodes = (0..3).map(|axis| f64::from(own[3 + axis]) - f64::from(own[axis]) + 3.0).product();
                Outcome::TooLarge { step, nodes }
            }
        }
    }
}
