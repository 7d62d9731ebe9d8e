//! One error type: what went wrong, where, what was found, what was wanted, and what to do.
//!
//! A wrong shape in a program is the programmer's mistake and panics at the caller's line. Everything that can go wrong
//! *because of the world* (data, files, devices, shaders, physics, non-finite numbers) is an [`Error`].

use std::borrow::Cow;
use std::fmt;

/// The result of anything that can fail because of data, devices or physics.
///
/// ```
/// fn half(x: f64) -> gradreel::Result<f64> { Ok(0.5 * x) }
/// assert_eq!(half(4.0)?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What kind of fault an [`Error`] reports; decides the exit code of the command line.
///
/// ```
/// use gradreel::{Error, ErrorKind};
/// let error = Error::new(ErrorKind::Input, "the film has no frames");
/// assert_eq!(error.kind(), ErrorKind::Input);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// Shapes or dtypes do not fit an op.
    Shape,
    /// A file, folder, image or value given by the user cannot be used.
    Input,
    /// Reading or writing failed in the operating system.
    Io,
    /// A compute device is missing, was lost, or refused a request.
    Device,
    /// The op has no kernel for this device or dtype.
    Unsupported,
    /// The simulated physics broke down: unstable step, particle outside the grid.
    Physics,
    /// A value or a gradient turned NaN or infinite.
    NonFinite,
    /// A gradient was asked for that does not exist.
    NoGradient,
    /// The user asked to stop.
    Interrupted,
}

/// What went wrong, where, what was found, what was wanted, and what to do about it.
///
/// ```
/// use gradreel::{Error, ErrorKind};
///
/// let error = Error::new(ErrorKind::Input, "cannot read the camera file")
///     .at("clip/all_data.json")
///     .found("an empty file")
///     .wanted("a JSON list with one entry per image")
///     .fix("export the clip again");
/// assert_eq!(error.kind(), ErrorKind::Input);
/// assert!(error.to_string().contains("clip/all_data.json"));
/// ```
#[derive(Clone)]
pub struct Error(Box<Detail>);

#[derive(Clone)]
struct Detail {
    kind: ErrorKind,
    what: String,
    at: Option<String>,
    found: Option<String>,
    wanted: Option<String>,
    fix: Option<String>,
}

impl Error {
    /// An error of this kind; `what` is one short clause without a full stop.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// assert_eq!(Error::new(ErrorKind::Shape, "no axis 3").kind(), ErrorKind::Shape);
    /// ```
    pub fn new(kind: ErrorKind, what: impl Into<String>) -> Self {
        Self(Box::new(Detail { kind, what: what.into(), at: None, found: None, wanted: None, fix: None }))
    }

    /// Names the file, op or particle concerned.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Input, "the film is too short").at("film.gif");
    /// assert!(error.to_string().contains("film.gif"));
    /// ```
    #[must_use]
    pub fn at(mut self, place: impl fmt::Display) -> Self {
        self.0.at = Some(place.to_string());
        self
    }

    /// Puts a larger place, such as a file, before the place that is named already.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Input, "the film is too short").within("clip.toml");
    /// assert!(error.to_string().contains("clip.toml"));
    /// ```
    #[must_use]
    pub fn within(mut self, place: impl fmt::Display) -> Self {
        self.0.at = Some(match self.0.at.take() {
            Some(inner) => format!("{place}: {inner}"),
            None => place.to_string(),
        });
        self
    }

    /// Says what was found there.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Input, "the film is too short").found("0 frames");
    /// assert!(error.to_string().contains("0 frames"));
    /// ```
    #[must_use]
    pub fn found(mut self, found: impl fmt::Display) -> Self {
        self.0.found = Some(found.to_string());
        self
    }

    /// Says what would have been right.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Input, "the film is too short").wanted("3 frames at least");
    /// assert!(error.to_string().contains("3 frames at least"));
    /// ```
    #[must_use]
    pub fn wanted(mut self, wanted: impl fmt::Display) -> Self {
        self.0.wanted = Some(wanted.to_string());
        self
    }

    /// Says what the user can do.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Input, "the film is too short").fix("give a longer film");
    /// assert!(error.to_string().contains("give a longer film"));
    /// ```
    #[must_use]
    pub fn fix(mut self, fix: impl fmt::Display) -> Self {
        self.0.fix = Some(fix.to_string());
        self
    }

    /// The same error as another kind of fault, such as physics that cannot work because of what the user gave.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let error = Error::new(ErrorKind::Physics, "the step is unstable").with_kind(ErrorKind::Input);
    /// assert_eq!(error.kind(), ErrorKind::Input);
    /// ```
    #[must_use]
    pub fn with_kind(mut self, kind: ErrorKind) -> Self {
        self.0.kind = kind;
        self
    }

