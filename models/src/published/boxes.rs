//! The object's box in every picture of a film.

use gradreel::{Error, ErrorKind, Result};

use super::box_file;
use crate::video::{Clip, Frame};
use crate::views::ImageBox;

/// Frames that an error names.
const MOST_NAMED: usize = 12;

/// Boxes of the film's masks, one for each frame.
///
/// # Errors
/// [`ErrorKind::Input`] naming the frames that show no object.
pub(crate) fn of_masks(film: &Clip) -> Result<Vec<ImageBox>> {
    let found = film.frames[0].iter().map(of_frame).collect();
    complete(found, film, "the masks", "give masks that show it (--masks), boxes (--boxes), or fewer frames (--frames)")
}

/// The box of the pixels of a frame that are at least half covered.
pub(crate) fn of_frame(frame: &Frame) -> Option<ImageBox> {
    let coverage: Vec<f32> = frame.alpha.iter().copied().collect();
    ImageBox::of_coverage(&coverage, frame.alpha.dim().1)
}

/// Boxes as a detector leaves them, from the text of its file (see [`box_file`]); `name` is that of the file.
///
/// # Errors
/// [`ErrorKind::Input`] for text of another form, naming the frames without a box or whose box holds nothing of the object.
pub(crate) fn of_text(text: &str, name: &str, film: &Clip) -> Result<Vec<ImageBox>> {
    let camera = &film.cameras[0];
    let found = box_file::read(text, &film.frame_numbers, [camera.width, camera.height]).map_err(|e| e.at(name))?;
    let fix = "let the detector find it there, add the box by hand, or use fewer frames (--first-frame, --frames)";
    let boxes = complete(found, film, name, fix)?;
    let empty = boxes.iter().zip(&film.frames[0]).map(|(bounds, frame)| !holds(frame, bounds));
    match named(empty, film) {
        None => Ok(boxes),
        Some(frames) => Err(Error::new(ErrorKind::Input, "boxes hold nothing of the object")
            .at(name)
            .found(format!("no pixel of its mask in the boxes of frames {frames}"))
            .wanted("boxes in pixels of the film, or in shares of its sides, around what moves")
            .fix("say the size of the pictures that the boxes belong to (\"width\", \"height\"), or correct them")),
    }
}

/// All boxes, or an error that names the frames without one.
fn complete(found: Vec<Option<ImageBox>>, film: &Clip, place: &str, fix: &str) -> Result<Vec<ImageBox>> {
    match named(found.iter().map(Option::is_none), film) {
        None => Ok(found.into_iter().flatten().collect()),
        Some(frames) => Err(Error::new(ErrorKind::Input, "the object has no box in some frames")
            .at(place)
            .found(format!("none in frames {frames} of {} to {}", film.frame_numbers[0], last(film)))
            .wanted("a box in every frame that is used")
            .fix(fix)),
    }
}

/// The numbers of the frames that are marked, if any.
fn named(marked: impl Iterator<Item = bool>, film: &Clip) -> Option<String> {
    let numbers = marked.zip(&film.frame_numbers).filter(|(marked, _)| *marked).map(|(_, number)| number.to_string());
    let numbers: Vec<String> = numbers.collect();
    let more = if numbers.len() > MOST_NAMED { ", …" } else { "" };
    (!numbers.is_empty()).then(|| numbers[..numbers.len().min(MOST_NAMED)].join(", ") + more)
}

fn last(film: &Clip) -> i64 {
    film.frame_numbers[film.frame_count() - 1]
}

/// Whether a pixel in the box belongs to the object.
fn holds(frame: &Frame, bounds: &ImageBox) -> bool {
    let (height, width) = frame.alpha.dim();
    let inside = |at: usize, sides: usize, axis: usize| {
        let share = (at as f64 + 0.5) / sides as f64;
        (bounds.low[axis]..=bounds.high[axis]).contains(&share)
    };
    let mut pixels = frame.alpha.indexed_iter();
    pixels.any(|((row, column), alpha)| *alpha >= 0.5 && inside(column, width, 0) && inside(row, height, 1))
}
