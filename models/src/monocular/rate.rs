//! Whether a fall fits the frame rate that a file tells: lengths by gravity go with the square of the interval.

use crate::video::WARNING;

/// Possible object sizes \[m\].
const SIZES: [f64; 2] = [0.01, 2.0];

/// Diameter of things that people film as they fall \[m\], and the height from which \[m\]: median, and standard deviation in
/// decades. Nine of ten are 2 to 45 cm across and fall from 0.2 to 3 m.
const SIZE: (f64, f64) = (0.1, 0.4);
const HEIGHT: (f64, f64) = (0.8, 0.35);

/// Share of the films that were filmed at another rate than their files tell.
const UNTOLD: f64 = 0.05;

/// A rate is doubted below this probability.
const DOUBTED: f64 = 0.1;

/// Common frame rates of cameras \[1/s\].
const RATES: [f64; 12] = [15.0, 24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 240.0, 480.0, 960.0, 1000.0];

/// Warning for a rate that makes the object, or the height from which it falls, another than people film, while a usual rate does
/// not; that rate is named. The height is unknown if the ground is not seen.
pub(super) fn doubted(diameter: f64, height: Option<f64>, frames_per_s: f64) -> Option<String> {
    let scale = |rate: f64| (frames_per_s / rate).powi(2);
    let log_prior = |rate: f64| {
        let one = |x: f64, (median, deviation): (f64, f64)| -0.5 * ((x / median).log10() / deviation).powi(2);
        let factor = scale(rate);
        one(factor * diameter, SIZE) + height.filter(|height| *height > 0.0).map_or(0.0, |h| one(factor * h, HEIGHT))
    };
    let is_possible = |rate: f64| (SIZES[0]..=SIZES[1]).contains(&(scale(rate) * diameter));
    let others = RATES.into_iter().filter(|rate| (rate / frames_per_s - 1.0).abs() > 0.02);
    let others: Vec<(f64, f64)> = others.map(|rate| (rate, log_prior(rate))).collect();
    let told = log_prior(frames_per_s) + (1.0 - UNTOLD).ln();
    let each = (UNTOLD / others.len() as f64).ln();
    let against: f64 = others.iter().map(|(_, log)| (log + each - told).exp()).sum();
    if is_possible(frames_per_s) && 1.0 / (1.0 + against) >= DOUBTED {
        return None;
    }
    let best = others.into_iter().filter(|(rate, _)| is_possible(*rate)).max_by(|a, b| a.1.total_cmp(&b.1));
    let fall = |factor: f64| height.map_or_else(String::new, |h| format!(" that falls from {}", length(factor * h)));
    let fit = match best {
        Some((rate, _)) => {
            format!("with --fps {rate:.0} it would be {}{}", length(scale(rate) * diameter), fall(scale(rate)))
        }
        None => format!("no usual frame rate makes it {} to {}", length(SIZES[0]), length(SIZES[1])),
    };
    Some(format!(
        "{WARNING}an object of {}{} is hardly what falls there: is {frames_per_s:.4} 1/s the rate at which it was filmed? {fit}",
        length(diameter),
        fall(1.0)
    ))
}

/// What is wanted of a film.
pub(super) fn wanted() -> String {
    format!("an object of {} to {}, and a fall as people film it", length(SIZES[0]), length(SIZES[1]))
}

/// A length in a suitable unit.
pub(super) fn length(metres: f64) -> String {
    match metres {
        ..0.0995 => format!("{:.1} cm", 100.0 * metres),
        ..1e4 => format!("{metres:.2} m"),
        _ => format!("{metres:.2e} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_would_fit_is_proposed() {
        assert_eq!(doubted(0.01, None, 24.0), None);
        assert_eq!(doubted(1.0, None, 24.0), None);
        // 8 m at 24 1/s are 8 (24/240)² = 0.08 m at 240 1/s, and 0.32 m at 120 1/s
        let told = doubted(8.0, None, 24.0).unwrap();
        assert!(told.starts_with("warning: an object of 8.00 m") && told.contains("--fps 240"), "{told}");
        assert!(told.contains("8.0 cm"), "{told}");
        // 1 mm at 240 1/s is 0.001 (240/24)² = 0.1 m at 24 1/s
        let told = doubted(0.001, None, 240.0).unwrap();
        assert!(told.contains("0.1 cm") && told.contains("--fps 24 it would be 0.10 m"), "{told}");
        assert!(doubted(1e9, None, 24.0).unwrap().contains("no usual frame rate"));
        assert!(doubted(f64::NAN, None, 24.0).is_some());
    }

    /// Things as people film them are believed, and so are large ones that fall from as high as they are.
    #[test]
    fn usual_falls_are_believed() {
        for (diameter, height) in [(0.04, 0.3), (0.1, 0.8), (0.22, 1.5), (0.5, 1.0), (1.0, 1.5), (0.02, 0.1)] {
            assert_eq!(doubted(diameter, Some(height), 30.0), None, "{diameter} m from {height} m");
        }
    }

    /// A ball of 10 cm that falls from 80 cm at 120 or 240 pictures a second, in a file that tells 30.
    #[test]
    fn slow_motion_is_asked_for() {
        for slower in [4.0_f64, 8.0] {
            let factor = slower * slower;
            let told = doubted(0.1 * factor, Some(0.8 * factor), 30.0).unwrap();
            assert!(told.contains(&format!("--fps {:.0} ", 30.0 * slower)), "{told}");
        }
    }
}
