//! A Markdown file of measured results; each command replaces its own section and leaves the others unchanged.
//!
//! A section stands between the markers `<!-- begin: NAME -->` and `<!-- end: NAME -->`. It begins with the
//! conditions of the measurement: machine, instruction set, commit, date, data split and command. Its text is
//! generated completely.

use std::path::Path;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use gradreel::{Error, ErrorKind, Result};

/// One section.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Name in the markers.
    pub name: String,
    /// Heading.
    pub title: String,
    /// Data split: development or report data, and which clips.
    pub split: String,
    /// Tables and text in Markdown.
    pub body: String,
}

/// Conditions of a measurement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Measured {
    /// Processor, and number of available cores.
    pub machine: String,
    /// Instruction set of the kernels.
    pub instruction_set: String,
    /// Version and commit of the program's sources.
    pub commit: String,
    /// The day, `YYYY-MM-DD` in UTC.
    pub date: String,
    /// The command line.
    pub command: String,
}

impl Measured {
    /// Conditions of this process at this time; `program` replaces the program's own path in the command line.
    pub fn here(program: &str) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let arguments = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
        Self {
            machine: format!("{}, {cores} cores", processor()),
            instruction_set: gradreel::isa().to_owned(),
            commit: format!("{} ({})", env!("CARGO_PKG_VERSION"), commit()),
            date: date(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())),
            command: [program.to_owned()].into_iter().chain(arguments).collect::<Vec<_>>().join(" "),
        }
    }
}

/// Replaces a section of a file, or appends it; creates the file if necessary.
///
/// # Errors
/// [`ErrorKind::Input`] for a file that cannot be read or written or is not UTF-8, or if the section's markers are
/// not one pair in order; nothing is written then.
pub fn replace(file: &Path, section: &Section, measured: &Measured) -> Result<()> {
    let before = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => "# Results\n".to_owned(),
        Err(e) => return Err(Error::io(file, "read the file of results", &e)),
    };
    let after = replaced(&before, section, measured).map_err(|e| e.within(file.display()))?;
    std::fs::write(file, after)
        .map_err(|e| Error::io(file, "write the file of results", &e).fix("name another file with --markdown"))
}

/// The text with its section replaced or appended.
///
/// # Errors
/// [`ErrorKind::Input`] if the section's markers are not one pair in order.
pub fn replaced(text: &str, section: &Section, measured: &Measured) -> Result<String> {
    let Section { name, title, split, body } = section;
    let [begin, end] = ["begin", "end"].map(|which| format!("<!-- {which}: {name} -->"));
    let Measured { machine, instruction_set, commit, date, command } = measured;
    let whole = format!(
        "{begin}\n\n## {title}\n\n| | |\n| --- | --- |\n| machine | {} |\n| instruction set | {instruction_set} |\n| version | {commit} |\n\
         | date | {date} |\n| split | {} |\n| command | `{}` |\n\n{}\n\n{end}",
        cell(machine),
        cell(split),
        cell(command),
        body.trim()
    );
    let places = |marker: &str| text.match_indices(marker).map(|(at, _)| at).collect::<Vec<_>>();
    match (&places(&begin)[..], &places(&end)[..]) {
        ([], []) => Ok(format!("{}\n\n{whole}\n", text.trim_end())),
        ([from], [to]) if from < to => Ok(format!("{}{whole}{}", &text[..*from], &text[to + end.len()..])),
        (begins, ends) => Err(Error::new(ErrorKind::Input, "the markers of a section are damaged")
            .at(name)
            .found(format!("{} times `{begin}`, {} times `{end}`", begins.len(), ends.len()))
            .wanted("each once, in this order, or neither")
            .fix("repair them, or delete both with what is between them")),
    }
}

/// Escapes text for a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

/// Quotes a word for the shell.
fn quoted(word: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "-_=./,:+@%".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Name of the processor, or its architecture if unknown.
fn processor() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
    model.map_or_else(|| std::env::consts::ARCH.to_owned(), str::to_owned)
}

/// Commit of the sources from which the program was built, if they still exist.
fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(["-C", env!("CARGO_MANIFEST_DIR")]).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    match (
        git(&["rev-parse", "--short=12", "HEAD"]),
        git(&["status", "--porcelain", "--untracked-files=no", "--", "*.rs"]),
    ) {
        (Some(commit), Some(changes)) if changes.is_empty() => commit,
        (Some(commit), _) => format!("{commit} with changes"),
        (None, _) => "no commit known".to_owned(),
    }
}

/// Date for a Unix time in seconds, in UTC and the Gregorian calendar.
fn date(seconds: u64) -> String {
    let (mut year, mut day) = (1970, seconds / 86_400);
    let leap = |year: u64| u64::from(year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)));
    while day >= 365 + leap(year) {
        day -= 365 + leap(year);
        year += 1;
    }
    let lengths = [31, 28 + leap(year), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while day >= lengths[month] {
        day -= lengths[month];
        month += 1;
    }
    format!("{year:04}-{:02}-{:02}", month + 1, day + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days() {
        for (seconds, wanted) in [
            (0, "1970-01-01"),
            (951_782_400, "2000-02-29"),
            (1_709_251_199, "2024-02-29"),
            (1_735_689_599, "2024-12-31"),
            (4_107_542_400, "2100-03-01"),
        ] {
            assert_eq!(date(seconds), wanted);
        }
    }

    #[test]
    fn words_of_a_command() {
        assert_eq!([quoted("--off=30"), quoted("my clip"), quoted("")], ["--off=30", "'my clip'", "''"]);
    }
}
