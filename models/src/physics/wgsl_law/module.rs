//! Parsing and validation.

use gradreel::Result;
use naga::front::wgsl::{Frontend, Options, ParseError};
use naga::valid::{Capabilities, ModuleInfo, ValidationError, ValidationFlags, Validator};
use naga::{Module, Span, WithSpan};

use super::fault::Fault;
use super::source::Source;

/// The stack of the thread that parses \[bytes\]; the parser is recursive.
const STACK: usize = 64 << 20;

/// A valid module of WGSL.
#[derive(Debug)]
pub(super) struct Parsed {
    pub source: Source,
    pub module: Module,
    pub info: ModuleInfo,
}

impl Parsed {
    /// Parses and validates a file with the prelude.
    ///
    /// # Errors
    ///
    /// [`gradreel::ErrorKind::Input`] with line and column for text that is not valid WGSL.
    pub fn new(path: &str, user: &str) -> Result<Self> {
        let source = Source::new(path, user)?;
        let found =
            std::thread::scope(|scope| {
                let parse = || parse(&source);
                match std::thread::Builder::new().stack_size(STACK).spawn_scoped(scope, parse) {
                    Ok(thread) => thread.join().unwrap_or_else(|_| {
                        Err(Fault::new(Span::default(), "the parser of WGSL fails on this file")
                            .fix("write it more simply"))
                    }),
                    Err(error) => Err(Fault::new(Span::default(), "no thread can be started to parse the file")
                        .found(error.to_string())),
                }
            });
        match found {
            Ok((module, info)) => Ok(Self { source, module, info }),
            Err(fault) => Err(source.error(*fault)),
        }
    }
}

fn parse(source: &Source) -> Result<(Module, ModuleInfo), Box<Fault>> {
    let options = Options { parse_doc_comments: true, capabilities: Capabilities::empty() };
    let module =
        Frontend::new_with_options(options).parse(&source.text).map_err(|error| parse_fault(source, &error))?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    let info = validator.validate(&module).map_err(|error| validation_fault(source, error))?;
    Ok((module, info))
}

fn parse_fault(source: &Source, error: &ParseError) -> Box<Fault> {
    let all: Vec<(Span, &str)> = error.labels().collect();
    // of several places the user's is meant, not the prelude's
    let label = all.iter().find(|(span, _)| source.is_user(*span)).or(all.first());
    let (span, label) = label.map_or((Span::default(), ""), |&(span, label)| (span, label));
    let mut fault = Fault::new(span, format!("this is not valid WGSL: {}", plain(error.message())));
    if !label.is_empty() {
        fault = fault.found(plain(label));
    }
    match error.notes().next() {
        Some(note) => fault.fix(plain(note)),
        None => fault,
    }
}

fn validation_fault(source: &Source, error: WithSpan<ValidationError>) -> Box<Fault> {
    let all: Vec<Span> = error.spans().map(|(span, _)| *span).collect();
    let span = all.iter().rev().find(|span| source.is_user(**span)).or(all.first()).copied().unwrap_or_default();
    let mut cause: &dyn std::error::Error = error.as_inner();
    while let Some(deeper) = cause.source() {
        cause = deeper;
    }
    Fault::new(span, format!("this is not valid WGSL: {}", plain(&cause.to_string())))
}

/// A message of the parser on one line.
fn plain(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
