//! Plausibility checks: wrong units or damaged lists are rejected before any computation.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use super::camera::Camera;
use super::clip::WARNING;
use super::parabola::GRAVITY;

/// Maximum coordinate of a camera \[m\]; further from the origin, single precision loses the object's motion.
const FARTHEST: f64 = 1e4;

/// Accepted angles of view of a pinhole camera \[degrees\].
const ANGLES: (f64, f64) = (0.01, 170.0);

/// Maximum offset of the principal point from the image centre, in image widths or heights.
const OFF_CENTRE: f64 = 10.0;

/// Time between frames \[s\]: values outside the first range are errors, outside the second warnings.
const INTERVALS: [(f64, f64); 2] = [(1e-6, 1.0), (1e-4, 0.2)];

/// Checks the position and field of view of a camera; returns a warning for doubtful values.
///
/// # Errors
/// [`ErrorKind::Input`] naming the list, for an implausible position, angle of view or principal point.
pub(super) fn camera(camera: &Camera, list: &Path) -> Result<Option<String>> {
    let id = camera.id;
    let refused = |what: String, found: String| Error::new(ErrorKind::Input, what).at(list.display()).found(found);
    let centre = camera.centre();
    if !camera.c2w.iter().flatten().all(|x| x.abs() <= FARTHEST) {
        return Err(refused(format!("camera {id} is too far from the origin"), format!("a camera at {centre:?} m"))
            .wanted(format!("coordinates within {FARTHEST} m"))
            .fix("correct the list, or give origin (a point near the object) and metres_per_unit in clip.toml"));
    }
    let (width, height) = (camera.width as f64, camera.height as f64);
    for (focal, side) in [(camera.fx, width), (camera.fy, height)] {
        let angle = 2.0 * (0.5 * side / focal).atan().to_degrees();
        if !(ANGLES.0..=ANGLES.1).contains(&angle) {
            let found =
                format!("a focal length of {focal:?} pixels for {side} pixels: an angle of view of {angle:.3}°");
            return Err(refused(format!("camera {id} has no angle of view of a lens"), found)
                .wanted(format!("{} to {}°", ANGLES.0, ANGLES.1))
                .fix("give the focal lengths in pixels of these images"));
        }
    }
    let inside = (0.0..=width).contains(&camera.cx) && (0.0..=height).contains(&camera.cy);
    let near = |at: f64, side: f64| (at - 0.5 * side).abs() <= OFF_CENTRE * side;
    let found = format!("principal point ({:?}, {:?}) outside {width} × {height} pixels", camera.cx, camera.cy);
    if !near(camera.cx, width) || !near(camera.cy, height) {
        return Err(refused(format!("camera {id} looks past its image"), found)
            .wanted("a principal point near the middle of the image, in pixels")
            .fix("correct the intrinsics in the list"));
    }
    Ok((!inside).then(|| {
        format!("{WARNING}camera {id} looks past its image: {found}; are the intrinsics of another image size?")
    }))
}

/// Checks the time between frames \[s\]; returns a warning for doubtful values.
///
/// # Errors
/// [`ErrorKind::Input`] naming the list, for a frame interval too short or too long to show a fall.
pub(super) fn interval(dt: f64, list: &Path) -> Result<Option<String>> {
    let fallen = format!("{dt:?} s between frames, in which what falls falls {:?} m", rounded(0.5 * GRAVITY * dt * dt));
    let fix =
        "if the times are not in seconds, write the frame rate as frames_per_s = … into clip.toml in the clip's folder";
    let [possible, usual] = INTERVALS;
    if !(possible.0..=possible.1).contains(&dt) {
        return Err(Error::new(ErrorKind::Input, "the frames are too near in time, or too far apart")
            .at(list.display())
            .found(fallen)
            .wanted(format!("{:?} to {} s between frames", possible.0, possible.1))
            .fix(fix));
    }
    Ok((!(usual.0..=usual.1).contains(&dt)).then(|| format!("{WARNING}{fallen}; {fix}")))
}

/// Rounds to two digits, for messages.
fn rounded(x: f64) -> f64 {
    format!("{x:.1e}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(change: impl Fn(&mut Camera)) -> Result<Option<String>> {
        let c2w = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 3.0]];
        let mut given = Camera { id: 4, width: 640, height: 480, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, c2w };
        change(&mut given);
        camera(&given, Path::new("list.json"))
    }

    #[test]
    fn cameras_as_they_are_filmed_with() {
        assert_eq!(seen(|_| {}).unwrap(), None);
        assert!(seen(|camera| camera.cx = -5.0).unwrap().is_some_and(|said| said.contains("looks past its image")));
        let told = |change: fn(&mut Camera)| seen(change).unwrap_err().to_string();
        assert!(told(|camera| camera.c2w[1][3] = 1e308).contains("1e308"));
        assert!(told(|camera| camera.c2w[0][3] = f64::NAN).contains("too far"));
        // focal length given as a share of the width
        assert!(told(|camera| camera.fx = 1.2).contains("1.2 pixels for 640 pixels"));
        assert!(told(|camera| camera.fy = 1e12).contains("angle of view"));
        assert!(told(|camera| camera.cy = 1e300).contains("1e300"));
    }

    #[test]
    fn intervals_of_films() {
        let list = Path::new("list.json");
        for rate in [5.0, 24.0, 1000.0, 10_000.0] {
            assert_eq!(interval(1.0 / rate, list).unwrap(), None);
        }
        // 0.5 · 9.81 · 0.5² = 1.2
        assert!(interval(0.5, list).unwrap().is_some_and(|said| said.contains("falls 1.2 m")));
        assert!(interval(1e-5, list).unwrap().is_some());
        for dt in [60.0, 1e300, 4e-302, f64::NAN] {
            assert!(interval(dt, list).unwrap_err().to_string().contains("frames_per_s"));
        }
    }
}
