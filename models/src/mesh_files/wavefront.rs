//! The lines of Wavefront files, OBJ and MTL: a keyword and its arguments.
//!
//! `\` at the end of a line continues it on the next one; `#` begins a comment, at the start of a line or after a
//! blank.

use std::borrow::Cow;

use super::text;

/// A logical line, with its continuations.
pub(crate) struct Line<'a> {
    /// Number of its first physical line, from 1.
    pub number: usize,
    text: Cow<'a, str>,
}

/// All lines except empty ones and comments.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    let mut physical = text::lines(text).enumerate();
    let joined = std::iter::from_fn(move || {
        let (index, first) = physical.next()?;
        let mut piece = first.trim();
        let mut text = Cow::Borrowed(piece);
        while piece.ends_with('\\') && uncommented(piece) == piece {
            piece = physical.next().map_or("", |(_, next)| next.trim());
            let whole = text.to_mut();
            whole.pop();
            whole.push(' ');
            whole.push_str(piece);
        }
        Some(Line { number: index + 1, text })
    });
    joined.filter(|line| !uncommented(&line.text).trim().is_empty())
}

impl Line<'_> {
    /// The keyword.
    pub fn word(&self) -> &str {
        self.text.split_whitespace().next().unwrap_or("")
    }

    /// The arguments without a comment: words and numbers.
    pub fn values(&self) -> &str {
        uncommented(self.name()).trim()
    }

    /// Everything after the keyword. Names may contain blanks and `#`; only the caller, who knows the names, can
    /// separate a comment; see [`uncommented`].
    pub fn name(&self) -> &str {
        self.text.trim().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
    }

    /// The beginning of the line, for error messages.
    pub fn shown(&self) -> String {
        text::shown(&self.text)
    }
}

/// A text without its comment.
pub(crate) fn uncommented(text: &str) -> &str {
    let begins = |(at, _): &(usize, &str)| text[..*at].chars().next_back().is_none_or(char::is_whitespace);
    text.match_indices('#').find(begins).map_or(text, |(at, _)| text[..at].trim_end())
}

#[cfg(test)]
mod tests {
    use super::{lines, uncommented};

    fn all(text: &str) -> Vec<(usize, String, String)> {
        let words = |values: &str| values.split_whitespace().collect::<Vec<_>>().join(" ");
        let owned = |line: super::Line<'_>| (line.number, line.word().to_owned(), words(line.values()));
        lines(text).map(owned).collect()
    }

    #[test]
    fn lines_go_on_behind_a_backslash() {
        let text = "# a \\\nf 1 2 \\\r\n  3 \\ \r\n 4 # quad \\\nv 1 2 3\\";
        let wanted = [(2, "f", "1 2 3 4"), (5, "v", "1 2 3")].map(|(n, w, v)| (n, w.to_owned(), v.to_owned()));
        assert_eq!(all(text), wanted);
    }

    #[test]
    fn comments_begin_behind_a_blank() {
        assert_eq!(uncommented("1 2 # 3"), "1 2");
        assert_eq!(uncommented("wood#2\t# of two"), "wood#2");
        assert_eq!(uncommented("#f 1 2 3"), "");
        assert!(all("\n \t \n# no\n  # no").is_empty());
        assert_eq!(all("usemtl"), [(1, "usemtl".to_owned(), String::new())]);
    }
}
