//! Wavefront OBJ: `v x y z [r g b]`, `vt u v`, `vn x y z`, `f corner/texture/normal …`, `mtllib` and `usemtl`; other
//! statements are skipped. Indices count from 1, or backward from the last element before the line.

use gradreel::{Error, Result};

use super::wavefront::Line;
use super::{damaged, text, wavefront};

/// The content of a line.
pub(crate) enum Item<'a> {
    /// A vertex, with its colour if the file has one.
    Place([f64; 3], Option<[f32; 3]>),
    /// Texture coordinates, v upwards.
    Uv([f32; 2]),
    Normal([f32; 3]),
    /// At least three corners.
    Face(&'a [Corner]),
    /// One or several material files.
    Libraries(&'a str),
    /// The material of the faces that follow; without a name, none.
    Material(&'a str),
}

/// A corner of a face: indices from 0, in the order of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    pub place: u32,
    pub uv: Option<u32>,
    /// `None` also for an index without a normal in the file: the face is flat-shaded.
    pub normal: Option<u32>,
}

/// Reads a file line by line. Without `looks`, texture coordinates, normals and materials are skipped.
///
/// # Errors
/// [`ErrorKind::Input`](gradreel::ErrorKind::Input) for a file that is not text, and for an invalid line; errors of
/// `take`.
pub(crate) fn read(bytes: &[u8], looks: bool, mut take: impl FnMut(Item<'_>) -> Result<()>) -> Result<()> {
    let text = text::decoded(bytes)?;
    let mut counts = Counts { looks, places: 0, uvs: 0, normals: 0 };
    let mut corners = Vec::new();
    for line in wavefront::lines(&text) {
        let refused = |wanted: &str| refused(&line, wanted);
        let values = line.values();
        take(match line.word() {
            "v" => {
                let numbers: Vec<f64> = values.split_whitespace().map_while(|word| word.parse().ok()).collect();
                let place = *numbers.first_chunk().ok_or_else(|| refused("v x y z, or v x y z r g b"))?;
                counts.places += 1;
                Item::Place(place, numbers.get(3..6).map(|rgb| [0, 1, 2].map(|c| rgb[c] as f32)))
            }
            "f" | "fo" => {
                corners.clear();
                for word in values.split_whitespace() {
                    corners.push(counts.corner(word).ok_or_else(|| refused(&counts.wanted()))?);
                }
                if corners.len() < 3 {
                    return Err(refused(&counts.wanted()));
                }
                Item::Face(&corners)
            }
            "vt" if looks => {
                counts.uvs += 1;
                // In a one-dimensional texture coordinate, v is omitted.
                let both = numbers(values).or_else(|| numbers::<1>(values).map(|[u]| [u, 0.0]));
                Item::Uv(both.ok_or_else(|| refused("vt u v"))?)
            }
            "vn" if looks => {
                counts.normals += 1;
                Item::Normal(numbers(values).ok_or_else(|| refused("vn x y z"))?)
            }
            "mtllib" if looks => Item::Libraries(line.name()),
            "usemtl" if looks => Item::Material(line.name()),
            _ => continue,
        })?;
    }
    Ok(())
}

fn refused(line: &Line<'_>, wanted: &str) -> Error {
    damaged("a line of the mesh cannot be read").at(format!("line {}", line.number)).found(line.shown()).wanted(wanted)
}

/// Numbers of elements before a line.
struct Counts {
    looks: bool,
    places: u32,
    uvs: u32,
    normals: u32,
}

impl Counts {
    /// Parses a corner of a face: `1`, `1/2`, `1//3` or `1/2/3`.
    fn corner(&self, word: &str) -> Option<Corner> {
        let mut parts = word.split('/');
        let place = index(parts.next()?, self.places)?;
        let mut corner = Corner { place, uv: None, normal: None };
        if self.looks {
            if let Some(uv) = parts.next().filter(|uv| !uv.is_empty()) {
                corner.uv = Some(index(uv, self.uvs)?);
            }
            if let Some(normal) = parts.next().filter(|normal| !normal.is_empty()) {
                let _number: i64 = normal.parse().ok()?;
                corner.normal = index(normal, self.normals);
            }
            return parts.next().is_none().then_some(corner);
        }
        Some(corner)
    }

    fn wanted(&self) -> String {
        let uvs = if self.looks { format!(" and {} texture places", self.uvs) } else { String::new() };
        format!("f and at least three of the {} corners{uvs} before it", self.places)
    }
}

/// The zero-based index, from one that counts from 1, or backward from the last of `count`.
fn index(word: &str, count: u32) -> Option<u32> {
    let index: i64 = word.parse().ok()?;
    let count = i64::from(count);
    let index = if index < 0 { count.checked_add(index)? } else { index - 1 };
    (0..count).contains(&index).then_some(index as u32)
}

/// The first numbers of a text.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let mut words = text.split_whitespace();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = words.next()?.parse().ok()?;
    }
    Some(numbers)
}
