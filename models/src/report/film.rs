//! The page of a film that was looked at: what was understood of it, drawn into its pictures.

use std::fmt::Write as _;

use gradreel::Result;

use super::animation::{Picture, gif};
use super::base64;
use super::markup::escape;
use super::page::{Drawing, Headline, Page};
use super::plot::{Plot, Series};
use super::png_file::png;
use super::quantity::readable;
use crate::physics::NINETY;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Clip, Doing, Flight, Image, Snapshot, Story, WARNING};

/// The page; it is written last.
pub const PAGE: &str = "index.html";

/// Pictures per second of the animation.
const RATE: f64 = 4.0;

/// Colour of the mask in the pictures, and its share.
const TINT: ([f64; 3], f64) = ([47.0, 111.0, 208.0], 0.5);

/// Colours of the phases in drawings.
const COLOURS: [(Doing, &str); 4] =
    [(Doing::Contact, "#d9733a"), (Doing::Held, "#8a8f98"), (Doing::Flight, "#3b7dd8"), (Doing::Rest, "#2f9e77")];

/// Number of phases in the table.
const MOST_PHASES: usize = 9;

/// Number of points of a drawn curve.
const POINTS: usize = 48;

/// What the axes of the world are called.
pub(crate) const AXES: [&str; 3] = ["to the right", "up", "towards the camera"];

/// The option that replaces an assumption, if there is one.
pub(crate) fn option_of(assumption: &str) -> Option<&'static str> {
    let options = [
        ("time", "--fps"),
        ("camera", "--field-of-view, --elevation"),
        ("scale", "--fps"),
        ("ground", "--ground"),
        ("shape", "--imagine, --views"),
        ("the object is told", "--masks, --background, --matting"),
        ("objects", "--object"),
        ("frames", "--first-frame, --frames"),
        ("contact", "--contact"),
    ];
    options.into_iter().find(|(start, _)| assumption.starts_with(start)).map(|(_, option)| option)
}

/// 90 % interval of a positive length whose relative standard deviation is known.
pub(crate) fn lengths(value: f64, deviation: f64) -> [f64; 2] {
    [value * (-NINETY * deviation).exp(), value * (NINETY * deviation).exp()]
}

/// Writes the page of a clip made from the film at `path`.
///
/// # Errors
/// Errors of encoding and writing.
pub fn publish(folder: &RunFolder, clip: &Clip, path: &str, settings: &str) -> Result<()> {
    let nothing = Story::default();
    let story = clip.story.as_deref().unwrap_or(&nothing);
    let masked: Vec<Picture> = story.snapshots.iter().map(|snapshot| masked(snapshot, clip)).collect();
    let animation = if masked.is_empty() { None } else { Some(gif(&masked, RATE)?) };
    let page = Page {
        title: &clip.name,
        subtitle: subtitle(clip, story, path),
        headlines: bounced(story)
            .into_iter()
            .chain(clip.flight.iter().flat_map(|flight| headlines(clip, flight)))
            .collect(),
        animation: animation.as_deref(),
        animation_caption: "Pictures of the film; what is taken for the object is blue.".into(),
        drawings: drawing(clip, story)?.into_iter().collect(),
        scene: None,
        plots: height(clip, story).into_iter().collect(),
        notes: notes(clip, story),
        timings: vec![],
        config_toml: settings.to_owned(),
        files: vec![],
    };
    folder.write(PAGE, page.html().as_bytes())
}

fn subtitle(clip: &Clip, story: &Story, path: &str) -> String {
    let numbers = (clip.frame_numbers.first().copied().unwrap_or(0), clip.frame_numbers.last().copied().unwrap_or(0));
    format!("{path}: frames {} to {} of {}, {:.4} per second", numbers.0, numbers.1, story.count, 1.0 / clip.frame_dt())
}

fn headlines(clip: &Clip, flight: &Flight) -> Vec<Headline> {
    let length = |symbol: &str, label: &str, value: f64| {
        let [low, high] = lengths(value, flight.deviation).map(|end| readable(end, "m"));
        Headline {
            symbol: symbol.into(),
            label: label.into(),
            readable: readable(value, "m"),
            exact: format!("± {:.1} %", 100.0 * flight.deviation),
            note: format!("90 %: {low} to {high}"),
        }
    };
    let deviations = flight.velocity_deviation();
    let velocity = |axis: usize| {
        let [value, deviation] = [flight.velocity[axis], deviations[axis]];
        let [low, high] = [-1.0, 1.0].map(|sign| readable(value + sign * NINETY * deviation, "m/s"));
        Headline {
            symbol: ["v_x", "v_y", "v_z"][axis].into(),
            label: format!("Velocity {}", AXES[axis]),
            readable: readable(value, "m/s"),
            exact: format!("± {}", readable(deviation, "m/s")),
            note: format!("in frame {}; 90 %: {low} to {high}", clip.frame_numbers[0]),
        }
    };
    let size = length("d", "Diameter", flight.diameter);
    let distance = length("z", "Distance", flight.distance);
    [size, distance].into_iter().chain((0..3).map(velocity)).collect()
}

