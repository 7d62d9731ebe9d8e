//! Binary data of a glTF file: container, buffers and accessors.

use std::borrow::Cow;

use gradreel::{Error, Result};

use super::json::{Buffer, BufferView, Root, Sparse};
use crate::mesh_files::LARGEST;
use crate::report::base64;
use crate::text::unmarked;
use crate::views::objects::mesh::beside::Beside;
use crate::views::objects::mesh::damaged;
use crate::views::objects::mesh::surface::MOST_TRIANGLES;

/// Maximum number of elements of an accessor without a buffer view, which are zeros except for sparse values: an
/// empty file can declare any number of them.
const MOST_ZEROS: usize = 1 << 18;

/// The JSON of a `.gltf` or `.glb` file, and the binary chunk of the latter. Data beyond the declared length is
/// ignored.
pub(super) fn parts(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>)> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else { return Ok((unmarked(bytes), None)) };
    let short = || damaged("the mesh is cut short").found(format!("{} bytes", bytes.len()));
    let (version, rest) = number(rest).ok_or_else(short)?;
    if version != 2 {
        return Err(damaged("the mesh has another version of glTF").found(version).wanted(2));
    }
    let (length, _) = number(rest).ok_or_else(short)?;
    let short = || short().wanted(format!("the {length} bytes that it announces, and in them all of its parts"));
    let mut rest = bytes.get(12..length as usize).ok_or_else(short)?;
    let (mut json, mut binary) = (None, None);
    while let Some((length, after)) = number(rest) {
        let (kind, after) = number(after).ok_or_else(short)?;
        let (chunk, after) = after.split_at_checked(length as usize).ok_or_else(short)?;
        match &kind.to_le_bytes() {
            b"JSON" => json = json.or(Some(chunk)),
            b"BIN\0" => binary = binary.or(Some(chunk)),
            _ => {}
        }
        rest = after;
    }
    let json = json.ok_or_else(|| damaged("the mesh has no JSON part"))?;
    // padded with spaces or zeros
    let end = json.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    Ok((unmarked(&json[..end]), binary))
}

fn number(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*number), rest))
}

/// The bytes embedded in a `data:` URI, or those of the referenced file.
pub(super) fn of_uri(uri: &str, beside: &Beside, what: &str) -> Result<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let bytes = data.split_once(";base64,").and_then(|(_, text)| {
            // as in other URIs, `=` may be `%3D`; white space is ignored
            let text = percent_decoded(text);
            base64::decode(&text.split_ascii_whitespace().collect::<String>())
        });
        return bytes.ok_or_else(|| {
            let found: String = uri.chars().take(40).collect();
            damaged(format!("{what} cannot be read")).found(found).wanted("data:…;base64,…")
        });
    }
    beside.read(&percent_decoded(uri), what)
}

/// Decodes percent escapes: `%20` is a space.
fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digits = after.get(..2).filter(|digits| first == b'%' && digits.iter().all(u8::is_ascii_hexdigit));
        let code = digits.and_then(|digits| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        bytes.push(code.unwrap_or(first));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The buffers of a file.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    bytes: Vec<Cow<'a, [u8]>>,
}

/// The elements of an accessor, each of `width` numbers.
pub(super) struct Elements {
    pub width: usize,
    pub numbers: Vec<f64>,
}

impl<'a> Buffers<'a> {
    pub fn read(root: &'a Root, binary: Option<&'a [u8]>, beside: &Beside) -> Result<Self> {
        let mut bytes = Vec::new();
        let mut all = 0;
        for (index, Buffer { uri, byte_length }) in root.buffers.iter().enumerate() {
            let buffer = match (uri, binary) {
                (Some(uri), _) => Cow::Owned(of_uri(uri, beside, "a buffer of the mesh")?),
                (None, Some(binary)) if index == 0 => Cow::Borrowed(binary),
                (None, _) => return Err(damaged("a buffer of the mesh has no bytes").at(format!("buffer {index}"))),
            };
            all += buffer.len() as u64;
            if buffer.len() < *byte_length || all > LARGEST {
                return Err(damaged("a buffer of the mesh has not the bytes that it announces, or too many")
                    .at(format!("buffer {index}"))
                    .found(format!("{} bytes", buffer.len()))
                    .wanted(format!("{byte_length}, at most {} MB in all", LARGEST >> 20)));
            }
            bytes.push(buffer);
        }
        Ok(Self { root, bytes })
    }

    /// The bytes of a view, and the stride of its elements if they are not contiguous.
    pub fn view(&self, index: usize) -> Result<(&[u8], Option<usize>)> {
        let found = self.root.buffer_views.get(index).and_then(|view| {
            let BufferView { buffer, byte_offset, byte_length, byte_stride } = *view;
            let end = byte_offset.checked_add(byte_length)?;
            Some((self.bytes.get(buffer)?.get(byte_offset..end)?, byte_stride))
        });
        found.ok_or_else(|| damaged("a part of the mesh's buffers is missing").at(format!("buffer view {index}")))
    }

