//! Text files that a person wrote.

use std::io::Read;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Bytes that a file of settings may have at most.
const MOST: u64 = 16 << 20;

/// The text of a file, without a byte order mark; `what` it is to be.
///
/// # Errors
/// [`ErrorKind::Input`] for a file that cannot be read, is longer than 16 MiB, or is not UTF-8.
pub(super) fn read(path: &Path, what: &str) -> Result<String> {
    let fix = "give the path of a TOML file to --config";
    let failed = |e: &std::io::Error| Error::io(path, &format!("read {what}"), e).fix(fix);
    let refused = |found: &str| {
        Error::new(ErrorKind::Input, format!("cannot read {what}")).at(path.display()).found(found.to_owned())
    };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| failed(&e))?;
    file.take(MOST + 1).read_to_end(&mut bytes).map_err(|e| failed(&e))?;
    if bytes.len() as u64 > MOST {
        return Err(refused("more than 16 MiB").wanted("a TOML file").fix(fix));
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        refused(&format!("bytes that are no UTF-8 text in line {line}")).fix("save it as UTF-8")
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}