/// The restitution, where the contact is shorter than a frame.
fn bounced(story: &Story) -> Option<Headline> {
    let bounces = story.bounces.as_ref()?;
    let [low, high] = bounces.restitution.interval_90();
    Some(Headline {
        symbol: "e".into(),
        label: "Restitution".into(),
        readable: format!("{:.2}", bounces.restitution.value),
        exact: format!("± {:.3}", bounces.restitution.deviation),
        note: format!("by {} hits; 90 %: {low:.2} to {high:.2}", bounces.hits.len()),
    })
}

/// A picture with the object tinted; pictures that the clip does not use are as they are.
fn masked(snapshot: &Snapshot, clip: &Clip) -> Picture {
    let Image { width, height, pixels, .. } = &snapshot.image;
    let alpha = alpha(clip, snapshot.number);
    let rgb = pixels.iter().enumerate().flat_map(|(i, pixel)| {
        let inside = alpha.map_or(0.0, |alpha| {
            let (rows, columns) = alpha.dim();
            f64::from(alpha[[(i / width) * rows / height, (i % width) * columns / width]])
        });
        let share = TINT.1 * inside.clamp(0.0, 1.0);
        [0, 1, 2].map(|c| ((1.0 - share) * f64::from(pixel[c]) + share * TINT.0[c]).round() as u8)
    });
    Picture { width: *width, height: *height, rgb: rgb.collect() }
}

/// The object's coverage in the picture of this number, if the clip uses it.
fn alpha(clip: &Clip, number: usize) -> Option<&ndarray::Array2<f32>> {
    let index = clip.frame_numbers.iter().position(|other| *other == number as i64)?;
    clip.frames.first()?.get(index).map(|frame| &frame.alpha)
}

/// The object of all pictures in one.
fn composed(story: &Story, clip: &Clip) -> Option<Picture> {
    let mut pictures = story.snapshots.iter();
    let mut whole = pictures.next()?.image.clone();
    for Snapshot { number, image, .. } in pictures {
        let Some(alpha) = alpha(clip, *number) else { continue };
        let (rows, columns) = alpha.dim();
        if (image.width, image.height) != (whole.width, whole.height) {
            continue;
        }
        for (i, (to, from)) in whole.pixels.iter_mut().zip(&image.pixels).enumerate() {
            let (x, y) = (i % image.width, i / image.width);
            if alpha[[y * rows / image.height, x * columns / image.width]] > 0.5 {
                *to = *from;
            }
        }
    }
    let rgb = whole.pixels.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    Some(Picture { width: whole.width, height: whole.height, rgb })
}

/// The track, its parabolas and the ground in the picture.
pub(super) fn drawing(clip: &Clip, story: &Story) -> Result<Option<Drawing>> {
    let (width, height) = story.size;
    let Some(picture) = composed(story, clip) else { return Ok(None) };
    if width == 0 || height == 0 {
        return Ok(None);
    }
    let unit = width.max(height) as f64 / 480.0;
    let mut svg = format!(
        "<svg class=\"drawing\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"Track of the object\" \
         xmlns=\"http://www.w3.org/2000/svg\">\n<image width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
         href=\"data:image/png;base64,{}\"/>\n",
        base64::encode(&png(&picture)?)
    );
    let mut put = |element: String| writeln!(svg, "{element}").expect("a string accepts every write");
    if let Some([from, to]) = ground(clip, story) {
        put(format!(
            "<path class=\"ground\" d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#c23d69\" stroke-width=\"{:.2}\" \
             stroke-dasharray=\"{:.1} {:.1}\"/>",
            from[0],
            from[1],
            to[0],
            to[1],
            2.0 * unit,
            8.0 * unit,
            5.0 * unit
        ));
    }
    for curve in &story.curves {
        let at =
            |k: usize| curve.at(curve.seconds[0] + (curve.seconds[1] - curve.seconds[0]) * k as f64 / POINTS as f64);
        let points: Vec<String> = (0..=POINTS)
            .map(at)
            .filter(|p| p.iter().all(|x| x.is_finite()))
            .map(|p| format!("{:.1},{:.1}", p[0], p[1]))
            .collect();
        put(format!(
            "<polyline class=\"curve\" points=\"{}\" fill=\"none\" stroke=\"#ffffff\" stroke-width=\"{:.2}\"/>",
            points.join(" "),
            1.5 * unit
        ));
    }
    for sight in &story.track {
        // a contact lies within the last frame of one flight and the first of the next
        let doing = |doing: Doing| story.phases.iter().any(|p| p.doing == doing && p.frames.contains(&sight.number));
        let colour = COLOURS.iter().find(|(what, _)| doing(*what));
        put(format!(
            "<circle class=\"seen\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{:.2}\" fill=\"{}\" stroke=\"#ffffff\" stroke-width=\"{:.2}\">\
             <title>frame {}, {:.3} s</title></circle>",
            sight.middle[0],
            sight.middle[1],
            3.0 * unit,
            colour.map_or("#000000", |(_, colour)| colour),
            0.7 * unit,
            sight.number,
            sight.seconds
        ));
    }
    svg.push_str("</svg>\n");
    let caption = "The object in several pictures at once. Dots: its centre in each frame (grey held, blue in free flight, orange in \
                   contact, green at rest, black without a phase). White: the parabolas of the free flights. Dashed: the ground \
                   where the object is.";
    Ok(Some(Drawing { heading: "Track".into(), svg, caption: escape(caption) }))
}

