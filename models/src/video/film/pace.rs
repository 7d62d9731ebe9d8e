//! How fast a film is: the interval of its frames, and for how many intervals each is shown.

/// A frame that lies farther than this share of the interval off an even pace is off it.
const OFF: f64 = 0.25;

/// How often interval and counts follow from each other.
const ROUNDS: usize = 4;

/// When the frames of a film are shown.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clock {
    /// The time of each frame \[s\].
    pub shown: Vec<f64>,
    /// Times are counted in this \[s\].
    pub unit: f64,
}

/// An even pace through uneven times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pace {
    /// Time between frames \[s\].
    pub interval: f64,
    /// For how many intervals each frame is shown; 1 for the first and for the last, which may be held before and after the film.
    pub steps: Vec<usize>,
    /// How far a frame lies off this pace after the one before it, at most, as a share of the interval, if that is more than
    /// counting in units explains.
    pub off: f64,
}

impl Clock {
    /// The pace of the frames; `None` with fewer than two, and where time does not advance.
    ///
    /// Most frames are shown for one interval. Where frames were merged or left out, one is shown for several. How long the last
    /// is held says nothing of the film, and the first was taken one interval before the second, however long it is held.
    pub fn pace(&self) -> Option<Pace> {
        let gaps: Vec<f64> = self.shown.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if gaps.is_empty() || !gaps.iter().all(|gap| *gap > 0.0 && gap.is_finite()) {
            return None;
        }
        let within = if gaps.len() > 1 { &gaps[1..] } else { &gaps[..] };
        let mut sorted = within.to_vec();
        sorted.sort_by(f64::total_cmp);
        // the usual gap, or the smallest if others are not multiples of the usual one
        let usual = self.paced(within, sorted[sorted.len() / 2]);
        let found = if usual.off > OFF {
            let least = self.paced(within, sorted[0]);
            if least.off < usual.off { least } else { usual }
        } else {
            usual
        };
        let mut steps = vec![1; self.shown.len()];
        let skipped = gaps.len() - within.len();
        steps[skipped..skipped + within.len()].copy_from_slice(&found.steps);
        let off = if found.off > OFF { found.off } else { 0.0 };
        Some(Pace { steps, off, ..found })
    }

    /// The pace of gaps most of which are about this long.
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
        // of a long hold the count is known no better than the interval
        let near = gaps.iter().zip(&steps).filter(|(_, steps)| **steps < 4);
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
        Clock { shown: std::iter::once(0.0).chain(sums).collect(), unit: 0.01 }
    }

    #[test]
    fn holds_and_merged_frames_are_counted() {
        // 24 1/s in hundredths, three intervals of rest merged, and a first frame held for two seconds
        let mut gaps = [4, 4, 5].repeat(20);
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
        // drawn on twos, but for one frame
        let pace = clock(&[8, 8, 8, 4, 8]).pace().unwrap();
        assert!((pace.interval - 0.04).abs() < 1e-12 && pace.steps == [1, 2, 2, 1, 2, 1], "{pace:?}");
    }

    #[test]
    fn what_has_no_pace() {
        assert_eq!(clock(&[]).pace(), None);
        assert_eq!(Clock { shown: vec![0.0, 0.1, 0.1], unit: 0.0 }.pace(), None);
        assert_eq!(Clock { shown: vec![0.0, f64::INFINITY], unit: 0.0 }.pace(), None);
        // frames of a phone in the dark
        let uneven = Clock { shown: vec![0.0, 0.033, 0.067, 0.115, 0.148, 0.181, 0.23, 0.263], unit: 0.001 };
        let pace = uneven.pace().unwrap();
        assert!(pace.off > 0.3 && (pace.interval - 0.037).abs() < 0.005, "{pace:?}");
        assert_eq!(clock(&[4]).pace().unwrap().steps, [1, 1]);
    }
}
