//! Files of boxes, as detectors leave them.
//!
//! JSON in one of these forms; numbers are pixels of the film, or shares of its sides where none exceeds 1:
//!
//! | form | entry |
//! |---|---|
//! | a list, one entry a frame | `[left, top, right, bottom]`, or `null` |
//! | the same | `{"boxes": [[left, top, right, bottom], …], "scores": [0.9, …]}`: the best |
//! | a list of detections | `{"image_id": 7, "bbox": [left, top, width, height], "score": 0.9}` (COCO): the best of each frame |
//! | the same | `{"frame": 7, "box": [left, top, right, bottom]}`, or with `xmin`, `ymin`, `xmax`, `ymax` |
//! | an object | `{"width": 640, "height": 480, "boxes": …}`: a list as above, in pixels of pictures of this size |
//!
//! A list of as many entries as frames are used is about these; a longer one is about the film from its frame 0 on.

use gradreel::{Error, ErrorKind, Result};
use serde_json::{Map, Value};

use crate::views::ImageBox;

/// Largest number of entries.
const MOST_ENTRIES: usize = 1 << 20;

/// Names of a frame's number.
const FRAME: [&str; 4] = ["image_id", "frame", "frame_id", "frame_number"];

/// Names of a detection's score.
const SCORE: [&str; 3] = ["score", "confidence", "conf"];

/// Names of corners.
const CORNERS: [&str; 4] = ["box", "xyxy", "bounds", "bounding_box"];

/// A box with its score.
type Scored = ([f64; 4], f64);

/// The box of each of these frames of a film with pictures of `[width, height]` pixels, if the file has one.
///
/// # Errors
/// [`ErrorKind::Input`] for text of another form.
pub(super) fn read(text: &str, frames: &[i64], size: [usize; 2]) -> Result<Vec<Option<ImageBox>>> {
    let value: Value = serde_json::from_str(text).map_err(|e| refused(&format!("no JSON: {e}")))?;
    let (list, size) = match &value {
        Value::Array(list) => (list, size.map(|side| side as f64)),
        Value::Object(whole) => {
            let side = |name: &str, usual: usize| match whole.get(name) {
                None => Ok(usual as f64),
                Some(side) => {
                    side.as_f64().filter(|side| *side > 0.0).ok_or_else(|| refused(&format!("{name}: {side}")))
                }
            };
            let list = ["boxes", "detections", "annotations"].iter().find_map(|name| whole.get(*name)?.as_array());
            let list = list.ok_or_else(|| refused("an object without a list of `boxes`"))?;
            (list, [side("width", size[0])?, side("height", size[1])?])
        }
        other => return Err(refused(&other.to_string().chars().take(60).collect::<String>())),
    };
    if list.len() > MOST_ENTRIES {
        return Err(refused(&format!("{} entries", list.len())));
    }
    let mut best: Vec<Option<Scored>> = vec![None; frames.len()];
    for (place, entry) in list.iter().enumerate() {
        let (number, found) = of_entry(entry).map_err(|e| e.within(format!("entry {place}")))?;
        let index = match number {
            Some(number) => frames.iter().position(|frame| *frame == number),
            None if list.len() == frames.len() => Some(place),
            None => frames.iter().position(|frame| *frame == place as i64),
        };
        let Some(index) = index else { continue };
        for (corners, score) in found {
            if best[index].is_none_or(|(_, other)| score > other) {
                best[index] = Some((corners, score));
            }
        }
    }
    let shares = best.iter().flatten().all(|(corners, _)| corners.iter().all(|x| x.abs() <= 1.0));
    let unit = if shares { [1.0; 2] } else { size };
    let boxed = |found: Option<Scored>| {
        found.map(|([left, top, right, bottom], _)| ImageBox {
            low: [left / unit[0], top / unit[1]],
            high: [right / unit[0], bottom / unit[1]],
        })
    };
    Ok(best.into_iter().map(boxed).collect())
}

/// The number of an entry's frame, if it says one, and its boxes.
fn of_entry(entry: &Value) -> Result<(Option<i64>, Vec<Scored>)> {
    match entry {
        Value::Null => Ok((None, vec![])),
        Value::Array(_) => Ok((None, vec![(corners(entry)?, 1.0)])),
        Value::Object(fields) => {
            let number = FRAME.iter().find_map(|name| fields.get(*name)).map(number_of).transpose()?;
            let score = SCORE.iter().find_map(|name| fields.get(*name)?.as_f64()).unwrap_or(1.0);
            Ok((number, of_fields(fields, score)?))
        }
        other => Err(refused(&other.to_string())),
    }
}