    /// The kind of fault.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// assert_eq!(Error::new(ErrorKind::Input, "no frames").kind(), ErrorKind::Input);
    /// ```
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// What went wrong, where and what was found there in one line, for lists of many.
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    ///
    /// let error = Error::new(ErrorKind::Input, "this is no number").at("line 2").found("`x`").fix("export it again");
    /// assert_eq!(error.in_short(), "this is no number; at: line 2; found: `x`");
    /// ```
    pub fn in_short(&self) -> String {
        let Detail { what, at, found, .. } = &*self.0;
        let told = [("at", at), ("found", found)].into_iter().filter_map(|(label, text)| Some((label, text.as_ref()?)));
        told.fold(what.clone(), |line, (label, text)| line + "; " + label + ": " + &with_short_numbers(text))
    }

    /// An operating-system fault at a path.
    ///
    /// What another path or another file would mend is the user's input ([`ErrorKind::Input`]): a file that is missing,
    /// unreadable, no file, no folder or no UTF-8 text, a name that the system does not take, a place where nothing can be
    /// written. Anything else, such as a full disk, is [`ErrorKind::Io`].
    ///
    /// ```
    /// use gradreel::{Error, ErrorKind};
    /// let missing = std::fs::read("no-such-file").unwrap_err();
    /// assert_eq!(Error::io("no-such-file", "read the film", &missing).kind(), ErrorKind::Input);
    /// ```
    pub fn io(path: impl AsRef<std::path::Path>, doing: &str, source: &std::io::Error) -> Self {
        use std::io::ErrorKind as System;
        let kind = match source.kind() {
            System::NotFound | System::PermissionDenied | System::ReadOnlyFilesystem => ErrorKind::Input,
            System::IsADirectory | System::NotADirectory | System::AlreadyExists => ErrorKind::Input,
            System::InvalidFilename | System::InvalidInput | System::InvalidData => ErrorKind::Input,
            _ => ErrorKind::Io,
        };
        Self::new(kind, format!("cannot {doing}")).at(path.as_ref().display()).found(source)
    }
}

/// The same text with a power of ten in every number that has more digits than anybody reads: of 30 digits before the point,
/// or with 20 zeros in a row. Names, which touch letters or slashes, stay as they are.
fn with_short_numbers(text: &str) -> Cow<'_, str> {
    let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let touches = |c: char| c.is_alphanumeric() || "_/\\`\"'".contains(c);
    if text.len() < 20 {
        return text.into();
    }
    let (mut short, mut rest) = (String::new(), text);
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let before = short.chars().next_back().filter(|_| start == 0).or(rest[..start].chars().next_back());
        short += &rest[..start];
        rest = &rest[start..];
        let whole = digits(rest);
        let fraction = rest[whole..].strip_prefix('.').map_or(0, digits);
        let (number, after) = rest.split_at(if fraction > 0 { whole + 1 + fraction } else { whole });
        let long = whole >= 30 || number.contains("00000000000000000000");
        let named = before.is_some_and(touches)
            || after.trim_start_matches('.').chars().next().is_some_and(|c| touches(c) && !after.starts_with(".."));
        match number.parse::<f64>() {
            Ok(value) if long && !named => short += &format!("{value:e}"),
            _ => short += number,
        }
        rest = after;
    }
    (short + rest).into()
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Detail { what, at, found, wanted, fix, .. } = &*self.0;
        write!(f, "{what}")?;
        for (label, text) in [("at", at), ("found", found), ("wanted", wanted), ("fix", fix)] {
            if let Some(text) = text {
                write!(f, "\n  {label:>6}: {}", with_short_numbers(text))?;
            }
        }
        Ok(())
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {self}", self.0.kind)
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_more_digits_than_anybody_reads_get_a_power_of_ten() {
        for (text, wanted) in [
            (format!("{} m and {} s.", 1e300, -2.5e-30), "1e300 m and -2.5e-30 s."),
            (format!("[{:.3}, 3.25..{}]", 1e40, 1e22), "[1e40, 3.25..1e22]"),
            (format!("{} of 10000000000 ... 0.1.", 1e15), "1000000000000000 of 10000000000 ... 0.1."),
            ("clip/000000000000000000000001.png".into(), "clip/000000000000000000000001.png"),
            ("000000000000000000000001.png".into(), "000000000000000000000001.png"),
            ("é 5 µ".repeat(5), "é 5 µé 5 µé 5 µé 5 µé 5 µ"),
        ] {
            assert_eq!(with_short_numbers(&text), wanted);
        }
        let error = Error::new(ErrorKind::Input, "too large").found(format!("{} Pa", 1e300));
        assert_eq!(error.to_string(), "too large\n   found: 1e300 Pa");
        assert_eq!(error.in_short(), "too large; found: 1e300 Pa");
    }

    #[test]
    fn what_another_path_would_mend_is_input() {
        let of = |kind: std::io::ErrorKind| Error::io("file", "read it", &kind.into()).kind();
        use std::io::ErrorKind as System;
        for kind in [System::InvalidFilename, System::IsADirectory, System::NotADirectory, System::InvalidData] {
            assert_eq!(of(kind), ErrorKind::Input, "{kind}");
        }
        assert_eq!(of(System::StorageFull), ErrorKind::Io);
    }
}