    /// The numbers of an accessor; normalised integers are within −1..1.
    pub fn elements(&self, index: usize) -> Result<Elements> {
        self.numbers_of(index).map_err(|e| e.within(format!("accessor {index}")))
    }

    fn numbers_of(&self, index: usize) -> Result<Elements> {
        let accessor = self.root.accessors.get(index);
        let accessor = accessor.ok_or_else(|| wrong("none".into(), "an accessor of this number"))?;
        let width = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(wrong(format!("the type {other}"), "numbers, or vectors of them")),
        };
        let (count, component) = (accessor.count, Component::of(accessor.component_type)?);
        if count > 3 * MOST_TRIANGLES {
            return Err(wrong(format!("{count} elements"), "three for each of two million triangles"));
        }
        let mut numbers = match accessor.buffer_view {
            Some(view) => self.read_numbers(view, accessor.byte_offset, component, width, count)?,
            None if accessor.sparse.is_none() => return Err(wrong("no buffer view".into(), "numbers of its own")),
            None if count > MOST_ZEROS => {
                return Err(wrong(format!("{count} zeros"), "at most 262144 elements that are not in the file"));
            }
            None => vec![0.0; count * width],
        };
        if let Some(Sparse { count: replaced, indices, values }) = &accessor.sparse {
            if *replaced > count {
                return Err(wrong(format!("{replaced} sparse elements"), "no more than elements"));
            }
            let kind = Component::of(indices.component_type.unwrap_or(0))?;
            let places = self.read_numbers(indices.buffer_view, indices.byte_offset, kind, 1, *replaced)?;
            let values = self.read_numbers(values.buffer_view, values.byte_offset, component, width, *replaced)?;
            for (place, value) in places.iter().zip(values.chunks_exact(width)) {
                let fits = place.fract() == 0.0 && (0.0..count as f64).contains(place);
                let first = if fits { *place as usize * width } else { usize::MAX };
                let old = first.checked_add(width).and_then(|end| numbers.get_mut(first..end));
                old.ok_or_else(|| wrong(format!("a sparse element {place}"), "one of its elements"))?
                    .copy_from_slice(value);
            }
        }
        if accessor.normalized {
            numbers.iter_mut().for_each(|value| *value = (*value / component.scale).max(-1.0));
        }
        Ok(Elements { width, numbers })
    }

    /// Reads `count` elements of `width` numbers from a view.
    fn read_numbers(
        &self,
        view: usize,
        offset: usize,
        component: Component,
        width: usize,
        count: usize,
    ) -> Result<Vec<f64>> {
        let (data, stride) = self.view(view)?;
        let size = width * component.bytes;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(wrong(format!("elements {stride} bytes apart"), "their length or more"));
        }
        let mut numbers = Vec::with_capacity((count * width).min(data.len()));
        for element in 0..count {
            let place = element.checked_mul(stride).and_then(|place| place.checked_add(offset));
            let end = place.and_then(|place| place.checked_add(size));
            let element = place.zip(end).and_then(|(place, end)| data.get(place..end));
            let element =
                element.ok_or_else(|| wrong(format!("{} bytes", data.len()), "bytes for all of its elements"))?;
            numbers.extend(element.chunks_exact(component.bytes).map(|value| component.number(value)));
        }
        Ok(numbers)
    }
}

fn wrong(found: String, wanted: &str) -> Error {
    damaged("numbers of the mesh cannot be read").found(found).wanted(wanted)
}

/// A component type.
#[derive(Clone, Copy)]
struct Component {
    kind: u32,
    bytes: usize,
    /// Maximum value of an integer type.
    scale: f64,
}

impl Component {
    fn of(kind: u32) -> Result<Self> {
        let (bytes, scale) = match kind {
            5120 => (1, 127.0),
            5121 => (1, 255.0),
            5122 => (2, 32767.0),
            5123 => (2, 65535.0),
            5125 => (4, 4_294_967_295.0),
            5126 => (4, 1.0),
            other => return Err(wrong(format!("the component type {other}"), "5120 to 5126")),
        };
        Ok(Self { kind, bytes, scale })
    }

    fn number(self, value: &[u8]) -> f64 {
        match (self.kind, value) {
            (5120, &[a]) => f64::from(a as i8),
            (5122, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
            (5126, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
            _ => value.iter().rev().fold(0.0, |sum, byte| 256.0 * sum + f64::from(*byte)),
        }
    }
}

impl Elements {
    /// The elements as vectors of `N`, truncated if longer; `None` if they are shorter.
    pub fn vectors<const N: usize>(&self) -> Option<impl ExactSizeIterator<Item = [f64; N]>> {
        let each = self.numbers.chunks_exact(self.width);
        (self.width >= N).then(|| each.map(|element| *element.first_chunk().expect("at least so many")))
    }
}
