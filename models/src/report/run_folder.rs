//! The one folder a run writes: made new, never over something else, and never with half a file in it.
//!
//! Every file is written beside its final name and then renamed onto it. A full disk, a crash or an interrupt therefore
//! leaves either the old file or the new one.

use std::fs::{self, File, TryLockError};
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gradreel::{Error, ErrorKind, Result};

use crate::text;

/// The file that tells other processes that the run is being written.
const LOCK: &str = ".lock";

/// Longest folder name [`next_free`] makes, in characters, before the number.
const LONGEST_NAME: usize = 60;

/// The folder of one run; names of files in it are relative, with `/` between the parts.
///
/// ```
/// use gradreel_models::report::run_folder::RunFolder;
///
/// # fn main() -> gradreel::Result<()> {
/// let path = std::env::temp_dir().join(format!("gradreel-doc-{}", std::process::id()));
/// let run = RunFolder::create(&path)?;
/// run.write("frames/000.ply", b"ply")?;
/// assert_eq!(run.read("frames/000.ply")?, b"ply");
/// assert!(RunFolder::create(&path).is_err(), "a second run never writes over the first");
/// # std::fs::remove_dir_all(&path).unwrap();
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct RunFolder {
    root: PathBuf,
    /// Writes until the disk counts as full; without end if nothing is said.
    writes_left: Option<Arc<AtomicU64>>,
    /// Held as long as the run is written: the system lets go of it when the process ends, however it ends.
    _lock: Option<Arc<File>>,
}

impl RunFolder {
    /// Makes the folder of a new run, with its parents. An empty folder that exists already is taken as it is.
    ///
    /// # Errors
    ///
    /// The path is a file or a folder with something in it (nothing there is changed), or the folder cannot be made.
    pub fn create(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists | std::io::ErrorKind::NotADirectory => not_a_folder(path),
            _ => Error::io(path, "make the folder of the run", &e),
        })?;
        let run = Self { root: path.to_path_buf(), writes_left: None, _lock: None };
        run.sweep();
        let entries = fs::read_dir(path).map_err(|e| Error::io(path, "look into the folder of the run", &e))?;
        let entries = entries.filter(|entry| !entry.as_ref().is_ok_and(|entry| entry.file_name() == LOCK)).count();
        if entries > 0 {
            return Err(Error::new(ErrorKind::Input, "the folder of the run is not empty")
                .at(path.display())
                .found(format!("{entries} {}", if entries == 1 { "entry" } else { "entries" }))
                .wanted("a new or empty folder, so that no earlier result is written over")
                .fix("continue the run in it with `--resume`, or name another folder with `--out`"));
        }
        run.claimed()
    }

    /// Makes a folder of its own below `base`, named as [`next_free`] says. Of two runs that begin at once, each gets
    /// another one.
    ///
    /// # Errors
    ///
    /// `base` is a file, or a folder cannot be made in it.
    pub fn create_free(base: &Path, name: &str) -> Result<Self> {
        let failed = |path: &Path, e: &std::io::Error| Error::io(path, "make the folder of the run", e);
        fs::create_dir_all(base).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists | std::io::ErrorKind::NotADirectory => not_a_folder(base),
            _ => failed(base, &e),
        })?;
        loop {
            let root = next_free(base, name);
            match fs::create_dir(&root) {
                Ok(()) => return Self { root, writes_left: None, _lock: None }.claimed(),
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(failed(&root, &e)),
            }
        }
    }

    /// Opens the folder of an earlier run.
    ///
    /// # Errors
    ///
    /// The path does not exist or is not a folder.
    pub fn open(path: &Path) -> Result<Self> {
        let found = fs::metadata(path).map_err(|e| {
            Error::io(path, "open the folder of the run", &e).fix("give the folder of an interrupted run to --out")
        })?;
        if !found.is_dir() {
            return Err(not_a_folder(path));
        }
        Ok(Self { root: path.to_path_buf(), writes_left: None, _lock: None })
    }

    /// Opens the folder of an earlier run to go on with it: nobody else does at the same time.
    ///
    /// # Errors
    ///
    /// As [`RunFolder::open`], and [`ErrorKind::Input`] when another process writes to the folder.
    pub fn resume(path: &Path) -> Result<Self> {
        let run = Self::open(path)?;
        // a folder that is no run's is left as it is
        if run.has(LOCK) { run.claimed() } else { Ok(run) }
    }

    fn claimed(self) -> Result<Self> {
        let path = self.path(LOCK);
        let file = File::create(&path).map_err(|e| Error::io(&path, "write to the folder of the run", &e))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => {
                Err(Error::new(ErrorKind::Input, "another process is at work on the run in this folder")
                    .at(self.root.display())
                    .fix("wait until it ends, or stop it; or name another folder with `--out`"))
            }
            // file systems without locks leave it to the user
            Err(TryLockError::Error(_)) => Ok(self),
            Ok(()) => Ok(Self { _lock: Some(Arc::new(file)), ..self }),
        }
    }

    /// The same folder on a disk that is full after so many writes. To what is in the folder that is what being killed there is,
    /// so that every moment of a run can be tried.
    #[doc(hidden)]
    #[must_use]
    pub fn failing_after(self, writes: u64) -> Self {
        Self { writes_left: Some(Arc::new(AtomicU64::new(writes))), ..self }
    }

    /// Whether there is something to go on with: `missing` says what there is not when this file is not here.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when it is not.
    pub fn goes_on(&self, name: &str, missing: &str, fix: &str) -> Result<()> {
        if self.has(name) {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, missing).at(self.path(name).display()).found("no such file").fix(fix))
    }

    /// Removes what writes that were cut off have left. Only for a folder that nobody else is writing to.
    pub fn sweep(&self) {
        let folders = |path: &Path| fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
        for path in folders(&self.root) {
            let below = if path.is_dir() { folders(&path).collect() } else { Vec::new() };
            for file in below.iter().chain([&path]) {
                let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
                if name.starts_with('.') && name.ends_with(".partial") {
                    // what cannot be removed is hidden and never read
                    let _ = fs::remove_file(file);
                }
            }
        }
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where a file of this run lies or would lie.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.root.join(relative)
    }

    /// Writes a whole file, making the folders above it. A file of that name is replaced in one step.
    ///
    /// # Errors
    ///
    /// The name leads out of the folder, or the operating system refuses (disk full, no permission, a folder of that
    /// name). The file that was there before is then untouched.
    pub fn write(&self, relative: &str, bytes: &[u8]) -> Result<()> {
        let target = self.inside(relative)?;
        let take = |left: u64| left.checked_sub(1);
        if self
            .writes_left
            .as_ref()
            .is_some_and(|left| left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err())
        {
            return Err(Error::io(&target, "write a file of the run", &std::io::ErrorKind::StorageFull.into()));
        }
        let parent = target.parent().expect("a name inside a folder has a parent");
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, "make a folder of the run", &e))?;
        let partial = partial_name(&target);
        let written = write_through(&partial, bytes).and_then(|()| fs::rename(&partial, &target));
        written.map_err(|e| {
            // The first fault is the one to report; the leftover is hidden and never read.
            let _ = fs::remove_file(&partial);
            Error::io(&target, "write a file of the run", &e)
        })
    }

    /// Reads a whole file.
    ///
    /// # Errors
    ///
    /// The name leads out of the folder, or the file is missing or unreadable.
    pub fn read(&self, relative: &str) -> Result<Vec<u8>> {
        let path = self.inside(relative)?;
        fs::read(&path).map_err(|e| {
            Error::io(&path, "read a file of the run", &e).fix("start again with another `--out`, if it is lost")
        })
    }

    /// Reads a whole file of text; a byte order mark in front is no part of it.
    ///
    /// # Errors
    ///
    /// As [`RunFolder::read`], and [`ErrorKind::Input`] for a file that is not UTF-8.
    pub fn read_text(&self, relative: &str) -> Result<String> {
        let bytes = self.read(relative)?;
        Ok(text::of(&bytes).map_err(|e| e.within(self.path(relative).display()))?.to_owned())
    }

    /// Whether the run has this file.
    pub fn has(&self, relative: &str) -> bool {
        self.path(relative).is_file()
    }

    fn inside(&self, relative: &str) -> Result<PathBuf> {
        let plain = |part| matches!(part, Component::Normal(_));
        if relative.is_empty() || !Path::new(relative).components().all(plain) {
            return Err(Error::new(ErrorKind::Input, "the name of a file leads out of the folder of the run")
                .at(self.root.display())
                .found(format!("`{relative}`"))
                .wanted("a relative name such as `frames/000.ply`"));
        }
        Ok(self.path(relative))
    }
}

