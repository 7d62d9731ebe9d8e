//! The folder of results, looked at before any work is done for it.

use std::fs;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::report::run_folder::RunFolder;

/// Whether a new run can be written to a folder; what is read for it, `source`, is not to hold it.
///
/// # Errors
/// [`ErrorKind::Input`] as [`RunFolder::can_be_created`], and for a folder within `source`, a name that is too long, or a place
/// where nothing can be written.
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
        // names of folders that are still to be made: the system says whether it takes them
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

/// Tries to write to a folder, and leaves nothing there.
fn writable(folder: &Path) -> std::io::Result<()> {
    let trial: PathBuf = folder.join(format!(".gradreel-{}.partial", std::process::id()));
    fs::File::create(&trial)?;
    fs::remove_file(&trial)
}
