//! Decoding of the text in mesh files.
//!
//! Only names and comments contain non-ASCII letters, in the code page of the exporting system. Text that is not UTF-8
//! is therefore decoded as Latin-1, in which every byte is a letter: equal names stay equal.

use std::borrow::Cow;

use gradreel::Result;

use super::damaged;
use crate::text::unmarked;

/// Decodes UTF-8, UTF-16 with a byte order mark, or Latin-1; the mark is removed.
///
/// # Errors
/// [`ErrorKind::Input`](gradreel::ErrorKind::Input) for bytes that are not text.
pub(crate) fn decoded(bytes: &[u8]) -> Result<Cow<'_, str>> {
    let wide = |rest: &[u8], of: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = rest.as_chunks().0.iter().map(|pair| of(*pair)).collect();
        Cow::Owned(String::from_utf16_lossy(&units))
    };
    let text = match bytes {
        [0xff, 0xfe, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => wide(rest, u16::from_be_bytes),
        _ => {
            let bytes = unmarked(bytes);
            let latin = || Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect());
            str::from_utf8(bytes).map_or_else(|_| latin(), Cow::Borrowed)
        }
    };
    match text.find('\0') {
        None => Ok(text),
        Some(at) => Err(damaged("the file is not text").found(format!("a zero byte behind {at} bytes"))),
    }
}

/// The lines of a text, ended by any of `\n`, `\r\n` and `\r`.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest.filter(|text| !text.is_empty())?;
        let end = text.find(['\n', '\r']).unwrap_or(text.len());
        let (line, after) = text.split_at(end);
        rest = Some(after.strip_prefix("\r\n").unwrap_or_else(|| after.get(1..).unwrap_or("")));
        Some(line)
    })
}

/// The beginning of a line, for error messages.
pub(crate) fn shown(line: &str) -> String {
    line.trim().chars().take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::{decoded, lines};

    #[test]
    fn every_kind_of_text_is_the_same_text() {
        let wide = |mark: u16, of: fn(u16) -> [u8; 2]| -> Vec<u8> {
            std::iter::once(mark).chain("Gehäuse".encode_utf16()).flat_map(of).collect()
        };
        let marked = "\u{feff}Gehäuse".as_bytes().to_vec();
        let latin = b"Geh\xe4use".to_vec();
        for bytes in [marked, latin, wide(0xfeff, u16::to_le_bytes), wide(0xfeff, u16::to_be_bytes)] {
            assert_eq!(decoded(&bytes).unwrap(), "Gehäuse", "{bytes:?}");
        }
        assert!(decoded(b"v 1\0 2").unwrap_err().to_string().contains("not text"));
    }

    #[test]
    fn every_line_end_ends_a_line() {
        for text in ["a\nb\n\nc", "a\r\nb\r\n\r\nc\r\n", "a\rb\r\rc\r"] {
            assert_eq!(lines(text).collect::<Vec<_>>(), ["a", "b", "", "c"], "{text:?}");
        }
        assert_eq!(lines("").count(), 0);
    }
}