/// A folder below `base` that does not exist yet: `base/name`, else `base/name-2`, `base/name-3`, …
///
/// Letters, digits, `-`, `_` and inner dots of the name are kept; every run of other characters becomes one `-`.
/// A name of which nothing is left becomes `run`.
pub fn next_free(base: &Path, name: &str) -> PathBuf {
    let name = plain_name(name);
    let taken = |path: &PathBuf| fs::symlink_metadata(path).is_ok();
    let numbered = (2u64..).map(|number| base.join(format!("{name}-{number}")));
    std::iter::once(base.join(&name)).chain(numbered).find(|path| !taken(path)).expect("the numbers do not end")
}

fn plain_name(name: &str) -> String {
    let mut plain = String::new();
    for letter in name.chars().take(LONGEST_NAME) {
        if letter.is_alphanumeric() || matches!(letter, '_' | '.') {
            plain.push(letter);
        } else if !plain.ends_with('-') {
            plain.push('-');
        }
    }
    let plain = plain.trim_matches(['-', '.']);
    if plain.is_empty() { "run".into() } else { plain.into() }
}

/// A hidden name beside the target that no other writer of this or another process uses.
fn partial_name(target: &Path) -> PathBuf {
    static WRITES: AtomicU64 = AtomicU64::new(0);
    let number = WRITES.fetch_add(1, Ordering::Relaxed);
    let name = target.file_name().expect("checked to be a plain name").to_string_lossy();
    target.with_file_name(format!(".{name}.{}-{number}.partial", std::process::id()))
}

fn write_through(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

fn not_a_folder(path: &Path) -> Error {
    Error::new(ErrorKind::Input, "the folder of the run is not a folder")
        .at(path.display())
        .found("a file, here or above")
        .wanted("a folder")
        .fix("name another folder with `--out`")
}