fn of_fields(fields: &Map<String, Value>, score: f64) -> Result<Vec<Scored>> {
    if let Some(found) = fields.get("bbox") {
        let [left, top, width, height] = four(found)?;
        return Ok(vec![(ordered([left, top, left + width, top + height])?, score)]);
    }
    if let Some(found) = CORNERS.iter().find_map(|name| fields.get(*name)) {
        return if found.is_null() { Ok(vec![]) } else { Ok(vec![(corners(found)?, score)]) };
    }
    let sides = ["xmin", "ymin", "xmax", "ymax"].map(|name| fields.get(name).and_then(Value::as_f64));
    if let [Some(left), Some(top), Some(right), Some(bottom)] = sides {
        return Ok(vec![(ordered([left, top, right, bottom])?, score)]);
    }
    if let Some(Value::Array(all)) = fields.get("boxes") {
        let scores = fields.get("scores").and_then(Value::as_array);
        let score = |place: usize| scores.and_then(|scores| scores.get(place)?.as_f64()).unwrap_or(score);
        return all.iter().enumerate().map(|(place, found)| Ok((corners(found)?, score(place)))).collect();
    }
    Err(refused(&format!("an entry with {:?}", fields.keys().collect::<Vec<_>>())))
}

/// A frame's number: a whole number, or text that ends in one before any ending (`frame_0007.png`).
fn number_of(value: &Value) -> Result<i64> {
    let of_text = |text: &str| {
        let stem = text.split('.').next().unwrap_or_default();
        let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        stem[digits..].parse().ok()
    };
    let number = value.as_i64().or_else(|| value.as_str().and_then(of_text));
    number.ok_or_else(|| refused(&format!("a frame called {value}")))
}

fn corners(value: &Value) -> Result<[f64; 4]> {
    ordered(four(value)?)
}

fn four(value: &Value) -> Result<[f64; 4]> {
    let numbers = value.as_array().map(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
    let numbers = numbers.flatten().and_then(|numbers| <[f64; 4]>::try_from(numbers).ok());
    numbers.ok_or_else(|| refused(&value.to_string().chars().take(60).collect::<String>()))
}

fn ordered(corners: [f64; 4]) -> Result<[f64; 4]> {
    let [left, top, right, bottom] = corners;
    match left < right && top < bottom && corners.iter().all(|x| x.is_finite()) {
        true => Ok(corners),
        false => Err(refused(&format!("{corners:?}: nothing between its sides"))),
    }
}

fn refused(found: &str) -> Error {
    Error::new(ErrorKind::Input, "this is no file of boxes")
        .found(found)
        .wanted(
            "JSON: a list of [left, top, right, bottom] or null, one for each frame, or a list of {\"image_id\": frame, \"bbox\": [left, \
             top, width, height], \"score\": number}",
        )
        .fix("see docs/guide/published.md for the forms that are read, or leave --boxes out to take the boxes of the masks")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: [i64; 3] = [4, 5, 6];

    fn of(text: &str) -> Vec<Option<[f64; 4]>> {
        let found = read(text, &FRAMES, [100, 50]).unwrap();
        found.into_iter().map(|b| b.map(|b| [b.low[0], b.low[1], b.high[0], b.high[1]])).collect()
    }

    #[test]
    fn forms_that_detectors_leave() {
        let one = Some([0.1, 0.2, 0.3, 0.4]);
        // pixels of the film, one entry for each frame in use
        assert_eq!(of("[[10, 10, 30, 20], null, [10, 10, 30, 20]]"), [one, None, one]);
        // the whole film from frame 0 on, in shares
        let whole = "[null, null, null, null, [0.1, 0.2, 0.3, 0.4], null, null, [0.1, 0.2, 0.3, 0.4]]";
        assert_eq!(of(whole), [one, None, None]);
        // COCO: left, top, width, height; the best of a frame counts
        let coco = r#"[{"image_id": 5, "bbox": [10, 10, 20, 10], "score": 0.9},
                       {"image_id": 5, "bbox": [0, 0, 5, 5], "score": 0.2},
                       {"image_id": 90, "bbox": [0, 0, 5, 5], "score": 0.9}]"#;
        assert_eq!(of(coco), [None, one, None]);
        let torch =
            r#"[{"boxes": [[0, 0, 5, 5], [10, 10, 30, 20]], "scores": [0.1, 0.8]}, {"boxes": []}, {"boxes": []}]"#;
        assert_eq!(of(torch), [one, None, None]);
        let named = r#"{"width": 200, "height": 100, "boxes": [{"frame": "shot_0006.png", "box": [20, 20, 60, 40]}]}"#;
        assert_eq!(of(named), [None, None, one]);
        let table = r#"[{"frame": 4, "xmin": 10, "ymin": 10, "xmax": 30, "ymax": 20, "confidence": 1}]"#;
        assert_eq!(of(table), [one, None, None]);
    }

    #[test]
    fn other_text_is_refused() {
        for text in [
            "",
            "boxes",
            "3",
            "{}",
            "[[1, 2, 3]]",
            "[[1, 2, 1, 4]]",
            "[[4, 2, 1, 4]]",
            r#"[{"image_id": 4}]"#,
            r#"[{"image_id": "x", "bbox": [1, 2, 3, 4]}]"#,
            r#"[{"image_id": 4, "bbox": [1, 2, 0, 4]}]"#,
            r#"{"width": 0, "boxes": []}"#,
        ] {
            let error = read(text, &FRAMES, [100, 50]).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Input, "{text}");
            assert!(error.to_string().contains("fix: "), "{error}");
        }
    }
}
