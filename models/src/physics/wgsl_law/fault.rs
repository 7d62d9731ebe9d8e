//! A fault in the text of a law: where, what, and what to do.

use naga::Span;

/// What is wrong at a span of the text that was parsed; [`super::source::Source::error`] names the line of the user's file.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    pub span: Span,
    pub what: String,
    pub found: Option<String>,
    pub wanted: Option<String>,
    pub fix: Option<String>,
}

pub(super) type Outcome<T> = Result<T, Box<Fault>>;

impl Fault {
    pub fn new(span: Span, what: impl Into<String>) -> Box<Self> {
        Box::new(Self { span, what: what.into(), found: None, wanted: None, fix: None })
    }

    /// What the lowering does not know.
    pub fn unsupported(span: Span, what: &str) -> Box<Self> {
        Self::new(span, format!("{what} cannot be used in a law"))
    }

    pub fn found(mut self: Box<Self>, found: impl Into<String>) -> Box<Self> {
        self.found = Some(found.into());
        self
    }

    pub fn wanted(mut self: Box<Self>, wanted: impl Into<String>) -> Box<Self> {
        self.wanted = Some(wanted.into());
        self
    }

    pub fn fix(mut self: Box<Self>, fix: impl Into<String>) -> Box<Self> {
        self.fix = Some(fix.into());
        self
    }
}
