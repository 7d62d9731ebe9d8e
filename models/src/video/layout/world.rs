//! Conversion from a layout's coordinates and times to metres, y up and seconds.

use gradreel::{Error, ErrorKind, Result};

use super::side::{NAME, Side};
use super::{Reading, View};
use crate::vector::{cross, dot, minus, product, times};

/// The up direction of a layout.
pub(super) enum Up {
    /// This direction, by the layout's convention.
    Custom([f64; 3]),
    /// Unknown: estimated by the mean of the cameras' up directions.
    Cameras,
}

/// Meaning of a layout's times.
pub(super) enum Clock {
    /// Seconds.
    Seconds,
    /// Between 0 and 1: seconds or normalised; `whole` if they span 0 to 1.
    Unit { whole: bool },
    /// Frames counted from 0, with the default rate `per_s` \[1/s\].
    Counted { per_s: f64 },
}

/// Converts cameras and times as `clip.toml` states; missing values follow the layout's convention and are
/// reported.
pub(super) fn settle(reading: &mut Reading, side: &Side) -> Result<()> {
    let (up, mut said) = match (side.up, &reading.up) {
        (Some(up), _) => (up, format!("up is {} ({NAME})", direction(up))),
        (None, Up::Custom(up)) => (*up, format!("up is {}, as is the custom of this layout", direction(*up))),
        (None, Up::Cameras) => {
            let up = mean_up(reading)?;
            (up, format!("up is {}, the mean of the cameras' upward directions", direction(up)))
        }
    };
    let scale = side.metres_per_unit.unwrap_or(1.0);
    said += &match side.metres_per_unit {
        Some(scale) => format!("; a unit is {scale} m ({NAME})"),
        None if reading.metres => "; metres".to_owned(),
        None => "; a unit is 1 m".to_owned(),
    };
    let origin = side.origin.unwrap_or([0.0; 3]);
    if side.origin.is_some() {
        said += &format!("; the origin is at {origin:?} ({NAME})");
    }
    if !reading.metres && (side.up.is_none() || side.metres_per_unit.is_none()) {
        said += &format!(". Say otherwise by up, metres_per_unit and origin in {NAME}");
    }
    reading.assumptions.push(format!("world: {said}"));
    let turn = upright(up);
    for view in reading.views.values_mut() {
        view.c2w = moved(&view.c2w, &turn, scale, origin);
    }
    retime(reading, side)
}

/// The shortest rotation of a unit vector to +y; half a turn about x if it points down.
fn upright(up: [f64; 3]) -> [[f64; 3]; 3] {
    let cosine = up[1];
    if cosine < -1.0 + 1e-12 {
        return [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
    }
    let v = cross(up, [0.0, 1.0, 0.0]);
    let skew = [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]];
    let twice = product(skew, skew);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| f64::from(u8::from(i == j)) + skew[i][j] + twice[i][j] / (1.0 + cosine))
    })
}

/// The camera after the transformation `x ↦ scale · turn (x − origin)`.
fn moved(c2w: &[[f64; 4]; 3], turn: &[[f64; 3]; 3], scale: f64, origin: [f64; 3]) -> [[f64; 4]; 3] {
    let column = |j: usize| c2w.map(|row| row[j]);
    let axes = [0, 1, 2].map(|j| times(turn, column(j)));
    let centre = times(turn, minus(column(3), origin)).map(|x| scale * x);
    std::array::from_fn(|i| [axes[0][i], axes[1][i], axes[2][i], centre[i]])
}

fn mean_up(reading: &Reading) -> Result<[f64; 3]> {
    let count = reading.views.len() as f64;
    let mean = [0, 1, 2].map(|i| reading.views.values().map(|view| view.c2w[i][1]).sum::<f64>() / count);
    let length = dot(mean, mean).sqrt();
    if length > 0.3 {
        return Ok(mean.map(|x| x / length));
    }
    Err(Error::new(ErrorKind::Input, "the cameras do not tell which way is up")
        .at(reading.list.display())
        .found(format!("upward directions of the images that cancel (mean length {length:.2})"))
        .wanted("cameras that are held upright, or the direction")
        .fix(format!("write up = [x, y, z] into {NAME} in the clip's folder")))
}

fn direction(up: [f64; 3]) -> String {
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        if up[axis].abs() > 1.0 - 1e-9 {
            return format!("{}{name}", if up[axis] < 0.0 { "−" } else { "" });
        }
    }
    format!("[{:.3}, {:.3}, {:.3}]", up[0], up[1], up[2])
}

fn retime(reading: &mut Reading, side: &Side) -> Result<()> {
    let all = || reading.views.values().flat_map(|view| view.times.iter());
    let Some(&first_frame) = all().map(|(frame, _)| frame).min() else { return Ok(()) };
    let last_frame = all().map(|(&frame, _)| frame).max().unwrap_or(first_frame);
    let first = all().map(|(_, &time)| time).fold(f64::INFINITY, f64::min);
    let last = all().map(|(_, &time)| time).fold(f64::NEG_INFINITY, f64::max);
    let (intervals, span) = ((last_frame as f64) - (first_frame as f64), last - first);
    if intervals == 0.0 {
        return Ok(());
    }
    let wrong = |found: String, fix: &str| {
        Err(Error::new(ErrorKind::Input, "the clip's frame times are not known")
            .at(reading.list.display())
            .found(found)
            .wanted("times in seconds")
            .fix(fix))
    };
    // t ↦ (t − start) · factor, the identity if nothing changes
    let (start, factor, said) = match (&reading.clock, side.frames_per_s, side.duration_s) {
        (_, Some(rate), _) if span > 0.0 => {
            (first, intervals / span / rate, format!("{rate} frames per second ({NAME})"))
        }
        (Clock::Seconds, None, Some(_)) => {
            return wrong(
                format!("times from {first} to {last} s in the list, and duration_s in {NAME}"),
                "leave duration_s out, or give frames_per_s, which replaces the list's times",
            );
        }
        (Clock::Unit { whole: true }, None, None) => {
            return wrong(
                "times from 0 to 1, which D-NeRF uses for any duration".to_owned(),
                "write duration_s = … or frames_per_s = … into clip.toml in the clip's folder; duration_s = 1 if the \
                 times are seconds",
            );
        }
        (Clock::Unit { .. }, None, Some(duration)) => {
            (0.0, duration, format!("times are shares of {duration} s ({NAME})"))
        }
        (Clock::Counted { .. }, None, Some(duration)) if span > 0.0 => {
            (first, duration / span, format!("{duration} s from the first frame to the last ({NAME})"))
        }
        (Clock::Counted { per_s }, None, None) => (
            first,
            1.0 / per_s,
            format!("{per_s:.4} frames per second; give frames_per_s or duration_s in {NAME} if that is wrong"),
        ),
        (Clock::Unit { .. }, None, None) => {
            let said = format!(
                "times from {first} to {last} are seconds; give duration_s in {NAME} if they are shares of a duration"
            );
            (0.0, 1.0, said)
        }
        _ => (0.0, 1.0, "seconds, as listed".to_owned()),
    };
    let change = |view: &mut View| {
        for time in view.times.values_mut() {
            *time = (*time - start) * factor;
        }
    };
    reading.views.values_mut().for_each(change);
    reading.assumptions.push(format!("time: {said}"));
    Ok(())
}
