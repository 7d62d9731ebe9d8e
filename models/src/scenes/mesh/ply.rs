//! PLY: corners (or particles) and faces, as text or binary of either byte order. Other properties are passed over.

use gradreel::Result;

use super::{Surface, damaged};

/// Longest header that is looked at.
const LONGEST_HEADER: usize = 1 << 16;
/// Most corners of a face.
const MOST_CORNERS: usize = 1 << 16;

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Text,
    Little,
    Big,
}

/// A number type: bytes, whether it is a float, whether it has a sign.
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
    /// The type of the length, for a list.
    list: Option<Number>,
    number: Number,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads corners and faces; a file without faces is a point cloud.
pub(in crate::scenes) fn read(bytes: &[u8]) -> Result<Surface> {
    let (format, elements, body) = header(bytes)?;
    let mut values = Values { format, rest: body };
    let mut surface = Surface::default();
    for element in &elements {
        let axis = |name: &str| element.properties.iter().position(|p| p.name == name && p.list.is_none());
        let place = match [axis("x"), axis("y"), axis("z")] {
            [Some(x), Some(y), Some(z)] if element.name == "vertex" => Some([x, y, z]),
            _ if element.name == "vertex" => {
                return Err(damaged("the corners of the file have no coordinates").wanted("properties x, y and z"));
            }
            _ => None,
        };
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
            for property in &element.properties {
                let mut next = |number| values.next(number).ok_or_else(|| short(element, index));
                let Some(length) = property.list else {
                    row.push(next(property.number)?);
                    continue;
                };
                let count = next(length)?;
                if !(0.0..=MOST_CORNERS as f64).contains(&count) {
                    return Err(damaged("a list of the file has an impossible length")
                        .at(format!("{} {index}", element.name))
                        .found(count)
                        .wanted(format!("0 to {MOST_CORNERS}")));
                }
                row.push(count);
                for _ in 0..count as usize {
                    let value = next(property.number)?;
                    if element.name == "face" && property.name.starts_with("vertex_ind") {
                        // Beyond u32 and below 0 the cast saturates; the mesh checks the range.
                        corners.push(if value < 0.0 { u32::MAX } else { value as u32 });
                    }
                }
            }
            if let Some(place) = place {
                surface.vertices.push(place.map(|k| row[k]));
            }
            if corners.len() >= 3 {
                surface.add_face(&corners);
            }
        }
    }
    if surface.vertices.is_empty() {
        return Err(damaged("the file has no corners").wanted("an element `vertex`"));
    }
    Ok(surface)
}

fn short(element: &Element, index: usize) -> gradreel::Error {
    damaged("the file is cut short, or holds something other than numbers")
        .at(format!("{} {index}", element.name))
        .wanted(format!("{} of them", element.count))
}

fn header(bytes: &[u8]) -> Result<(Format, Vec<Element>, &[u8])> {
    let fault = |found: &str| damaged("the header of the PLY file cannot be read").found(format!("`{found}`"));
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut rest = bytes;
    for number in 0.. {
        let window = &rest[..rest.len().min(LONGEST_HEADER)];
        let Some(end) = window.iter().position(|&b| b == b'\n') else {
            return Err(damaged("the header of the PLY file does not end").wanted("a line `end_header`"));
        };
        let line = String::from_utf8_lossy(&rest[..end]);
        rest = &rest[end + 1..];
        let line = line.trim();
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 0 => {}
            _ if number == 0 => return Err(fault(&line.chars().take(40).collect::<String>()).wanted("`ply`")),
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

/// The numbers of the body, one after the other.
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
