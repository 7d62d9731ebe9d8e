//! How far a stage is, and how long all of them will take.

use std::time::Instant;

use super::{Stage, State};
use crate::runtime::progress::{Progress, Stage as Bar};

/// The progress of a stage.
pub(super) struct Clock {
    bar: Bar,
    stage: Stage,
    stages: &'static [Stage],
    before: Vec<(Stage, f64)>,
    total: u64,
    /// When this process began with the stage, and how far it was.
    begun: Instant,
    from: u64,
}

impl Clock {
    /// Begins a stage of `total` steps of which `from` are done.
    pub fn begin(
        progress: &Progress,
        stages: &'static [Stage],
        state: &State,
        stage: Stage,
        total: u64,
        from: u64,
    ) -> Self {
        let bar = progress.stage(&stage.title(stages), total);
        let before = state.finished.iter().map(|done| (done.stage, done.seconds)).collect();
        Self { bar, stage, stages, before, total, begun: Instant::now(), from }
    }

    /// Reports the steps that are done.
    pub fn set(&self, done: u64, message: &str) {
        let share = |steps: u64| steps.min(self.total) as f64 / self.total.max(1) as f64;
        let spent = self.begun.elapsed().as_secs_f64();
        let left = left(self.stages, &self.before, self.stage, spent, [share(self.from), share(done)]);
        let all = left.map_or(String::new(), |seconds| format!("all stages: {} left", readable(seconds)));
        let between = if all.is_empty() || message.is_empty() { "" } else { "; " };
        self.bar.set(done, &format!("{message}{between}{all}"));
    }

    /// Ends the stage; returns the seconds that this process spent with it.
    pub fn finish(self, message: &str) -> f64 {
        let seconds = self.begun.elapsed().as_secs_f64();
        self.bar.finish(message);
        seconds
    }
}

/// Seconds that all stages still take, from how long others and a part of this one took; `None` as long as nothing is known.
pub(super) fn left(
    stages: &[Stage],
    before: &[(Stage, f64)],
    now: Stage,
    spent: f64,
    [from, to]: [f64; 2],
) -> Option<f64> {
    // what is over in a moment tells nothing of how fast the machine is
    let told = before.iter().filter(|(stage, _)| stage.share() >= 1.0);
    let (shares, seconds) =
        told.fold((0.0, 0.0), |(shares, sum), (stage, seconds)| (shares + stage.share(), sum + seconds));
    let (own, gone) = (now.share() * (to - from).max(0.0), shares);
    let known = gone + own;
    // most of what is left of this stage is told by itself
    let rest: f64 = stages.iter().filter(|stage| **stage > now).map(|stage| stage.share()).sum();
    if known <= 0.0 || own <= 0.0 {
        return None;
    }
    let here = spent * (1.0 - to) / (to - from);
    Some(here + rest * (seconds + spent) / known)
}

/// `40 s`, `12 min`, `3.5 h`.
pub(super) fn readable(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("about {s:.0} s"),
        s if s < 5400.0 => format!("about {:.0} min", s / 60.0),
        s => format!("about {:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_tells_its_own_rest_and_with_the_others_what_follows() {
        let all = &Stage::ALL;
        // half of the views took 100 s: they take as long again, and what follows in proportion to its usual share
        let found = left(all, &[], Stage::Views, 100.0, [0.0, 0.5]).unwrap();
        let later: f64 = all.iter().filter(|stage| **stage > Stage::Views).map(|stage| stage.share()).sum();
        assert!((found - (100.0 + later * 100.0 / (0.5 * Stage::Views.share()))).abs() < 1e-9);
        // gone on with: what was done before says nothing of the speed
        let found = left(all, &[], Stage::Views, 100.0, [0.5, 0.75]).unwrap();
        assert!((found - (100.0 + later * 100.0 / (0.25 * Stage::Views.share()))).abs() < 1e-9);
        assert_eq!(left(all, &[], Stage::Views, 1.0, [0.0, 0.0]), None);
        let last = left(all, &[(Stage::Views, 500.0)], Stage::Material, 60.0, [0.0, 0.25]).unwrap();
        assert!((last - 180.0).abs() < 1e-9, "nothing follows: {last}");
    }

    #[test]
    fn lengths_of_time() {
        assert_eq!([40.0, 720.0, 12_600.0].map(readable), ["about 40 s", "about 12 min", "about 3.5 h"]);
    }
}
