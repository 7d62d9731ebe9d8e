//! The chain on the page of its run: a picture or a curve of every stage.

use gradreel::Result;

use super::field::Moving;
use super::{Placing, Stage, State};
use crate::field::temporal::TemporalFit;
use crate::identify::VELOCITY;
use crate::physics::{Law, Map};
use crate::report::animation::Picture;
use crate::report::page::Drawing;
use crate::report::plot::{Plot, Series};
use crate::report::png_file::png;
use crate::report::reconstruction::Beside;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Clip, Frame};
use crate::views::ImageBox;

/// Picture of the boxes.
pub(super) const BOXES: &str = "boxes.png";
/// Sheet of all views.
pub(super) const VIEWS: &str = "views.png";
/// The field beside what it was fitted to.
pub(super) const FIELD: &str = "field.png";

/// Side of a tile at most \[pixels\].
const TILE: usize = 96;

/// Frames in a row of the boxes' picture.
const IN_ROW: usize = 7;

/// Colour of a box.
const BOX: [f32; 3] = [0.85, 0.2, 0.25];

/// The film with its boxes as PNG.
///
/// # Errors
/// What encoding returns.
pub(super) fn boxes(film: &Clip, boxes: &[ImageBox]) -> Result<Vec<u8>> {
    let tile = |(frame, bounds): (&Frame, &ImageBox)| {
        let small = shrunk(frame, 2 * TILE);
        let (height, width) = small.alpha.dim();
        let sides = [width, height];
        let end = |at: [f64; 2]| {
            [0, 1].map(|axis| (at[axis] * sides[axis] as f64).clamp(0.0, sides[axis] as f64 - 1.0) as usize)
        };
        let ([left, top], [right, bottom]) = (end(bounds.low), end(bounds.high));
        let mut rgb = small.rgb;
        let mut put = |y: usize, x: usize| (0..3).for_each(|c| rgb[[y, x, c]] = BOX[c]);
        (left..=right).for_each(|x| [top, bottom].into_iter().for_each(|y| put(y, x)));
        (top..=bottom).for_each(|y| [left, right].into_iter().for_each(|x| put(y, x)));
        Picture::from_unit(width, height, &rgb.iter().copied().collect::<Vec<f32>>())
    };
    let tiles = film.frames[0].iter().zip(boxes).map(tile).collect::<Result<Vec<_>>>()?;
    png(&Picture::grid(IN_ROW, &tiles))
}

/// All views, a row a frame, each after the film's own picture, as PNG.
///
/// # Errors
/// What encoding returns.
pub(super) fn views(film: &Clip, rows: &[Vec<Frame>]) -> Result<Vec<u8>> {
    let mut tiles = Vec::new();
    for (filmed, views) in film.frames[0].iter().zip(rows) {
        for frame in std::iter::once(filmed).chain(views) {
            let small = shrunk(frame, TILE);
            let (height, width) = small.alpha.dim();
            tiles.push(Picture::from_unit(width, height, &small.rgb.iter().copied().collect::<Vec<f32>>())?);
        }
    }
    png(&Picture::grid(rows.first().map_or(1, |row| row.len() + 1), &tiles))
}

/// The field from three sides in three frames, each beside the picture of that camera, as PNG.
///
/// # Errors
/// What rendering and encoding return.
pub(super) fn field(moving: &Moving<'_>, fit: &TemporalFit) -> Result<Vec<u8>> {
    let (cameras, frames) = (moving.rays.cameras(), moving.rays.times.len());
    let mut sides: Vec<usize> =
        [0, cameras / 4 + 1, cameras / 2 + 1].into_iter().filter(|side| *side < cameras).collect();
    sides.dedup();
    let mut shown = vec![0, frames / 2, frames - 1];
    shown.dedup();
    png(&moving.seen(&fit.field, &fit.params, &sides, &shown)?)
}

fn shrunk(frame: &Frame, most: usize) -> Frame {
    let (height, width) = frame.alpha.dim();
    let factor = width.max(height).div_ceil(most).max(1);
    if factor == 1 { frame.clone() } else { frame.scaled(factor) }
}

