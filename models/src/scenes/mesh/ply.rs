//! PLY: vertices (or particles) and faces or triangle strips, as text or binary in either byte order. Other
//! elements and properties are skipped.

use gradreel::Result;

use super::{Surface, damaged};
use crate::mesh_files::text;
use crate::text::unmarked;

/// Maximum length of a header line.
const LONGEST_HEADER: usize = 1 << 16;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Text,
    Little,
    Big,
}

/// A number type: size in bytes, whether it is a float, whether it is signed.
#[derive(Clone, Copy)]
struct Number {
    bytes: usize,
    float: bool,
    signed: bool,
}

impl Number {
    fn of(name: &str) -> Option<Self> {
        let (bytes, float, signed) = match name {
            "char" | "int8" => (1, false, true),
            "uchar" | "uint8" => (1, false, false),
            "short" | "int16" => (2, false, true),
            "ushort" | "uint16" => (2, false, false),
            "int" | "int32" => (4, false, true),
            "uint" | "uint32" => (4, false, false),
            "float" | "float32" => (4, true, true),
            "double" | "float64" => (8, true, true),
            _ => return None,
        };
        Some(Self { bytes, float, signed })
    }
}

struct Property {
    name: String,
    /// Type of the list length, for a list property.
    list: Option<Number>,
    number: Number,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Interpretation of an element's vertex list.
#[derive(Clone, Copy, PartialEq)]
enum Corners {
    Polygon,
    /// Triangle strips, separated by −1.
    Strips,
    /// Triangle fans, separated by −1.
    Fans,
}

impl Element {
    /// The interpretation of its vertices, and the property that lists them.
    fn corners(&self) -> Option<(Corners, usize)> {
        let kind = match self.name.as_str() {
            "face" => Corners::Polygon,
            "tristrips" | "tristrip" => Corners::Strips,
            "trifans" | "trifan" => Corners::Fans,
            _ => return None,
        };
        let lists = |p: &Property| p.list.is_some() && p.name.starts_with("vertex_ind");
        self.properties.iter().position(lists).map(|property| (kind, property))
    }

