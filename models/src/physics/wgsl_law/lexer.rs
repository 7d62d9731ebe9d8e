//! Words, numbers and marks of WGSL, without comments.

use std::ops::Range;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A name or keyword.
    Word,
    /// A number with its suffix.
    Number,
    /// One character of anything else.
    Mark,
}

#[derive(Debug, Clone)]
pub(super) struct Token {
    pub kind: Kind,
    /// Where it stands \[bytes\].
    pub range: Range<usize>,
}

/// The tokens of a text. Any text has some: what is no WGSL is left to the parser.
pub(super) fn tokens(text: &str) -> Vec<Token> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let rest = &text[at..];
        let first = bytes[at];
        let (kind, len) = if rest.starts_with("//") {
            (None, rest.find('\n').unwrap_or(rest.len()))
        } else if rest.starts_with("/*") {
            (None, comment(rest.as_bytes()))
        } else if first.is_ascii_digit() || (first == b'.' && bytes.get(at + 1).is_some_and(u8::is_ascii_digit)) {
            (Some(Kind::Number), number(rest.as_bytes()))
        } else if is_letter(first) {
            let len = rest.bytes().take_while(|&b| is_letter(b) || b.is_ascii_digit()).count();
            (Some(Kind::Word), len)
        } else {
            ((!first.is_ascii_whitespace()).then_some(Kind::Mark), 1)
        };
        if let Some(kind) = kind {
            found.push(Token { kind, range: at..at + len });
        }
        at += len;
    }
    found
}

/// Letters, `_`, and all of a character that is not ASCII.
fn is_letter(byte: u8) -> bool {
    byte.is_ascii_alphabetic() || byte == b'_' || byte >= 0x80
}

/// The length of a comment with the comments in it.
fn comment(text: &[u8]) -> usize {
    let (mut depth, mut at) = (0_usize, 0);
    while at < text.len() {
        match &text[at..] {
            [b'/', b'*', ..] => (depth, at) = (depth + 1, at + 2),
            [b'*', b'/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at
}

/// The length of a number: digits, letters, points, and a sign after an exponent.
fn number(text: &[u8]) -> usize {
    let hexadecimal = text.starts_with(b"0x") || text.starts_with(b"0X");
    let mut at = 0;
    while at < text.len() {
        let exponent = at > 0
            && match text[at - 1] {
                b'e' | b'E' => !hexadecimal,
                b'p' | b'P' => hexadecimal,
                _ => false,
            };
        match text[at] {
            b'+' | b'-' if exponent => {}
            b'.' => {}
            b if b.is_ascii_alphanumeric() => {}
            _ => break,
        }
        at += 1;
    }
    at
}
