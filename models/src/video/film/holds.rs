//! Resampling to an even pace where some frames are shown for several intervals.

use super::lost;
use super::pace::Pace;
use crate::video::clip::Frame;

/// A frame held for more than both limits (intervals, seconds) ends the film.
const LONGEST: (usize, f64) = (24, 2.0);

/// Minimum intersection over union of the silhouettes of an object at rest.
const RESTS: f64 = 0.9;

/// Maximum number of pixels of all frames, inserted ones included.
const MOST: usize = 1 << 26;

/// Frames at an even pace, from frames some of which are shown for several intervals.
pub(super) struct Even {
    /// Index of the frame shown in each interval; `None` between two frames that show an object in motion.
    shown: Vec<Option<usize>>,
    /// Messages.
    pub said: Vec<String>,
}

impl Even {
    /// Assigns frames to intervals; `numbers` are those of the frames in the film.
    pub fn of(frames: &[Frame], pace: &Pace, numbers: &[usize]) -> Self {
        let pixels = frames[0].alpha.len();
        let longest = LONGEST.0.max((LONGEST.1 / pace.interval) as usize);
        let (mut shown, mut said) = (Vec::new(), Vec::new());
        let (mut repeated, mut between) = (0usize, 0usize);
        for (k, steps) in pace.steps.iter().enumerate().take(frames.len()) {
            shown.push(Some(k));
            let more = steps - 1;
            if k + 1 == frames.len() || more == 0 {
                continue;
            }
            if *steps > longest || (shown.len() + more).saturating_mul(pixels) > MOST {
                said.push(format!(
                    "time: the film ends with frame {}, which is held for {:.2} s",
                    numbers[k],
                    *steps as f64 * pace.interval
                ));
                break;
            }
            let rests = alike(&frames[k], &frames[k + 1]);
            shown.extend(std::iter::repeat_n(rests.then_some(k), more));
            *(if rests { &mut repeated } else { &mut between }) += more;
        }
        if repeated > 0 {
            said.push(format!("time: frames that are held while the object rests are repeated, {repeated} in all"));
        }
        if between > 0 {
            said.push(format!("time: {between} intervals have no frame of their own; nothing counts in them"));
        }
        Self { shown, said }
    }

    /// The frames at an even pace.
    pub fn frames(&self, frames: &[Frame]) -> Vec<Frame> {
        let (height, width) = frames[0].alpha.dim();
        let one = |shown: &Option<usize>| shown.map_or_else(|| lost::nothing(width, height), |k| frames[k].clone());
        self.shown.iter().map(one).collect()
    }

    /// Whether the result differs from the given number of frames.
    pub fn is_change(&self, count: usize) -> bool {
        self.shown.len() != count || self.shown.contains(&None)
    }
}

/// Whether two frames show the object in the same place.
fn alike(a: &Frame, b: &Frame) -> bool {
    let (mut both, mut any) = (0usize, 0usize);
    for (a, b) in a.alpha.iter().zip(&b.alpha) {
        let (a, b) = (*a > 0.5, *b > 0.5);
        both += usize::from(a && b);
        any += usize::from(a || b);
    }
    any > 0 && both as f64 >= RESTS * any as f64
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;

    /// A square of 20 pixels whose left edge is at `column`.
    fn frame(column: usize) -> Frame {
        let alpha = Array2::from_shape_fn((30, 60), |(y, x)| {
            f32::from(u8::from((5..25).contains(&y) && (column..column + 20).contains(&x)))
        });
        Frame { rgb: Array3::ones((30, 60, 3)), weight: Array2::ones((30, 60)), alpha }
    }

    #[test]
    fn what_rests_is_repeated_and_what_moves_is_not_known() {
        let frames = [0, 8, 16, 16, 24].map(frame);
        let pace = Pace { interval: 0.04, steps: vec![1, 2, 3, 1, 1], off: 0.0 };
        let even = Even::of(&frames, &pace, &[0, 1, 2, 3, 4]);
        assert_eq!(even.shown, [Some(0), Some(1), None, Some(2), Some(2), Some(2), Some(3), Some(4)]);
        let made = even.frames(&frames);
        assert!(made.len() == 8 && even.is_change(5));
        assert!(made[2].weight.iter().all(|weight| *weight == 0.0) && made[4] == frames[2]);
        assert_eq!(even.said.len(), 2);
        // held for five seconds
        let pace = Pace { interval: 0.04, steps: vec![1, 1, 125, 1, 1], off: 0.0 };
        let even = Even::of(&frames, &pace, &[7, 8, 9, 10, 11]);
        assert_eq!(even.shown, [Some(0), Some(1), Some(2)]);
        assert!(even.said[0].contains("frame 9") && even.said[0].contains("5.00 s"), "{:?}", even.said);
        assert!(
            !Even::of(&frames, &Pace { interval: 0.04, steps: vec![1; 5], off: 0.0 }, &[0, 1, 2, 3, 4]).is_change(5)
        );
    }
}
