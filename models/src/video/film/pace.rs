//! Pace of a film: its frame interval, and for how many intervals each frame is shown.

/// Maximum deviation of a frame from an even pace, as a share of the interval.
const OFF: f64 = 0.25;

/// Number of alternations between estimating the interval and the counts.
const ROUNDS: usize = 4;

/// Display times of a film's frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clock {
    /// Start time of each frame \[s\].
    pub shown: Vec<f64>,
    /// End time of the last frame, if known \[s\].
    pub until: Option<f64>,
    /// Resolution of the times \[s\].
    pub unit: f64,
}

/// An even pace fitted to uneven times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pace {
    /// Time between frames \[s\].
    pub interval: f64,
    /// Number of intervals for which each frame is shown; 1 for the first and the last, which may be held before
    /// and after the action.
    pub steps: Vec<usize>,
    /// Maximum deviation of a frame from this pace relative to the previous frame, as a share of the interval,
    /// beyond the resolution of the times.
    pub off: f64,
}

impl Clock {
    /// The pace of the frames; `None` with fewer than two frames or if time does not advance.
    ///
    /// Most frames are shown for one interval; where frames were merged or dropped, one is shown for several. The
    /// hold times of the first and the last frame are ignored: the first frame counts as one interval before the
    /// second.
    pub fn pace(&self) -> Option<Pace> {
        let count = self.shown.len();
        let times: Vec<f64> = self.shown.iter().copied().chain(self.until).collect();
        let gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if count < 2 || !gaps.iter().all(|gap| *gap > 0.0 && gap.is_finite()) {
            return None;
        }
        let mut sorted = gaps.clone();
        sorted.sort_by(f64::total_cmp);
        // the usual gap, or the smallest one if the others are not multiples of the usual one
        let mut found = self.paced(&gaps, sorted[(sorted.len() - 1) / 2]);
        if found.off > OFF {
            let least = self.paced(&gaps, sorted[0]);
            found = if least.off < found.off { least } else { found };
        }
        found.steps.resize(count, 1);
        (found.steps[0], found.steps[count - 1]) = (1, 1);
        Some(Pace { off: if found.off > OFF { found.off } else { 0.0 }, ..found })
    }

    /// The pace of gaps, given an estimate of the interval.
    fn paced(&self, gaps: &[f64], about: f64) -> Pace {
        let mut interval = about;
        let mut steps = Vec::new();
        for _ in 0..ROUNDS {
            steps = gaps.iter().map(|gap| ((gap / interval).round() as usize).max(1)).collect();
            let single = || gaps.iter().zip(&steps).filter(|(_, steps)| **steps == 1).map(|(gap, _)| *gap);
            let count = single().count();
            if count > 0 {
                interval = single().sum::<f64>() / count as f64;
            }
        }
        let off = |(gap, steps): (&f64, &usize)| (gap - *steps as f64 * interval).abs() - self.unit;
        // the count of a long hold is uncertain, and the first and the last frame may be held arbitrarily long
        let inner = gaps.iter().zip(&steps).take(self.shown.len() - 1).skip(1);
        let near = inner.filter(|(_, steps)| **steps < 4);
        let off = near.map(off).fold(0.0, f64::max) / interval;
        Pace { interval, steps, off }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(gaps: &[u32]) -> Clock {
        let sums = gaps.iter().scan(0, |sum, gap| {
            *sum += gap;
            Some(0.01 * f64::from(*sum))
        });
        Clock { shown: std::iter::once(0.0).chain(sums).collect(), until: None, unit: 0.01 }
    }

    #[test]
    fn holds_and_merged_frames_are_counted() {
        // 24 1/s in hundredths, three intervals of rest merged, and the first frame held for two seconds
        let mut gaps = [4, 4, 4, 4, 4, 5].repeat(10);
        gaps[0] = 200;
        gaps[30] = 13;
        let pace = clock(&gaps).pace().unwrap();
        assert!((1.0 / pace.interval - 24.0).abs() < 0.3, "{}", pace.interval);
        assert_eq!((pace.steps[0], pace.steps[30], pace.off), (1, 3, 0.0));
        assert_eq!(pace.steps.iter().sum::<usize>(), 61 + 2);
        // a minute of rest: 1500 intervals of 0.04 s
        let mut gaps = vec![4; 20];
        gaps[10] = 6000;
        assert_eq!(clock(&gaps).pace().unwrap().steps[10], 1500);
        // animated on twos, except for one frame
        let pace = clock(&[8, 8, 8, 4, 8]).pace().unwrap();
        assert!((pace.interval - 0.04).abs() < 1e-12 && pace.steps == [1, 2, 2, 1, 2, 1], "{pace:?}");
    }

    #[test]
    fn what_has_no_pace() {
        assert_eq!(clock(&[]).pace(), None);
        assert_eq!(Clock { shown: vec![0.0, 0.1, 0.1], until: None, unit: 0.0 }.pace(), None);
        assert_eq!(Clock { shown: vec![0.0, f64::INFINITY], until: None, unit: 0.0 }.pace(), None);
        // frames of a phone in low light
        let uneven =
            Clock { shown: vec![0.0, 0.033, 0.067, 0.115, 0.148, 0.181, 0.23, 0.263], until: None, unit: 0.001 };
        let pace = uneven.pace().unwrap();
        assert!(pace.off > 0.25 && (pace.interval - 0.037).abs() < 0.005, "{pace:?}");
        assert_eq!(clock(&[4]).pace().unwrap().steps, [1, 1]);
        // the last delay counts unless it is a hold
        let even = Clock { until: Some(0.25), ..clock(&[4, 4, 4, 4, 4]) };
        assert!((even.pace().unwrap().interval - 0.25 / 6.0).abs() < 1e-12);
        let held = Clock { until: Some(3.0), ..even };
        assert!((held.pace().unwrap().interval - 0.04).abs() < 1e-12);
    }
}
