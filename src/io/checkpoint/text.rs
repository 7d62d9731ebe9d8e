//! What the text protocols write: tuples, and texts with escapes.

/// A piece of a tuple in Python's notation.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Part<'a> {
    Text(&'a str),
    /// Module and name of a class.
    Class(&'a str, &'a str),
    Int(i64),
    None,
    Open,
    Close,
}

/// The pieces of a tuple between its parentheses. Texts have no escapes: keys and places need none.
pub(super) fn tuple(line: &str) -> Option<Vec<Part<'_>>> {
    let mut rest = line.trim().strip_prefix('(')?.strip_suffix(')')?;
    let mut parts = Vec::new();
    loop {
        rest = rest.trim_start_matches([' ', ',']);
        let Some(first) = rest.chars().next() else { return Some(parts) };
        // no reference has more
        if parts.len() == 16 {
            return None;
        }
        let (part, after) = match first {
            '(' => (Part::Open, &rest[1..]),
            ')' => (Part::Close, &rest[1..]),
            '\'' | '"' => {
                let (text, after) = rest[1..].split_once(first)?;
                (Part::Text(text), after)
            }
            '<' => {
                let (class, after) = rest.strip_prefix("<class '")?.split_once("'>")?;
                let (module, name) = class.rsplit_once('.')?;
                (Part::Class(module, name), after)
            }
            _ => {
                let (word, after) = rest.split_at(rest.find([',', ')']).unwrap_or(rest.len()));
                let part = match word.trim() {
                    "None" => Part::None,
                    number => Part::Int(number.trim_end_matches('L').parse().ok()?),
                };
                (part, after)
            }
        };
        parts.push(part);
        rest = after;
    }
}

/// A text of protocol 0: Latin-1 with `\uXXXX` and `\UXXXXXXXX`.
pub(super) fn raw_unicode(bytes: &[u8]) -> String {
    let mut text = String::new();
    let mut rest = bytes;
    while let [first, after @ ..] = rest {
        let digits = match after {
            [b'u', digits @ ..] if *first == b'\\' => digits.get(..4),
            [b'U', digits @ ..] if *first == b'\\' => digits.get(..8),
            _ => None,
        };
        match digits.and_then(|digits| hexadecimal(digits).map(|code| (code, digits.len()))) {
            Some((code, len)) => {
                text.push(char::from_u32(code).unwrap_or(char::REPLACEMENT_CHARACTER));
                rest = &after[1 + len..];
            }
            None => {
                text.push(char::from(*first));
                rest = after;
            }
        }
    }
    text
}

/// The bytes of a text of Python 2 between its quotes; `None` where they are missing.
pub(super) fn quoted(line: &[u8]) -> Option<Vec<u8>> {
    let line = line.trim_ascii();
    let (quote, inside) = line.split_first().filter(|(quote, _)| matches!(quote, b'\'' | b'"'))?;
    let mut rest = inside.strip_suffix(&[*quote])?;
    let mut bytes = Vec::new();
    while let [first, after @ ..] = rest {
        let (byte, left) = match (first, after) {
            (b'\\', [b'x', digits @ ..]) => (digits.get(..2).and_then(hexadecimal)? as u8, &digits[2..]),
            (b'\\', [b'n', left @ ..]) => (b'\n', left),
            (b'\\', [b'r', left @ ..]) => (b'\r', left),
            (b'\\', [b't', left @ ..]) => (b'\t', left),
            (b'\\', [other, left @ ..]) => (*other, left),
            (_, left) => (*first, left),
        };
        bytes.push(byte);
        rest = left;
    }
    Some(bytes)
}

fn hexadecimal(digits: &[u8]) -> Option<u32> {
    digits.iter().try_fold(0u32, |code, digit| Some(code << 4 | char::from(*digit).to_digit(16)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_of_protocol_0_is_read() {
        let parts = tuple("('storage', <class 'torch.FloatStorage'>, '0', 'cuda:0', 6, ('1', 2, 3))").unwrap();
        assert_eq!(parts[..3], [Part::Text("storage"), Part::Class("torch", "FloatStorage"), Part::Text("0")]);
        assert_eq!(parts[4..], [Part::Int(6), Part::Open, Part::Text("1"), Part::Int(2), Part::Int(3), Part::Close]);
        assert_eq!(tuple("('storage', <class 'torch"), None);
        assert_eq!(tuple("(1, None)"), Some(vec![Part::Int(1), Part::None]));
        assert_eq!(tuple("(,,,)"), Some(vec![]));
        assert_eq!(tuple(&format!("({})", "1,".repeat(1000))), None);
    }

    #[test]
    fn escapes_are_undone() {
        assert_eq!(raw_unicode(b"a\\u00e9\xe9\\U0001f600\\n"), "a\u{e9}\u{e9}\u{1f600}\\n");
        assert_eq!(raw_unicode(b"\\ud800\\u12"), "\u{fffd}\\u12");
        assert_eq!(quoted(b"'a\\x41\\n\\'b'").unwrap(), b"aA\n'b");
        assert_eq!(quoted(b"'open"), None);
        assert_eq!(quoted(b"'"), None);
    }
}