/// What the chain adds to the report of its run.
///
/// # Errors
/// What reading returns.
pub(crate) fn beside(state: &State, law: &Law, folder: &RunFolder, stages: &[Stage]) -> Result<Beside> {
    let placed = match state.placing {
        Some(Placing::Module) => "placed by the spatial-aware module",
        Some(Placing::Moved) => "made of the centred object and moved to its place",
        None => "as they were filmed",
    };
    let texts = [
        (BOXES, Stage::Boxes, "The box of the object in every frame.".to_owned()),
        (VIEWS, Stage::Views, format!("A row a frame: the film, then its views, {placed}.")),
        (
            FIELD,
            Stage::Field,
            "Three sides, three frames: what the field was fitted to, and beside it the field.".to_owned(),
        ),
    ];
    let mut drawings = Vec::new();
    for (file, stage, caption) in texts.iter().filter(|(file, ..)| folder.has(file)) {
        let heading = capital(&stage.title(stages));
        drawings.push(Drawing::of_png(heading, &folder.read(file)?, caption));
    }
    let files = texts
        .iter()
        .filter(|(file, ..)| folder.has(file))
        .map(|(file, _, caption)| ((*file).to_owned(), caption.clone()));
    let more = [
        ("published.json", "boxes, the field's motion, and every evaluation of the searches"),
        ("temporal_field.safetensors", "the temporal field"),
        ("views/", "the views of every frame, as the model made them"),
    ];
    let more = more
        .iter()
        .filter(|(name, _)| folder.path(name).exists())
        .map(|(name, what)| ((*name).to_owned(), (*what).to_owned()));
    Ok(Beside {
        drawings,
        plots: plots(state, law),
        timings: state.finished.iter().map(|done| (done.stage.name().to_owned(), done.seconds)).collect(),
        files: files.chain(more).collect(),
    })
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn plots(state: &State, law: &Law) -> Vec<Plot> {
    let plot = |title: String, x_label: &str, y_label: &str, log_y: bool, series: Vec<Series>| Plot {
        title,
        x_label: x_label.into(),
        y_label: y_label.into(),
        log_y,
        series,
        reference: None,
    };
    let mut plots = Vec::new();
    if !state.field.is_empty() {
        let points = state.field.iter().map(|(iteration, _, psnr)| (*iteration as f64, *psnr)).collect();
        let series = vec![Series { label: "agreement with the pictures".into(), points }];
        plots.push(plot("Temporal field".into(), "update", "PSNR [dB]", false, series));
    }
    if let Some(motion) = &state.motion {
        let along = |axis: usize, label: &str| Series {
            label: label.into(),
            points: motion.middles.iter().enumerate().map(|(frame, x)| (frame as f64, x[axis])).collect(),
        };
        let lowest = motion.lowest.iter().enumerate().map(|(frame, y)| (frame as f64, *y)).collect();
        let mut series: Vec<Series> = [(0, "x"), (1, "y"), (2, "z")].map(|(axis, name)| along(axis, name)).into();
        series.push(Series { label: "lowest point".into(), points: lowest });
        plots.push(plot("Motion of the field".into(), "frame", "position [m]", false, series));
    }
    let of = |stage: Stage| state.answers.get(&stage).map_or(&[][..], Vec::as_slice);
    let numbered = |stage: Stage, value: &dyn Fn(&super::descent::Answer) -> Option<f64>| -> Vec<(f64, f64)> {
        of(stage).iter().enumerate().filter_map(|(i, answer)| Some((i as f64 + 1.0, value(answer)?))).collect()
    };
    let losses: Vec<Series> = [Stage::Velocity, Stage::Material]
        .into_iter()
        .filter(|stage| !of(*stage).is_empty())
        .map(|stage| Series { label: stage.name().into(), points: numbered(stage, &|answer| answer.loss) })
        .collect();
    if !losses.is_empty() {
        plots.push(plot("Loss".into(), "evaluation", "loss per pixel of object", true, losses));
    }
    if !of(Stage::Velocity).is_empty() {
        let series = (0..3).map(|axis| Series {
            label: VELOCITY[axis].trim_start_matches("velocity_").into(),
            points: numbered(Stage::Velocity, &|answer| Some(answer.unknowns.velocity[axis])),
        });
        plots.push(plot("Initial velocity".into(), "evaluation", "v [m/s]", false, series.collect()));
    }
    for (index, parameter) in law.parameters().iter().enumerate().filter(|_| !of(Stage::Material).is_empty()) {
        let points = numbered(Stage::Material, &|answer| answer.unknowns.parameters.get(index).copied());
        let unit = if parameter.unit == "-" { String::new() } else { format!(" [{}]", parameter.unit) };
        let series = vec![Series { label: Stage::Material.name().into(), points }];
        let (title, y_label) = (capital(&parameter.name.replace('_', " ")), format!("{}{unit}", parameter.symbol));
        plots.push(plot(title, "evaluation", &y_label, parameter.map == Map::Log10, series));
    }
    plots
}
