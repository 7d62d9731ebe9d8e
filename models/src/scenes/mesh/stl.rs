//! STL: triangles without shared corners, binary or as text.

use gradreel::Result;

use super::{Surface, damaged};

/// Bytes before the triangles of a binary file, and of each triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads triangles.
pub(super) fn read(bytes: &[u8]) -> Result<Surface> {
    // Binary files may begin with "solid", too; their length tells.
    let count = bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let length = count.map(|count| HEADER + TRIANGLE * count);
    if length == Some(bytes.len()) {
        return Ok(binary(&bytes[HEADER..]));
    }
    if let Some(text) = std::str::from_utf8(bytes).ok().filter(|text| text.trim_start().starts_with("solid")) {
        return ascii(text);
    }
    let wanted = match (count, length) {
        (Some(count), Some(length)) => format!("{length} bytes for the {count} triangles that it announces"),
        _ => format!("at least {HEADER} bytes, or text that begins with `solid`"),
    };
    Err(damaged("the mesh is cut short, or no STL").found(format!("{} bytes", bytes.len())).wanted(wanted))
}

fn binary(triangles: &[u8]) -> Surface {
    let mut surface = Surface::default();
    for triangle in triangles.chunks_exact(TRIANGLE) {
        let number =
            |k: usize| f64::from(f32::from_le_bytes(triangle[12 + 4 * k..][..4].try_into().expect("four bytes")));
        let first = surface.vertices.len() as u32;
        surface.vertices.extend((0..3).map(|corner| [0, 1, 2].map(|axis| number(3 * corner + axis))));
        surface.triangles.push([first, first + 1, first + 2]);
    }
    surface
}

fn ascii(text: &str) -> Result<Surface> {
    let mut surface = Surface::default();
    for (number, line) in text.lines().enumerate() {
        let Some(rest) = line.trim_start().strip_prefix("vertex") else { continue };
        // Through f32, as in a binary file, so that the same corner written twice stays the same.
        let values: Vec<f64> = rest.split_whitespace().map_while(|w| w.parse::<f32>().ok()).map(f64::from).collect();
        let Ok(vertex) = values.try_into() else {
            let place = format!("line {}", number + 1);
            return Err(damaged("a corner of the mesh cannot be read")
                .at(place)
                .found(line.trim())
                .wanted("vertex x y z"));
        };
        surface.vertices.push(vertex);
    }
    let count = surface.vertices.len();
    if count % 3 != 0 || !text.contains("endsolid") {
        return Err(damaged("the mesh is cut short")
            .found(format!("{count} corners"))
            .wanted("three for each triangle, and `endsolid` at the end"));
    }
    surface.triangles = (0..count as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Ok(surface)
}
