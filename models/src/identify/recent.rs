//! Motions that were simulated a moment ago: derivatives begin where a trial has been.

use std::collections::VecDeque;

use gradreel::Tensor;

use crate::identify::Unknowns;
use crate::physics::Schedule;

/// The last motions of one problem, `[frames, particles, 3]` \[m\].
#[derive(Default)]
pub(super) struct Recent {
    motions: VecDeque<(Unknowns, Schedule, Tensor)>,
}

/// Of a step that gained nothing, the trials lie between two looks at where it began.
const KEPT: usize = 8;

impl Recent {
    /// The motion of these unknowns with this schedule, if it is one of them.
    pub fn find(&self, unknowns: &Unknowns, schedule: Schedule) -> Option<Tensor> {
        let same = |(u, s, _): &&(Unknowns, Schedule, Tensor)| *s == schedule && u == unknowns;
        self.motions.iter().find(same).map(|(.., motion)| motion.clone())
    }

    pub fn keep(&mut self, unknowns: &Unknowns, schedule: Schedule, motion: &Tensor) {
        if self.motions.len() == KEPT {
            self.motions.pop_front();
        }
        self.motions.push_back((unknowns.clone(), schedule, motion.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_few_are_found_by_unknowns_and_schedule() {
        let schedule = Schedule { frames: 2, frame_dt: 0.1, substeps: 3 };
        let at = |x: f64| Unknowns { parameters: vec![x], ..Unknowns::default() };
        let mut recent = Recent::default();
        for k in 0..=KEPT {
            recent.keep(&at(k as f64), schedule, &Tensor::scalar(k as f64, gradreel::DType::F64));
        }
        assert!(recent.find(&at(0.0), schedule).is_none(), "the oldest is gone");
        assert!(recent.find(&at(2.0), Schedule { substeps: 4, ..schedule }).is_none());
        assert_eq!(recent.find(&at(2.0), schedule).unwrap().to_vec().unwrap(), [2.0]);
    }
}
