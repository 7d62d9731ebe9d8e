//! STL: facets without shared vertices, binary or as text.

use gradreel::{Error, Result};

use super::{Surface, damaged};
use crate::mesh_files::text;

/// Bytes before the triangles of a binary file, and bytes per triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads triangles.
///
/// Either kind may begin with `solid`. Text has no zero bytes and contains `vertex`; binary files state their
/// length.
pub(super) fn read(bytes: &[u8]) -> Result<Surface> {
    let count = bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let length = count.map(|count| HEADER + TRIANGLE * count);
    if length != Some(bytes.len())
        && let Ok(text) = text::decoded(bytes)
    {
        return ascii(&text);
    }
    match (count, length) {
        (Some(count), Some(length)) if length <= bytes.len() => {
            let (triangles, behind) = bytes[HEADER..].split_at(TRIANGLE * count);
            check_behind(count, behind)?;
            binary(triangles)
        }
        (Some(count), Some(length)) => Err(damaged("the mesh is cut short, or no STL")
            .found(format!("{} bytes, which are {} triangles at most", bytes.len(), (bytes.len() - HEADER) / TRIANGLE))
            .wanted(format!("{length} bytes for the {count} triangles that it announces"))),
        _ => Err(damaged("the mesh is cut short, or no STL")
            .found(format!("{} bytes", bytes.len()))
            .wanted(format!("at least {HEADER} bytes, or text that begins with `solid`"))),
    }
}

/// Ignores data after the last triangle, unless it consists of triangles, too: then the stated count is wrong.
fn check_behind(count: usize, behind: &[u8]) -> Result<()> {
    let triangles = behind.len() / TRIANGLE;
    let is_one = |triangle: &[u8]| {
        let [a, b, c] = corners(triangle);
        [a, b, c].as_flattened().iter().all(|x| x.is_finite()) && a != b && b != c && c != a
    };
    if triangles > 0 && behind.len().is_multiple_of(TRIANGLE) && behind.chunks_exact(TRIANGLE).any(is_one) {
        return Err(damaged("the mesh has another number of triangles than it announces")
            .found(format!("bytes of {triangles} more behind the {count} that it announces"))
            .wanted(format!("the number {} at byte 80, or the end of the file there", count + triangles)));
    }
    Ok(())
}

fn corners(triangle: &[u8]) -> [[f64; 3]; 3] {
    let number = |k: usize| f64::from(f32::from_le_bytes(triangle[12 + 4 * k..][..4].try_into().expect("four bytes")));
    [0, 1, 2].map(|corner| [0, 1, 2].map(|axis| number(3 * corner + axis)))
}

fn binary(triangles: &[u8]) -> Result<Surface> {
    let mut surface = Surface::default();
    for triangle in triangles.chunks_exact(TRIANGLE) {
        add_facet(&mut surface, &corners(triangle))?;
    }
    Ok(surface)
}

/// Adds a facet with its own vertices.
fn add_facet(surface: &mut Surface, corners: &[[f64; 3]]) -> Result<()> {
    let first = surface.vertices.len() as u32;
    corners.iter().try_for_each(|corner| surface.add_vertex(*corner))?;
    surface.triangles.extend((2..corners.len() as u32).map(|k| [first, first + k - 1, first + k]));
    Ok(())
}

/// Case-insensitive keywords: `vertex x y z`, three or more between `loop` and `endloop`, and `endsolid` at the
/// end.
fn ascii(text: &str) -> Result<Surface> {
    let mut surface = Surface::default();
    let mut corners = Vec::new();
    let (mut facets, mut ended) = (0, false);
    for (index, line) in text::lines(text).enumerate() {
        let refused = |what: &str, wanted: &str| refused(index, line, what, wanted);
        let mut words = line.split_whitespace().peekable();
        let is = |word: &&str, name: &str| word.eq_ignore_ascii_case(name);
        // the name of the solid is arbitrary
        if let Some(word) = words.next_if(|word| is(word, "solid") || is(word, "endsolid")) {
            ended = is(&word, "endsolid");
            continue;
        }
        while let Some(word) = words.next() {
            if is(&word, "vertex") {
                // parsed as f32, as in a binary file, so that repeated vertices stay equal
                let values: Vec<f64> =
                    words.by_ref().take(3).map_while(|word| word.parse::<f32>().ok()).map(f64::from).collect();
                let corner = values.try_into();
                corners.push(corner.map_err(|_| refused("a corner of the mesh cannot be read", "vertex x y z"))?);
            } else if is(&word, "endloop") {
                if corners.len() < 3 {
                    return Err(refused("a facet of the mesh has too few corners", "three before `endloop`"));
                }
                add_facet(&mut surface, &corners)?;
                corners.clear();
                facets += 1;
            }
        }
    }
    if facets == 0 && corners.is_empty() {
        let first = text::lines(text).find(|line| !line.trim().is_empty()).map(text::shown).unwrap_or_default();
        return Err(damaged("the file is no STL")
            .found(format!("text without a facet that begins with `{first}`"))
            .wanted("`solid`, facets with `vertex x y z`, and `endsolid`; or binary STL"));
    }
    if !corners.is_empty() || !ended {
        return Err(damaged("the mesh is cut short")
            .found(format!("{facets} facets, and {} corners of another", corners.len()))
            .wanted("`endloop` behind the corners of each, and `endsolid` at the end"));
    }
    Ok(surface)
}

fn refused(index: usize, line: &str, what: &str, wanted: &str) -> Error {
    damaged(what).at(format!("line {}", index + 1)).found(text::shown(line)).wanted(wanted)
}
