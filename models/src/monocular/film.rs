//! A clip from a film of an uncalibrated camera.

use std::path::Path;
use std::sync::Arc;

use gradreel::{Error, ErrorKind, Result};
use ndarray::azip;

use super::free_fall::{Down, FreeFall, Prior};
use super::{bounces, ground, half_extent, locate, locate_known, rate, story};
use crate::vector::times;
use crate::video::{Camera, Clip, ContactModel, Film, FilmSettings, Flight, Frame, OpenOptions, WARNING};

/// Default angle of view along the longer side of the image \[degrees\].
const FIELD_OF_VIEW: f64 = 50.0;

/// Default downward pitch of the camera and its standard deviation \[degrees\]: from 10° up to 50° down, with a probability of
/// 90 %.
const ELEVATION: [f64; 2] = [20.0, 18.0];

/// Reads the film at `path` as a metric single-camera clip. The ballistic fit yields the object's depth; the
/// position of first contact yields the ground, which becomes height 0. The camera stands upright at `x = z = 0`.
///
/// # Errors
/// Those of [`Film::read`], and [`ErrorKind::Input`] for a film that does not start with three frames of free fall.
pub fn clip_of_film(path: &Path, settings: &FilmSettings, options: &OpenOptions, gravity: [f64; 3]) -> Result<Clip> {
    let strength = -gravity[1];
    if !(strength > 0.0 && gravity[0] == 0.0 && gravity[2] == 0.0) {
        return Err(Error::new(ErrorKind::Input, "a film's ground is horizontal")
            .at("world.gravity")
            .found(format!("{gravity:?} m/s²"))
            .wanted("gravity along −y")
            .fix("say by clip.film.elevation how the camera is held instead"));
    }
    let film = Film::read(path, settings, options)?;
    let (height, width) = film.frames[0].alpha.dim();
    let longer = width.max(height) as f64;
    let of_view = |degrees: f64| 0.5 * longer / (0.5 * degrees.to_radians()).tan();
    let (focal, source) = match film.focal {
        _ if settings.field_of_view > 0.0 => (of_view(settings.field_of_view), "as given"),
        Some(share) => (share * (width as f64).hypot(height as f64), "as the file says of its lens"),
        None => (of_view(FIELD_OF_VIEW), "assumed"),
    };
    let degrees = 2.0 * (0.5 * longer / focal).atan().to_degrees();
    let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
    let upright = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let camera = Camera { id: 0, width, height, fx: focal, fy: focal, cx, cy, c2w: upright };
    let count = film.frames.len();
    let mut clip = Clip {
        name: film.name,
        root: path.to_path_buf(),
        cameras: vec![camera],
        times: (0..count).map(|k| k as f64 / film.frames_per_s).collect(),
        frame_numbers: film.numbers.iter().map(|number| *number as i64).collect(),
        frames: vec![film.frames],
        foreground: vec![film.foreground],
        imagined: vec![false],
        assumptions: film.assumptions,
        flight: None,
        around: None,
        story: None,
    };
    let down = match settings.elevation.map(f64::to_radians) {
        Some(angle) => Down::Known([0.0, -angle.cos(), -angle.sin()]),
        None => Down::Tilted { angle: ELEVATION[0].to_radians(), deviation: ELEVATION[1].to_radians() },
    };
    let scale = film.scale;
    let located = |clip: &Clip| -> Result<Option<FreeFall>> {
        let Some(scale) = scale else { return locate(clip, down) };
        // what the frames show is of their real times, even where the clip's are even
        let clip = &Clip { times: film.times.iter().map(|time| time - film.times[0]).collect(), ..clip.clone() };
        let [pixels, relative] = scale.acceleration;
        let deviation = pixels * relative.hypot(DEPARTS);
        let known = locate_known(clip, scale.free, Prior { down, acceleration: Some([pixels, deviation]) })?;
        if known.is_some() { Ok(known) } else { locate(clip, down) }
    };
    let mut fall = located(&clip)?;
    if let Some(hueless) = film.hueless {
        let flight = fall.as_ref().map_or(Flight::LEAST_FRAMES, |fall| fall.frames);
        if complete(&mut clip.frames[0], hueless, flight) {
            clip.assumptions.push(
                "parts in the background's hue: of the object while it is in the air, of nothing afterwards (the film has few colours)"
                    .to_owned(),
            );
            fall = located(&clip)?.or(fall);
        }
    }
    let Some(fall) = fall else {
        return Err(Error::new(ErrorKind::Input, "the film does not begin with a free fall")
            .at(path.display())
            .found(format!("{count} frames, {} 1/s", film.frames_per_s))
            .wanted("the whole object, falling freely in the first three frames at least: gravity gives the pixels their metres")
            .fix(
                "choose the frame where the object is let go as the first (--first-frame), give --fps if the film is slow \
                 motion, or masks (--masks) or a matting network (--matting) if the background is taken for the object; a clip of \
                 calibrated cameras needs no fall",
            ));
    };
    let own = strength / fall.gravity;
    let (metres, diameter, deviation) = match scale {
        Some(scale) => {
            let [size, sure] = match settings.elevation {
                Some(angle) => [scale.level[0] * angle.to_radians().cos(), scale.level[1]],
                None => scale.diameter,
            };
            let (first, all) = (own, size * clip.cameras[0].fx / scale.across);
            let (single, apart) = (fall.deviation.hypot(SINGLE), (first / all).ln());
            // one flight that is short, or says something else, does not count beside all of them
            let believed = single < BELIEVED && apart.abs() < 2.0 * single.hypot(sure);
            let weights = [if believed { single.powi(-2) } else { 0.0 }, sure.powi(-2)];
            let both = weights[0] + weights[1];
            let metres = (all.ln() + weights[0] * apart / both).exp();
            // they err in part together
            let deviation = both.powf(-0.5).hypot(0.5 * apart * (weights[0] * weights[1]).sqrt() / both);
            (metres, metres * scale.across / clip.cameras[0].fx, deviation.max(UNMODELLED))
        }
        None => (own, 2.0 * own * half_extent(&clip), fall.deviation),
    };
    let lowest = ground::below(&clip.cameras[0], &clip.frames[0], &clip.times, &fall);
    let height = lowest.map(|height| -metres * height);
    let told = film.frames_per_s * film.every as f64;
    let warning = rate::doubted(diameter, height, told);
    if let Some(warning) = warning.as_ref().filter(|_| settings.frames_per_s == 0.0) {
        let said = warning.trim_start_matches(WARNING);
        return Err(Error::new(ErrorKind::Input, "the fall does not fit the frame rate of the file")
            .at(path.display())
            .found(said)
            .wanted(rate::wanted())
            .fix(format!(
                "give the rate at which it was filmed, for slow motion above all: a given rate is believed (--fps {told:.0} if it is \
                 that of the file)"
            )));
    }
    // camera axes in the world: a rotation about x that makes y vertical
    let [_, cosine, sine] = fall.down.map(|x| -x);
    let rotation = [[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]];
    let start = times(&rotation, fall.start).map(|x| metres * x);
    let ground = match lowest {
        Some(height) => start[1] + metres * height,
        None => start[1] + metres * FAR_BELOW,
    };
    let from = [0.0, -ground, 0.0];
    clip.cameras[0].c2w = std::array::from_fn(|i| [rotation[i][0], rotation[i][1], rotation[i][2], from[i]]);
    clip.flight = Some(Flight {
        centre: [start[0], start[1] - ground, start[2]],
        velocity: times(&rotation, fall.velocity).map(|v| metres * v),
        velocity_covariance: fall.velocity_covariance(&rotation, metres),
        velocity_with_distance: fall.velocity_with_distance(&rotation, metres),
        gravity,
        frames: fall.frames,
        distance: metres,
        diameter,
        deviation,
        scales_world: true,
        pitch: fall.pitch_spread(&rotation, metres),
    });
    let mut say = |line: String| clip.assumptions.push(line);
    say(format!(
        "camera: stands still, {degrees:.1}° along the longer side ({source}), no distortion, upright, looks down by {:.0}° ({})",
        (-fall.down[2]).asin().to_degrees(),
        if settings.elevation.is_some() { "as given" } else { "from the fall; give --elevation if it is known" }
    ));
    say(format!(
        "scale: the object is {metres:.3} m away (± {:.0} %), as it falls freely in the first {} frames with {strength} m/s²",
        100.0 * deviation,
        fall.frames
    ));
    say(format!("size: the object is {} across", rate::length(diameter)));
    if let Some(warning) = warning {
        say(warning);
    }
    say(match lowest {
        Some(_) => format!("ground: {:.3} m below the camera, where the fall ends", -ground),
        None => "ground: none is seen; the object falls to the end of the film".to_owned(),
    });
    say("shape: as deep as it is wide, part by part".to_owned());
    let mut story = story::completed(film.story, &clip, fall.frames);
    if let Some(contact) = story.contact {
        let shown = bounces::Shown { seconds: &film.times, depth: metres, turn: rotation };
        let found = bounces::of(&clip.cameras[0], &story.flights, contact, down, &shown);
        clip.assumptions.extend(found.as_ref().map(|bounces| match settings.contact {
            ContactModel::Auto => bounces.said(),
            ContactModel::Resolved => format!("{}, but it is simulated as asked for", bounces.said()),
        }));
        story.bounces = found;
    }
    clip.story = Some(Arc::new(story));
    Ok(clip)
}

