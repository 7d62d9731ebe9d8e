//! Escaping of untrusted text for HTML and SVG.

use std::fmt::Write as _;

/// Escapes the markup characters in a text for element content and quoted attributes.
///
/// Control characters, which XML forbids, become U+FFFD and thus stay visible.
pub(super) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\n' | '\t' => safe.push(character),
            '\u{fffe}' | '\u{ffff}' => safe.push('\u{fffd}'),
            c if c.is_control() => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

/// A relative link to a file beside the page: percent-encoded, with the prefix `./`, so that it never names a
/// scheme.
pub(super) fn relative_link(path: &str) -> String {
    let mut link = String::from("./");
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => link.push(char::from(byte)),
            _ => write!(link, "%{byte:02X}").expect("a string accepts every write"),
        }
    }
    link
}
