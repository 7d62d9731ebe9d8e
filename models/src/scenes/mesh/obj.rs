//! Wavefront OBJ: `v x y z` and `f 1 2 3`, whose corners may be counted from the end; all else is passed over.

use gradreel::Result;

use super::{Surface, damaged};

/// Reads corners and faces.
pub(super) fn read(bytes: &[u8]) -> Result<Surface> {
    let text = std::str::from_utf8(bytes).map_err(|_| damaged("the mesh is not text, as OBJ is"))?;
    let mut surface = Surface::default();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        let place = || format!("line {}", number + 1);
        match words.next() {
            Some("v") => {
                let values: Vec<f64> = words.take(3).map_while(|word| word.parse().ok()).collect();
                let Ok(vertex) = values.try_into() else {
                    return Err(damaged("a corner of the mesh cannot be read")
                        .at(place())
                        .found(line)
                        .wanted("v x y z"));
                };
                surface.vertices.push(vertex);
            }
            Some("f") => {
                let count = surface.vertices.len() as i64;
                let corner = |word: &str| {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    let index = if index < 0 { count + index } else { index - 1 };
                    (0..count).contains(&index).then_some(index as u32)
                };
                let corners: Option<Vec<u32>> = words.map(corner).collect();
                match corners {
                    Some(corners) if corners.len() >= 3 => surface.add_face(&corners),
                    _ => {
                        return Err(damaged("a face of the mesh cannot be read")
                            .at(place())
                            .found(line)
                            .wanted(format!("f and at least three of the {count} corners before it")));
                    }
                }
            }
            _ => {}
        }
    }
    Ok(surface)
}
