//! The user's text with the prelude behind it, so that lines and columns are those of the user's file.

use std::ops::Range;

use gradreel::{Error, ErrorKind, Result};
use naga::Span;

use super::fault::{Fault, Outcome};
use super::lexer::{Kind, tokens};

/// Largest file \[bytes\].
pub(super) const MOST_BYTES: usize = 256 << 10;

/// Most operators and brackets of one statement, and most `else` of a file: both are nested by the parser.
const MOST_NESTED: usize = 500;

/// What each law may use.
const PRELUDE: &str = include_str!("prelude.wgsl");

/// A user's file.
#[derive(Debug)]
pub(super) struct Source {
    /// The name in errors.
    pub path: String,
    /// The file as it is.
    pub user: String,
    /// What is parsed.
    pub text: String,
}

impl Source {
    /// A file with the prelude.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] for a file that is too large, nested too deeply, or of another precision.
    pub fn new(path: &str, user: &str) -> Result<Self> {
        if user.len() > MOST_BYTES {
            return Err(Error::new(ErrorKind::Input, "the file of a law is too large")
                .at(path)
                .found(format!("more than {MOST_BYTES} bytes"))
                .wanted("256 KiB at most")
                .fix("leave out what the law does not need"));
        }
        let source = Self { path: path.to_owned(), user: user.to_owned(), text: format!("{user}\n{PRELUDE}") };
        source.check_words().map_err(|fault| source.error(*fault))?;
        Ok(source)
    }

    fn check_words(&self) -> Outcome<()> {
        let (mut nested, mut branches) = (0, 0);
        for token in tokens(&self.user) {
            let word = &self.user[token.range.clone()];
            let here = Span::new(token.range.start as u32, token.range.end as u32);
            if matches!(word, "f64" | "f16") {
                return Err(Fault::new(here, "a law is written in f32")
                    .found(format!("`{word}`"))
                    .fix("write f32; it is computed in f64 where a run asks for it"));
            }
            branches += usize::from(word == "else");
            nested = match token.kind {
                Kind::Mark if matches!(word, ";" | "{" | "}") => 0,
                Kind::Mark => nested + 1,
                _ => nested,
            };
            if nested > MOST_NESTED || branches > MOST_NESTED {
                return Err(Fault::new(here, "this is too long for one statement or one chain of `else`")
                    .wanted(format!("{MOST_NESTED} operators in a statement, {MOST_NESTED} `else` in a file"))
                    .fix("name parts of it with `let`, or put them in functions"));
            }
        }
        Ok(())
    }

    /// Whether a span of the parsed text lies in the user's part.
    pub fn is_user(&self, span: Span) -> bool {
        span.is_defined() && span.to_range().is_some_and(|range| range.start < self.user.len())
    }

    /// The error of a fault, at the line and column of the user's file.
    pub fn error(&self, mut fault: Fault) -> Error {
        if let Some(range) = fault.span.to_range() {
            // an error of what follows the file is one of its end
            let start = range.start.min(self.user.trim_end().len());
            fault.span = Span::new(start as u32, range.end.max(start) as u32);
        }
        self.error_in_file(fault)
    }

    fn error_in_file(&self, fault: Fault) -> Error {
        let place = match fault.span.to_range() {
            Some(range) => {
                let [line, column] = self.line(range.start);
                format!("{}:{line}:{column}", self.path)
            }
            _ => self.path.clone(),
        };
        let mut error = Error::new(ErrorKind::Input, fault.what).at(place);
        if let Some(found) = fault.found {
            error = error.found(found);
        }
        if let Some(wanted) = fault.wanted {
            error = error.wanted(wanted);
        }
        error.fix(fault.fix.as_deref().unwrap_or("correct this line; `gradreel check-law FILE` checks a law alone"))
    }

    /// The error of a fault at a range of the user's file.
    pub fn error_at(&self, range: Range<usize>, what: &str, found: &str, fix: &str) -> Error {
        let fault = Fault::new(Span::new(range.start as u32, range.end as u32), what);
        self.error_in_file(*fault.found(found).fix(fix))
    }

    /// Line and column, from 1, the column in characters.
    fn line(&self, at: usize) -> [usize; 2] {
        let mut at = at.min(self.user.len());
        while !self.user.is_char_boundary(at) {
            at -= 1;
        }
        let before = &self.user[..at];
        let start = before.rfind('\n').map_or(0, |end| end + 1);
        [before.matches('\n').count() + 1, before[start..].chars().count() + 1]
    }
}
