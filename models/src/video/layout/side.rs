//! `clip.toml`: supplies what a layout leaves open about a clip.

use std::fs;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde::Deserialize;

use super::Format;
use crate::nearest::suggestion;
use crate::text;
use crate::vector::dot;

/// Name of the side file.
pub(super) const NAME: &str = "clip.toml";
/// Maximum size of the side file \[bytes\].
const MAX_BYTES: u64 = 1 << 20;

/// The side file as written.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct Written {
    layout: Option<Format>,
    up: Option<Direction>,
    metres_per_unit: Option<f64>,
    origin: Option<[f64; 3]>,
    frames_per_s: Option<f64>,
    duration_s: Option<f64>,
    imagined: Option<Vec<i64>>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Direction {
    Name(String),
    Vector([f64; 3]),
}

/// The checked contents of the side file; empty if there is none.
#[derive(Default)]
pub(super) struct Side {
    /// The layout to read, where the folder matches several.
    pub layout: Option<Format>,
    /// Unit vector pointing up, in the layout's coordinates.
    pub up: Option<[f64; 3]>,
    /// Length of the layout's unit \[m\].
    pub metres_per_unit: Option<f64>,
    /// The point, in the layout's coordinates, that becomes the origin.
    pub origin: Option<[f64; 3]>,
    /// Frame rate \[1/s\].
    pub frames_per_s: Option<f64>,
    /// Time from the first frame to the last, or the duration that normalised times 0…1 refer to \[s\].
    pub duration_s: Option<f64>,
    /// Numbers of the cameras whose images were synthesized.
    pub imagined: Vec<i64>,
}

impl Side {
    /// Reads the side file of a clip's folder, if there is one.
    pub fn read(root: &Path) -> Result<Side> {
        let path = root.join(NAME);
        if fs::symlink_metadata(&path).is_err() {
            return Ok(Side::default());
        }
        let unusable = |found: String, wanted: &str, fix: &str| {
            Error::new(ErrorKind::Input, "the clip's side file cannot be used")
                .at(path.display())
                .found(found)
                .wanted(wanted)
                .fix(fix)
        };
        let fix = "make it a readable text file of a few lines, or remove it";
        let text = text::read(&path, "the clip's side file", fix, MAX_BYTES)?;
        let keys = "layout, up, metres_per_unit, origin, frames_per_s, duration_s, imagined";
        let written: Written = toml::from_str(&text).map_err(|e| {
            let fix = suggestion(&e.to_string()).unwrap_or_else(|| "correct it, or leave it out".into());
            unusable(e.to_string().trim().to_owned(), keys, &fix)
        })?;
        let up = match &written.up {
            None => None,
            Some(direction) => Some(unit(direction).ok_or_else(|| {
                let found = match direction {
                    Direction::Name(name) => format!("up = {name:?}"),
                    Direction::Vector(v) => format!("up = {v:?}"),
                };
                unusable(found, "x, y, z, -x, -y, -z, or a vector [x, y, z] that is not zero", "correct up")
            })?),
        };
        let origin = written.origin;
        if let Some(point) = origin
            && !point.iter().all(|x| x.is_finite())
        {
            return Err(unusable(format!("origin = {point:?}"), "three finite numbers", "correct origin"));
        }
        for (name, value, most) in [
            ("metres_per_unit", written.metres_per_unit, 1e6),
            ("frames_per_s", written.frames_per_s, 1e6),
            ("duration_s", written.duration_s, 1e6),
        ] {
            if let Some(value) = value
                && !(value > 1e-6 && value <= most)
            {
                let wanted = format!("a number above 0.000001, at most {most}");
                return Err(unusable(format!("{name} = {value}"), &wanted, &format!("correct {name}")));
            }
        }
        if written.frames_per_s.is_some() && written.duration_s.is_some() {
            let wanted = "one of the two";
            return Err(unusable("both frames_per_s and duration_s".to_owned(), wanted, "leave one of them out"));
        }
        let Written { layout, metres_per_unit, frames_per_s, duration_s, imagined, .. } = written;
        let imagined = imagined.unwrap_or_default();
        Ok(Side { layout, up, metres_per_unit, origin, frames_per_s, duration_s, imagined })
    }
}

fn unit(direction: &Direction) -> Option<[f64; 3]> {
    let v = match direction {
        Direction::Name(name) => {
            let (sign, axis) = name.strip_prefix('-').map_or((1.0, name.as_str()), |axis| (-1.0, axis));
            let at = ["x", "y", "z"].into_iter().position(|known| known == axis)?;
            let mut v = [0.0; 3];
            v[at] = sign;
            v
        }
        Direction::Vector(v) => *v,
    };
    let length = dot(v, v).sqrt();
    (length > 1e-9 && length.is_finite()).then(|| v.map(|x| x / length))
}
