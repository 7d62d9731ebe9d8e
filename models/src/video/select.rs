//! Selection of the cameras and frames to open, and its completeness.

use gradreel::{Error, ErrorKind, Result};

use super::clip::OpenOptions;
use super::layout::{Format, Kind, Layout};
use super::plausible;

/// Tolerated deviation of a frame time from even spacing, as a share of the frame interval.
const TIME_TOLERANCE: f64 = 0.02;

/// Cameras, frame numbers and times \[s\] of a clip about to be opened.
#[derive(Debug, Clone)]
pub(super) struct Selection {
    pub cameras: Vec<i64>,
    pub frames: Vec<i64>,
    pub times: Vec<f64>,
    /// Warnings about them.
    pub said: Vec<String>,
}

/// Applies the options; every selected camera must have every selected frame, at evenly spaced times.
pub(super) fn select(layout: &Layout, options: &OpenOptions) -> Result<Selection> {
    let cameras = cameras(layout, options)?;
    let listed = || cameras.iter().flat_map(|c| layout.views[c].times.keys().copied());
    let first = options.first_frame.or_else(|| listed().min()).unwrap_or(0);
    let mut last = listed().max().unwrap_or(first);
    if let Some(count) = options.max_frames {
        let count = i64::try_from(count).unwrap_or(i64::MAX);
        last = last.min(first.saturating_add(count.saturating_sub(1)));
    }
    if last < first || options.max_frames == Some(0) {
        return Err(Error::new(ErrorKind::Input, "no frame is selected")
            .at(layout.root.display())
            .found(format!("frames up to {}", listed().max().unwrap_or(first)))
            .wanted(format!("at least one frame from frame {first} on"))
            .fix("choose an earlier first frame or more frames"));
    }
    for &camera in &cameras {
        complete(layout, camera, first, last)?;
    }
    let frames: Vec<i64> = (first..=last).collect();
    let (times, said) = times(layout, &cameras, &frames)?;
    Ok(Selection { cameras, frames, times, said })
}

fn cameras(layout: &Layout, options: &OpenOptions) -> Result<Vec<i64>> {
    let all: Vec<i64> = layout.views.keys().copied().collect();
    let Some(wanted) = &options.cameras else { return Ok(all) };
    let mut chosen: Vec<i64> = Vec::new();
    for &camera in wanted {
        if !all.contains(&camera) {
            return Err(Error::new(ErrorKind::Input, format!("camera {camera} is not in the clip"))
                .at(layout.list.display())
                .found(format!("cameras {}", ranges(&all)))
                .fix("choose among the cameras of the clip"));
        }
        if !chosen.contains(&camera) {
            chosen.push(camera);
        }
    }
    if chosen.is_empty() {
        return Err(Error::new(ErrorKind::Input, "no camera is selected")
            .at(layout.root.display())
            .found("an empty list of cameras")
            .wanted(format!("some of {}", ranges(&all)))
            .fix("leave the choice of cameras out to use all of them"));
    }
    Ok(chosen)
}

fn complete(layout: &Layout, camera: i64, first: i64, last: i64) -> Result<()> {
    let usable = layout.usable_frames(camera);
    // Bounded by the existing frames, so that one huge frame number cannot cause endless work.
    let mut next = first;
    for &frame in usable.iter().filter(|&&frame| frame >= first) {
        if frame != next {
            break;
        }
        next = next.saturating_add(1);
    }
    if next > last {
        return Ok(());
    }
    let listed = layout.views[&camera].times.contains_key(&next);
    let (missing, fix) = if listed {
        let file = layout.file(Kind::Image, camera, next);
        (format!("the file {} does not exist", file.display()), "add the image")
    } else {
        let list = match layout.format {
            Format::SpringGaus | Format::Colmap => format!("the folder {}", layout.views[&camera].name),
            _ => layout.list.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        };
        (format!("{list} has no entry for it"), "add the entry")
    };
    let have = if usable.is_empty() { "no frames".into() } else { format!("frames {}", ranges(&usable)) };
    Err(Error::new(ErrorKind::Input, format!("camera {camera} has {have}, frame {next} is missing"))
        .at(layout.root.display())
        .found(missing)
        .wanted(format!("every frame from {first} to {last}"))
        .fix(format!("{fix}, or choose frames (first frame, number of frames) or cameras that are complete")))
}

/// The frame times, and warnings about them.
fn times(layout: &Layout, cameras: &[i64], frames: &[i64]) -> Result<(Vec<f64>, Vec<String>)> {
    let of = |camera: &i64| -> Vec<f64> { frames.iter().map(|frame| layout.views[camera].times[frame]).collect() };
    let times = of(&cameras[0]);
    let uneven = |what: String, found: String| {
        Error::new(ErrorKind::Input, what)
            .at(layout.list.display())
            .found(found)
            .wanted("evenly spaced times, the same for all cameras")
            .fix("correct the times [s], or leave the odd frames out and renumber the rest")
    };
    let count = times.len();
    if count < 2 {
        return Ok((times, vec!["a single frame: shape only, no motion".to_owned()]));
    }
    let dt = (times[count - 1] - times[0]) / (count - 1) as f64;
    if dt <= 0.0 || !dt.is_finite() {
        return Err(uneven("time does not advance".into(), format!("{dt:?} s between frames")));
    }
    let said = plausible::interval(dt, &layout.list)?;
    for (k, &time) in times.iter().enumerate() {
        let even = times[0] + k as f64 * dt;
        if (time - even).abs() > TIME_TOLERANCE * dt {
            let what = "the frames are not evenly spaced in time".into();
            return Err(uneven(what, format!("frame {} at {time:?} s instead of {even:?} s", frames[k])));
        }
    }
    for camera in &cameras[1..] {
        for ((&time, &reference), frame) in of(camera).iter().zip(&times).zip(frames) {
            if (time - reference).abs() > TIME_TOLERANCE * dt {
                let what = "the cameras are not synchronous".into();
                let found = format!(
                    "frame {frame} at {time:?} s (camera {camera}) and {reference:?} s (camera {})",
                    cameras[0]
                );
                return Err(uneven(what, found));
            }
        }
    }
    Ok((times, said.into_iter().collect()))
}

/// Sorted numbers as ranges in words: `0–4 and 6–13`.
pub(super) fn ranges(numbers: &[i64]) -> String {
    let mut spans: Vec<(i64, i64)> = Vec::new();
    for &number in numbers {
        match spans.last_mut() {
            Some(span) if span.1 + 1 == number => span.1 = number,
            _ => spans.push((number, number)),
        }
    }
    let words: Vec<String> =
        spans.iter().map(|&(a, b)| if a == b { a.to_string() } else { format!("{a}–{b}") }).collect();
    match words.as_slice() {
        [] => "none".into(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}