    /// The properties that hold a vertex position.
    fn place(&self) -> Result<Option<[usize; 3]>> {
        if self.name != "vertex" {
            return Ok(None);
        }
        let axis = |name: &str| self.properties.iter().position(|p| p.name == name && p.list.is_none());
        match [axis("x"), axis("y"), axis("z")] {
            [Some(x), Some(y), Some(z)] => Ok(Some([x, y, z])),
            _ => Err(damaged("the corners of the file have no coordinates").wanted("properties x, y and z")),
        }
    }
}

/// Reads vertices and faces; a file without faces is a point cloud.
pub(in crate::scenes) fn read(bytes: &[u8]) -> Result<Surface> {
    let (format, elements, body) = header(bytes)?;
    of_elements(format, &elements, body)
}

/// As [`read`], for a file that must have faces.
pub(super) fn solid(bytes: &[u8]) -> Result<Surface> {
    let (format, elements, body) = header(bytes)?;
    if !elements.iter().any(|element| element.count > 0 && element.corners().is_some()) {
        let listed = |element: &Element| format!("{} {}", element.count, element.name);
        return Err(damaged("the mesh has no faces that can be read")
            .found(elements.iter().map(listed).collect::<Vec<_>>().join(", "))
            .wanted("an element `face` or `tristrips` with a list `vertex_indices`"));
    }
    of_elements(format, &elements, body)
}

fn of_elements(format: Format, elements: &[Element], body: &[u8]) -> Result<Surface> {
    let mut values = Values { format, rest: body };
    let mut surface = Surface::default();
    for element in elements.iter().filter(|element| element.count > 0) {
        let (place, faces) = (element.place()?, element.corners());
        let least: usize = element.properties.iter().map(|p| p.list.unwrap_or(p.number).bytes).sum();
        if element.properties.is_empty() || (format != Format::Text && element.count > values.rest.len() / least.max(1))
        {
            return Err(short(element, 0));
        }
        let mut row = Vec::with_capacity(element.properties.len());
        let mut corners = Vec::new();
        for index in 0..element.count {
            row.clear();
            corners.clear();
            for (number, property) in element.properties.iter().enumerate() {
                let mut next = |number| values.next(number).ok_or_else(|| short(element, index));
                let Some(length) = property.list else {
                    row.push(next(property.number)?);
                    continue;
                };
                let count = next(length)?;
                if count < 0.0 || count.fract() != 0.0 {
                    return Err(damaged("a list of the file has an impossible length")
                        .at(format!("{} {index}", element.name))
                        .found(count)
                        .wanted("a whole number, not below 0"));
                }
                row.push(count);
                let wanted = faces.is_some_and(|(_, lists)| lists == number);
                if wanted {
                    Surface::check_count(count as usize)?;
                }
                // beyond the end of the data, `next` fails
                for _ in 0..count as u64 {
                    let value = next(property.number)?;
                    if wanted {
                        corners.push(value);
                    }
                }
            }
            if let Some(place) = place {
                surface.add_vertex(place.map(|k| row[k]))?;
            }
            if let Some((kind, _)) = faces {
                add_corners(&mut surface, kind, &corners).map_err(|e| e.at(format!("{} {index}", element.name)))?;
            }
        }
    }
    if surface.vertices.is_empty() {
        return Err(damaged("the file has no corners").wanted("an element `vertex`"));
    }
    Ok(surface)
}

/// Adds the triangles of a vertex list. Faces of one or two vertices have none.
fn add_corners(surface: &mut Surface, kind: Corners, listed: &[f64]) -> Result<()> {
    // in an unsigned list, −1 is the maximum value
    let restarts = |number: &f64| kind != Corners::Polygon && [-1.0, f64::from(u32::MAX)].contains(number);
    for part in listed.split(restarts) {
        let number = |value: &f64| {
            let whole = (0.0..f64::from(u32::MAX)).contains(value) && value.fract() == 0.0;
            whole.then_some(*value as u32).ok_or_else(|| {
                damaged("a face of the mesh names a corner that there is not").found(value).wanted("a number from 0")
            })
        };
        let corners = part.iter().map(number).collect::<Result<Vec<u32>>>()?;
        match kind {
            _ if corners.len() < 3 => {}
            Corners::Strips => surface.add_strip(&corners)?,
            Corners::Polygon | Corners::Fans => surface.add_face(&corners)?,
        }
    }
    Ok(())
}

fn short(element: &Element, index: usize) -> gradreel::Error {
    damaged("the file is cut short, or holds something other than numbers")
        .at(format!("{} {index}", element.name))
        .wanted(format!("{} of them", element.count))
}

/// The format, the elements and the data after the header, whose line ending is that of the first line.
fn header(bytes: &[u8]) -> Result<(Format, Vec<Element>, &[u8])> {
    let fault = |found: &str| {
        let found = text::shown(found);
        damaged("the header of the PLY file cannot be read").found(format!("`{found}`"))
    };
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut rest = unmarked(bytes);
    let first_end = rest.iter().position(|b| matches!(b, b'\n' | b'\r'));
    let old_mac = first_end.is_some_and(|end| rest[end] == b'\r' && rest.get(end + 1) != Some(&b'\n'));
    for number in 0.. {
        let window = &rest[..rest.len().min(LONGEST_HEADER)];
        let Some(end) = window.iter().position(|&b| b == if old_mac { b'\r' } else { b'\n' }) else {
            let begins = number > 0 || window.starts_with(b"ply");
            return Err(match begins {
                true => damaged("the header of the PLY file does not end").wanted("a line `end_header`"),
                false => fault(&String::from_utf8_lossy(&window[..window.len().min(80)])).wanted("`ply`"),
            });
        };
        let line = String::from_utf8_lossy(&rest[..end]);
        rest = &rest[end + 1..];
        let line = line.trim();
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 0 => {}
            _ if number == 0 => return Err(fault(line).wanted("`ply`")),
            ["format", name, _] => {
                format = match name {
                    "ascii" => Some(Format::Text),
                    "binary_little_endian" => Some(Format::Little),
                    "binary_big_endian" => Some(Format::Big),
                    _ => return Err(fault(line)),
                }
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| fault(line))?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", length, number, name] => {
                let (list, number) = (Number::of(length), Number::of(number));
                let (Some(element), Some(list), Some(number)) = (elements.last_mut(), list, number) else {
                    return Err(fault(line));
                };
                element.properties.push(Property { name: name.into(), list: Some(list), number });
            }
            ["property", number, name] => {
                let (Some(element), Some(number)) = (elements.last_mut(), Number::of(number)) else {
                    return Err(fault(line));
                };
                element.properties.push(Property { name: name.into(), list: None, number });
            }
            ["end_header"] => break,
            ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(fault(line)),
        }
    }
    let format = format.ok_or_else(|| damaged("the PLY file does not say its format"))?;
    Ok((format, elements, rest))
}

/// Sequential reader of the numbers in the body.
struct Values<'a> {
    format: Format,
    rest: &'a [u8],
}

impl Values<'_> {
    fn next(&mut self, number: Number) -> Option<f64> {
        if self.format == Format::Text {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace())?;
            let word = &self.rest[start..];
            let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            self.rest = &word[end..];
            return std::str::from_utf8(&word[..end]).ok()?.parse().ok();
        }
        let (value, rest) = self.rest.split_at_checked(number.bytes)?;
        self.rest = rest;
        let mut little = [0; 8];
        for (k, &byte) in value.iter().enumerate() {
            little[if self.format == Format::Little { k } else { number.bytes - 1 - k }] = byte;
        }
        let bits = u64::from_le_bytes(little);
        let unused = 64 - 8 * number.bytes as u32;
        Some(match (number.float, number.bytes) {
            (true, 4) => f64::from(f32::from_bits(bits as u32)),
            (true, _) => f64::from_bits(bits),
            (false, _) if number.signed => ((bits << unused) as i64 >> unused) as f64,
            _ => bits as f64,
        })
    }
}