/// Depth of the object at the end of its first flight, in units of that at its beginning.
fn depth_at_hit(flight: &Flight, clip: &Clip) -> f64 {
    let seconds = flight.frames as f64 * clip.frame_dt();
    (1.0 - flight.velocity[2] * seconds / flight.distance).clamp(0.2, 5.0)
}

/// The ground at the object's distance when it hits, as a line across the picture \[pixels\].
fn ground(clip: &Clip, story: &Story) -> Option<[[f64; 2]; 2]> {
    let (flight, camera) = (clip.flight.as_ref()?, clip.cameras.first()?);
    let scale = [story.size.0 as f64 / camera.width as f64, story.size.1 as f64 / camera.height as f64];
    let reach = flight.distance * camera.width as f64 / camera.fx;
    let depth = flight.centre[2] * depth_at_hit(flight, clip);
    let end = |side: f64| {
        let place = camera.project([flight.centre[0] + side * reach, 0.0, depth])?;
        Some([place[0] * scale[0], place[1] * scale[1]])
    };
    Some([end(-1.0)?, end(1.0)?])
}

/// Height above the ground over time.
pub(super) fn height(clip: &Clip, story: &Story) -> Option<Plot> {
    let flight = clip.flight.as_ref()?;
    let camera = clip.cameras.first()?;
    let [from, to] = ground(clip, story)?;
    let metres =
        depth_at_hit(flight, clip) * flight.distance / camera.fy * camera.height as f64 / story.size.1.max(1) as f64;
    let above = |[x, y]: [f64; 2]| {
        let share = (x - from[0]) / (to[0] - from[0]);
        (from[1] + share * (to[1] - from[1]) - y) * metres
    };
    let seen = Series {
        label: "seen".into(),
        points: story.track.iter().map(|sight| (sight.seconds, above(sight.middle))).collect(),
    };
    let points = |curve: &crate::video::Curve| {
        let [from, to] = curve.seconds;
        let curve = curve.clone();
        (0..=POINTS).map(move |i| from + (to - from) * i as f64 / POINTS as f64).map(move |t| (t, curve.at(t)))
    };
    let flights = story.curves.iter().flat_map(points).map(|(t, place)| (t, above(place))).collect();
    let series = vec![seen, Series { label: "parabolas".into(), points: flights }];
    Some(Plot {
        title: "Height of the object's centre above the ground".into(),
        x_label: "time in the film [s]".into(),
        y_label: "height [m]".into(),
        log_y: false,
        series,
        reference: None,
    })
}

fn notes(clip: &Clip, story: &Story) -> Vec<(String, String)> {
    let more = story.phases.len().saturating_sub(MOST_PHASES);
    let more = (more > 0).then(|| ("Further phases".to_owned(), format!("{more}, in `gradreel check --json`")));
    let phases = story.phases.iter().take(MOST_PHASES).map(|phase| {
        let (first, last) = (phase.frames.start(), phase.frames.end());
        let end = |(seconds, deviation): (f64, f64)| format!("{seconds:.3} s ± {deviation:.3} s");
        (
            format!("Phase: {}", phase.doing.name()),
            format!("frames {first} to {last}, from {} to {}", end(phase.begin), end(phase.end)),
        )
    });
    let axes = "x to the right, y up, z towards the camera; the ground is at y = 0, the camera at x = z = 0";
    let assumed = clip.assumptions.iter().map(|line| match line.strip_prefix(WARNING) {
        Some(warning) => ("Warning".to_owned(), warning.to_owned()),
        None => (
            option_of(line).map_or_else(|| "Found".into(), |option| format!("Assumed; {option} replaces it")),
            line.clone(),
        ),
    });
    phases.chain(more).chain([("Axes".to_owned(), axes.to_owned())]).chain(assumed).collect()
}
