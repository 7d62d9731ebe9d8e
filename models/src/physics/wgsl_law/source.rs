//! The user's text, rewritten for the parser, and the way back to its lines.
//!
//! A law is written in `f32` and lowered in `f64`: number types and literals are renamed before parsing (`f32` becomes `f64`,
//! `0.1` becomes `0.1lf`), so that no constant is rounded. The prelude follows the user's text.

use std::ops::Range;

use gradreel::{Error, ErrorKind, Result};
use naga::Span;

use super::fault::{Fault, Outcome};
use super::lexer::{Kind, Token, tokens};

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
    /// Length of the user's part of `text`.
    len: usize,
    /// Replaced pieces, in order: range in `text`, range in `user`.
    replaced: Vec<(Range<usize>, Range<usize>)>,
}

impl Source {
    /// Rewrites a file.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] for a file that is too large or nested too deeply, and for types and numbers that a law cannot have.
    pub fn new(path: &str, user: &str) -> Result<Self> {
        let mut source = Self {
            path: path.to_owned(),
            user: user.to_owned(),
            text: String::new(),
            len: 0,
            replaced: Vec::new(),
        };
        if user.len() > MOST_BYTES {
            return Err(Error::new(ErrorKind::Input, "the file of a law is too large")
                .at(path)
                .found(format!("more than {MOST_BYTES} bytes"))
                .wanted("256 KiB at most"));
        }
        let all = tokens(user);
        source.rewrite(&all).map_err(|fault| source.error_in_file(*fault))?;
        source.len = source.text.len();
        source.text.push('\n');
        source.text.push_str(PRELUDE);
        Ok(source)
    }

    fn rewrite(&mut self, all: &[Token]) -> Outcome<()> {
        let user = self.user.clone();
        let (mut done, mut nested, mut branches) = (0, 0, 0);
        for token in all {
            let word = &user[token.range.clone()];
            let here = Span::new(token.range.start as u32, token.range.end as u32);
            let new = match token.kind {
                Kind::Word if word == "else" => {
                    branches += 1;
                    None
                }
                Kind::Word => renamed(word).map_err(|what| {
                    Fault::new(here, "a law is written in f32").found(what).fix("write f32, vec3<f32>, mat3x3<f32>")
                })?,
                Kind::Number => renumbered(word).map_err(|what| {
                    Fault::new(here, "this number cannot be used in a law").found(what).wanted("a number such as 0.5 or 1e-3")
                })?,
                Kind::Mark => {
                    nested = if matches!(word, ";" | "{" | "}") { 0 } else { nested + 1 };
                    None
                }
            };
            if nested > MOST_NESTED || branches > MOST_NESTED {
                return Err(Fault::new(here, "this is too long for one statement or one chain of `else`")
                    .wanted(format!("{MOST_NESTED} operators in a statement, {MOST_NESTED} `else` in a file"))
                    .fix("name parts of it with `let`, or put them in functions"));
            }
            let Some(new) = new else { continue };
            self.text.push_str(&user[done..token.range.start]);
            let start = self.text.len();
            self.text.push_str(&new);
            self.replaced.push((start..self.text.len(), token.range.clone()));
            done = token.range.end;
        }
        self.text.push_str(&user[done..]);
        Ok(())
    }

    /// Whether a span of the parsed text lies in the user's part.
    pub fn is_user(&self, span: Span) -> bool {
        span.is_defined() && span.to_range().is_some_and(|range| range.start < self.len)
    }

    /// The place in the user's file of an offset in the parsed text.
    fn original(&self, at: usize) -> usize {
        if at >= self.len {
            return self.user.len();
        }
        let next = self.replaced.partition_point(|(new, _)| new.start <= at);
        match next.checked_sub(1).map(|last| &self.replaced[last]) {
            None => at,
            Some((new, old)) if at < new.end => old.start,
            Some((new, old)) => old.end + (at - new.end),
        }
    }

    /// The text of the user's file at a span of the parsed text.
    pub fn words(&self, span: Span) -> Option<&str> {
        let range = span.to_range().filter(|_| self.is_user(span))?;
        self.user.get(self.original(range.start)..self.original(range.end).max(self.original(range.start)))
    }

    /// The error of a fault, at the line and column of the user's file.
    pub fn error(&self, mut fault: Fault) -> Error {
        let range = fault.span.to_range().map(|range| self.original(range.start)..self.original(range.end));
        fault.span = range.map_or_else(Span::default, |range| {
            // an error of what follows the file is one of its end
            let start = range.start.min(self.user.trim_end().len());
            Span::new(start as u32, range.end.max(start) as u32)
        });
        self.error_in_file(fault)
    }

    /// The error of a fault whose span is one of the user's file.
    fn error_in_file(&self, fault: Fault) -> Error {
        let place = match fault.span.to_range() {
            Some(range) if fault.span.is_defined() => {
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
        if let Some(fix) = fault.fix {
            error = error.fix(fix);
        }
        error
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

/// The name in `f64` of a type in `f32`, if the word is one; an error for types of other precision.
fn renamed(word: &str) -> Result<Option<String>, String> {
    let sized = |word: &str| word.starts_with("vec") || word.starts_with("mat");
    match word {
        "f32" => Ok(Some("f64".to_owned())),
        "f64" | "f16" => Err(format!("`{word}`")),
        // vec3f, mat3x3f
        _ if sized(word) && matches!(word.len(), 5 | 7) && word[3..].starts_with(|c: char| c.is_ascii_digit()) => {
            match word.strip_suffix('f') {
                Some(base) => Ok(Some(format!("{base}<f64>"))),
                None if word.ends_with('h') => Err(format!("`{word}`")),
                None => Ok(None),
            }
        }
        _ => Ok(None),
    }
}

/// A number as a literal of `f64`, if it is no integer.
fn renumbered(word: &str) -> Result<Option<String>, String> {
    let hexadecimal = word.starts_with("0x") || word.starts_with("0X");
    if hexadecimal {
        let whole = word[2..].chars().all(|c| c.is_ascii_hexdigit() || matches!(c, 'u' | 'i'));
        return if whole { Ok(None) } else { Err(format!("`{word}`, a hexadecimal fraction")) };
    }
    let digits = word.trim_end_matches(['f', 'h', 'l', 'u', 'i']);
    match &word[digits.len()..] {
        "f" => Ok(Some(format!("{digits}lf"))),
        "" if digits.contains(['.', 'e', 'E']) => Ok(Some(format!("{digits}lf"))),
        "" | "u" | "i" => Ok(None),
        _ => Err(format!("`{word}`")),
    }
}
