//! Slow motion and time lapse, told from the tags that cameras leave in a file.

/// Start of messages about the time.
pub(super) const TIME: &str = "time: ";

/// Ends of the names of tags that state the recording rate, without separators.
const NAMES: [&str; 5] = ["capturefps", "capturerate", "captureframerate", "recordingframerate", "recordframerate"];

/// A recording rate within these factors of the file's own rate is the rate of the file, a little off.
const SAME: std::ops::RangeInclusive<f64> = 0.8..=1.25;

/// Maximum deviation of a ratio of rates from a whole number that it is meant to be.
const WHOLE: f64 = 0.03;

/// Accepted recording rates \[1/s\].
const BELIEVED: std::ops::RangeInclusive<f64> = 0.01..=1e6;

/// How the times of a file relate to real time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Speed {
    /// Real seconds per second of the file.
    pub real: f64,
    /// Recording rate, if stated \[1/s\].
    pub capture_rate: Option<f64>,
    /// Message about it.
    pub said: Option<String>,
}

/// The speed of a film whose file shows `rate` pictures per second, from its tags.
pub(super) fn speed<'a>(tags: impl Iterator<Item = (&'a str, &'a str)>, rate: Option<f64>) -> Speed {
    let stated = tags.filter(|(name, _)| is_rate(name)).find_map(|(name, value)| Some((name, number(value)?)));
    let stated = stated.filter(|(_, capture)| BELIEVED.contains(capture));
    let (Some((name, capture)), Some(rate)) = (stated, rate.filter(|rate| *rate > 0.0)) else {
        return Speed { real: 1.0, capture_rate: stated.map(|(_, capture)| capture), said: None };
    };
    let ratio = capture / rate;
    if SAME.contains(&ratio) {
        return Speed { real: 1.0, capture_rate: Some(capture), said: None };
    }
    // the camera multiplies the times of its pictures by a whole number, so that their unevenness is real
    let whole = |ratio: f64| (ratio / ratio.round() - 1.0).abs() <= WHOLE;
    let real = match ratio {
        ratio if ratio > 1.0 && whole(ratio) => 1.0 / ratio.round(),
        ratio if ratio < 1.0 && whole(1.0 / ratio) => (1.0 / ratio).round(),
        ratio => 1.0 / ratio,
    };
    let kind = if real < 1.0 { "slow motion" } else { "time lapse" };
    let said =
        format!("{TIME}{capture} frames per second, as the file's tag {name} says; it is played at {rate:.4} ({kind})");
    Speed { real, capture_rate: Some(capture), said: Some(said) }
}

/// Whether a tag of this name states the recording rate.
fn is_rate(name: &str) -> bool {
    let plain: String = name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase();
    NAMES.iter().any(|end| plain.ends_with(end))
}

/// The number in `120`, `119.88p`, `240 fps` or `120000/1001`.
fn number(value: &str) -> Option<f64> {
    let plain =
        |text: &str| text.trim().trim_end_matches(|c: char| c.is_alphabetic() || c.is_whitespace()).parse::<f64>().ok();
    let number = match value.split_once('/') {
        Some((over, under)) => plain(over)? / plain(under)?,
        None => plain(value)?,
    };
    (number.is_finite() && number > 0.0).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn real(name: &str, value: &str, rate: f64) -> f64 {
        speed([("encoder", "x"), (name, value)].into_iter(), Some(rate)).real
    }

    #[test]
    fn tags_of_cameras_undo_slow_motion() {
        assert_eq!(real("com.android.capture.fps", "120.000000", 29.995), 0.25);
        assert_eq!(real("com.apple.quicktime.capture-rate", "240000/1001", 29.97), 0.125);
        assert_eq!(real("CaptureFrameRate", "119.88p", 23.976), 0.2);
        // a ratio that is not whole, and a time lapse
        assert_eq!(real("com.android.capture.fps", "75", 30.0), 0.4);
        assert_eq!(real("com.android.capture.fps", "0.5", 30.0), 60.0);
        let said = speed([("com.android.capture.fps", "120")].into_iter(), Some(30.0)).said.unwrap();
        assert!(said.contains("120 frames per second, as the file's tag com.android.capture.fps says"), "{said}");
    }

    #[test]
    fn what_says_nothing_changes_nothing() {
        // the rate of an ordinary recording, in which some pictures are late
        assert_eq!(real("com.android.capture.fps", "30.000000", 28.9), 1.0);
        assert_eq!(real("com.android.capture.fps", "soon", 30.0), 1.0);
        assert_eq!(real("com.android.capture.fps", "0", 30.0), 1.0);
        assert_eq!(real("com.android.capture.fps", "1e99", 30.0), 1.0);
        assert_eq!(real("com.android.version", "15", 30.0), 1.0);
        assert_eq!(speed([("capture_fps", "120")].into_iter(), None).capture_rate, Some(120.0));
    }
}
