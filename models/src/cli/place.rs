//! Checking the output folder before any computation.

use std::fs;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::runtime::run_folder::RunFolder;

/// Checks that a new run can be written to `out`, which must not lie within its input `source`.
///
/// # Errors
/// [`ErrorKind::Input`] as [`RunFolder::can_be_created`], and for a folder within `source`, a name that is too
/// long, or a location without write permission.
pub(super) fn check(out: &Path, source: Option<&Path>) -> Result<()> {
    RunFolder::can_be_created(out)?;
    let above = out.ancestors().map(|path| if path.as_os_str().is_empty() { Path::new(".") } else { path });
    let above = above.into_iter().find(|path| path.exists()).unwrap_or(Path::new("."));
    let failed = |path: &Path, e: &std::io::Error| {
        Error::io(path, "make the folder of the run", e).fix("name another folder with `--out`")
    };
    let whole = above.canonicalize().map_err(|e| failed(above, &e))?;
    let rest = out.strip_prefix(above).unwrap_or(if above == Path::new(".") { out } else { Path::new("") });
    for part in rest.components() {
        // the system tells whether it accepts the names of folders yet to be created
        match fs::symlink_metadata(whole.join(part)) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(failed(out, &e)),
            _ => {}
        }
    }
    let source = source.and_then(|path| path.canonicalize().ok()).filter(|path| path.is_dir());
    if let Some(source) = source.filter(|source| whole.join(rest).starts_with(source)) {
        return Err(Error::new(ErrorKind::Input, "the results would lie among what they are made from")
            .at(out.display())
            .found(format!("a folder within {}", source.display()))
            .fix("name a folder outside of it with `--out`"));
    }
    writable(&whole).map_err(|e| failed(out, &e))
}

/// Tests write permission in a folder with a temporary file.
fn writable(folder: &Path) -> std::io::Result<()> {
    let trial: PathBuf = folder.join(format!(".gradreel-{}.partial", std::process::id()));
    fs::File::create(&trial)?;
    fs::remove_file(&trial)
}
