//! When and how the pictures of a film are taken.

use gradreel::Key;

use super::Degradation;
use crate::scenes::SceneFile;
use crate::views::objects::Dice;

/// Exposure of a film in good light, and of one in bad light, in intervals between pictures.
const EXPOSURES: [f64; 2] = [0.1, 0.8];
/// Time between the first and the last row, in intervals.
const READOUT: f64 = 0.7;
/// Rate of slow motion, in the rate that the file says.
const SLOWER: f64 = 4.0;
/// Angle by which a camera shakes, in heights of the picture.
const SHAKE: f64 = 0.01;
/// Bits a second of a compressed film of so many pixels.
const COMPRESSED: (f64, f64) = (2e6, 1920.0 * 1080.0);
/// Bits grow with so much of the logarithm of the number of pixels: neighbours in a larger picture are more alike.
const BITS: f64 = 0.75;

/// The plan of a film. Times count from when the object is let go \[s\].
pub(super) struct Plan {
    /// Time of each picture, of the middle of the exposure of its first row.
    pub times: Vec<f64>,
    /// For how long each row is exposed \[s\].
    pub exposure: f64,
    /// Time between the first row and the last \[s\].
    pub readout: f64,
    /// Whether a hand holds the object.
    pub has_hand: bool,
    /// Deviation of the camera's direction, in heights of the picture.
    pub shake: f64,
    /// Whether shadows wander.
    pub has_shadows: bool,
    /// Bits a second, if they are few.
    pub bit_rate: Option<f64>,
    /// Seconds of the file to one of the scene.
    pub slower: f64,
    /// Whether the file turns the pictures.
    pub is_turned: bool,
    /// Pictures a second.
    pub rate: f64,
}

impl Plan {
    /// The plan of a film of a scene.
    pub fn new(file: &SceneFile, degradations: &[Degradation], key: Key) -> Self {
        let has = |degradation| degradations.contains(&degradation);
        let mut dice = Dice::new(key.fold(100));
        let slower = if has(Degradation::SlowMotion) { SLOWER } else { 1.0 };
        let rate = file.time.frames_per_s * slower;
        let interval = 1.0 / rate;
        let before = match (has(Degradation::Waiting), has(Degradation::HandRelease)) {
            (true, _) => dice.within(1.0, 2.5),
            (false, true) => dice.within(0.2, 0.5),
            // it is let go before the first picture
            (false, false) => -dice.within(0.0, 1.0) * interval,
        };
        let after = if has(Degradation::Waiting) { dice.within(0.5, 1.5) } else { 0.0 };
        let end = file.time.duration_s + after;
        let mut times = vec![-before];
        while let Some(next) = times.last().map(|last| last + interval).filter(|next| *next <= end) {
            // exposure control makes intervals longer and shorter, and drops a picture now and then
            let uneven = match (has(Degradation::VariableRate), dice.chance(0.06)) {
                (false, _) => 0.0,
                (true, true) => interval,
                (true, false) => dice.within(-0.3, 0.3) * interval,
            };
            times.push(next + uneven);
        }
        let pixels = file.film.as_ref().map_or(COMPRESSED.1, |film| film.pixels.iter().product::<usize>() as f64);
        let bit_rate = COMPRESSED.0 * (pixels / COMPRESSED.1).powf(BITS);
        Self {
            times,
            exposure: EXPOSURES[usize::from(has(Degradation::Blur))] * interval,
            readout: if has(Degradation::RollingShutter) { READOUT * interval } else { 0.0 },
            has_hand: has(Degradation::HandRelease) || has(Degradation::Waiting),
            shake: if has(Degradation::Shake) { SHAKE } else { 0.0 },
            has_shadows: has(Degradation::MovingShadows),
            bit_rate: has(Degradation::Compression).then_some(bit_rate),
            slower,
            is_turned: has(Degradation::Portrait),
            rate,
        }
    }

    /// Time of each picture in the file \[s\].
    pub fn stamps(&self) -> impl Iterator<Item = f64> {
        self.times.iter().map(|time| (time - self.times[0]) * self.slower)
    }

    /// Whether all intervals are alike.
    pub fn is_even(&self) -> bool {
        self.times.windows(2).all(|pair| ((pair[1] - pair[0]) * self.rate - 1.0).abs() < 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phone::scenes::scene;

    fn plan(degradations: &[Degradation]) -> Plan {
        Plan::new(&scene(Key::new(1)), degradations, Key::new(2))
    }

    #[test]
    fn pictures_are_taken_from_the_beginning_to_the_end() {
        let file = scene(Key::new(1));
        let interval = 1.0 / file.time.frames_per_s;
        let clean = plan(&[]);
        assert!(clean.is_even() && (0.0..interval).contains(&clean.times[0]));
        let last = clean.times[clean.times.len() - 1];
        assert!(last <= file.time.duration_s && last > file.time.duration_s - interval);
        let waiting = plan(&[Degradation::Waiting]);
        assert!(waiting.has_hand && waiting.times[0] <= -1.0);
        assert!(waiting.times.last().unwrap() > &file.time.duration_s);
    }

    #[test]
    fn uneven_times_rise() {
        let uneven = plan(&[Degradation::VariableRate]);
        assert!(!uneven.is_even() && uneven.times.is_sorted());
        assert_eq!(uneven.stamps().next(), Some(0.0));
    }

    #[test]
    fn slow_motion_stretches_the_file_alone() {
        let [plain, slow] = [plan(&[]), plan(&[Degradation::SlowMotion])];
        assert_eq!(slow.rate, 4.0 * plain.rate);
        let length = |plan: &Plan| plan.times[plan.times.len() - 1] - plan.times[0];
        assert!((length(&slow) - length(&plain)).abs() < 2.0 / plain.rate);
        assert!((slow.stamps().last().unwrap() - 4.0 * length(&slow)).abs() < 1e-9);
    }
}