/// Relative deviation between the acceleration in the picture of all flights and that of the first, from the depth at which they are.
const DEPARTS: f64 = 0.05;

/// Relative deviation of the metres that no fit shows: rows that are read one after the other, distortion, a camera
/// that is rolled.
const UNMODELLED: f64 = 0.08;

/// The same of a single flight: a few pictures whose blur and mattes err alike.
const SINGLE: f64 = 0.15;

/// Relative deviation of the scale by a single flight up to which it counts beside that of all flights.
const BELIEVED: f64 = 0.3;

/// Minimum difference of coverage that counts.
const DIFFERENT: f32 = 0.1;

/// Adds parts in the background's hue to the object in the ballistic frames; in all later frames, where they may be
/// its shadow, their weight becomes 0. Returns whether there are any.
fn complete(frames: &mut [Frame], hueless: Vec<Frame>, flight: usize) -> bool {
    let mut any = false;
    for (k, (frame, whole)) in frames.iter_mut().zip(hueless).enumerate() {
        azip!((weight in &mut frame.weight, a in &frame.alpha, b in &whole.alpha) {
            if (a - b).abs() > DIFFERENT {
                any = true;
                *weight = 0.0;
            }
        });
        if k < flight {
            *frame = whole;
        }
    }
    any
}

/// Height of the ground relative to the start if contact is never seen, as a share of the distance.
const FAR_BELOW: f64 = -2.0;
