//! The output folder of a run: newly created, never overwritten, and never with partial files.
//!
//! Every file is written under a temporary name and then renamed. After a full disk, a crash or an interrupt, each
//! file thus has either its old or its new content.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gradreel::{Error, ErrorKind, Result};

use crate::text;

/// File that marks the folder as in use by a running process.
const LOCK: &str = ".lock";

/// Maximum length of a folder name made by [`next_free`], in characters, before the number.
const LONGEST_NAME: usize = 60;

/// The output folder of one run; file names are relative, with `/` as separator.
///
/// ```
/// use gradreel_models::runtime::run_folder::RunFolder;
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
    /// Number of writes until the simulated disk is full; unlimited if `None`.
    writes_left: Option<Arc<AtomicU64>>,
    /// Lock held while the run is written; the system releases it when the process ends.
    _lock: Option<Arc<File>>,
}

impl RunFolder {
    /// Creates the folder of a new run, with its parents. An existing empty folder is accepted.
    ///
    /// # Errors
    ///
    /// As [`RunFolder::can_be_created`], which changes nothing, or if the folder cannot be created.
    pub fn create(path: &Path) -> Result<Self> {
        Self::can_be_created(path)?;
        fs::create_dir_all(path).map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => not_a_folder(path),
            _ => Error::io(path, "make the folder of the run", &e).fix("name another folder with `--out`"),
        })?;
        let run = Self { root: path.to_path_buf(), writes_left: None, _lock: None }.claimed()?;
        // no other process writes here from now on
        run.sweep();
        Ok(run)
    }

    /// Checks without any changes whether [`RunFolder::create`] would accept this path: to be called before a long
    /// computation whose result goes there.
    ///
    /// ```
    /// use gradreel_models::runtime::run_folder::RunFolder;
    ///
    /// let folder = std::env::temp_dir().join("gradreel-doc-there-is-no-such-folder");
    /// assert!(RunFolder::can_be_created(&folder).is_ok());
    /// assert!(RunFolder::can_be_created(&std::env::current_exe().unwrap()).is_err(), "it is a file");
    /// ```
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] for a path that is or lies below a file, a folder that is not empty or in use by
    /// another run, or a name that the system does not accept.
    pub fn can_be_created(path: &Path) -> Result<()> {
        match fs::metadata(path) {
            Ok(found) if !found.is_dir() => return Err(not_a_folder(path)),
            Ok(_) => {}
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(e) if e.kind() == io::ErrorKind::NotADirectory => return Err(not_a_folder(path)),
            Err(e) => {
                return Err(Error::io(path, "make the folder of the run", &e).fix("name another folder with `--out`"));
            }
        }
        let entries = fs::read_dir(path).map_err(|e| Error::io(path, "look into the folder of the run", &e))?;
        let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
        let (marks, found): (Vec<String>, Vec<String>) = names.partition(|name| name == LOCK || is_partial(name));
        if marks.iter().any(|name| name == LOCK) && is_locked(&path.join(LOCK)) {
            return Err(at_work(path));
        }
        if found.is_empty() {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the folder of the run is not empty")
            .at(path.display())
            .found(format!("{} {}", found.len(), if found.len() == 1 { "entry" } else { "entries" }))
            .wanted("a new or empty folder, so that no earlier result is written over")
            .fix("continue the run in it with `--resume`, or name another folder with `--out`"))
    }

    /// Creates a unique folder below `base`, named as by [`next_free`]. Concurrent runs get different folders.
    ///
    /// # Errors
    ///
    /// If `base` is a file, or no folder can be created in it.
    pub fn create_free(base: &Path, name: &str) -> Result<Self> {
        let failed = |path: &Path, e: &io::Error| Error::io(path, "make the folder of the run", e);
        fs::create_dir_all(base).map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => not_a_folder(base),
            _ => failed(base, &e),
        })?;
        loop {
            let root = next_free(base, name);
            match fs::create_dir(&root) {
                Ok(()) => return Self { root, writes_left: None, _lock: None }.claimed(),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(failed(&root, &e)),
            }
        }
    }

    /// Opens the folder of an earlier run.
    ///
    /// # Errors
    ///
    /// If the path does not exist or is not a folder.
    pub fn open(path: &Path) -> Result<Self> {
        let found = fs::metadata(path).map_err(|e| {
            Error::io(path, "open the folder of the run", &e).fix("give the folder of an interrupted run to --out")
        })?;
        if !found.is_dir() {
            return Err(not_a_folder(path));
        }
        Ok(Self { root: path.to_path_buf(), writes_left: None, _lock: None })
    }

    /// Opens the folder of an earlier run exclusively, to resume it.
    ///
    /// # Errors
    ///
    /// As [`RunFolder::open`], and [`ErrorKind::Input`] if another process writes to the folder.
    pub fn resume(path: &Path) -> Result<Self> {
        let run = Self::open(path)?;
        // folders that do not belong to a run are not locked
        if run.has(LOCK) { run.claimed() } else { Ok(run) }
    }

    fn claimed(self) -> Result<Self> {
        let path = self.path(LOCK);
        let file = File::create(&path).map_err(|e| Error::io(&path, "write to the folder of the run", &e))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => Err(at_work(&self.root)),
            // without file locks, exclusive use is up to the user
            Err(TryLockError::Error(_)) => Ok(self),
            Ok(()) => Ok(Self { _lock: Some(Arc::new(file)), ..self }),
        }
    }

    /// The same folder on a simulated disk that is full after this many writes. For the folder's contents this
    /// equals a killed process, so that tests can interrupt a run at any point.
    #[doc(hidden)]
    #[must_use]
    pub fn failing_after(self, writes: u64) -> Self {
        Self { writes_left: Some(Arc::new(AtomicU64::new(writes))), ..self }
    }

    /// Checks that a run can be resumed, which requires the file `name`; `missing` is the error's text otherwise.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the file does not exist.
    pub fn goes_on(&self, name: &str, missing: &str, fix: &str) -> Result<()> {
        if self.has(name) {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, missing).at(self.path(name).display()).found("no such file").fix(fix))
    }

    /// Removes leftovers of interrupted writes. Only for a folder that no other process is writing to.
    pub fn sweep(&self) {
        let folders = |path: &Path| fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
        for path in folders(&self.root) {
            let below = if path.is_dir() { folders(&path).collect() } else { Vec::new() };
            for file in below.iter().chain([&path]) {
                let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
                if is_partial(&name) {
                    // leftovers that cannot be removed are hidden and never read
                    let _ = fs::remove_file(file);
                }
            }
        }
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Path of a file of this run, existing or not.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.root.join(relative)
    }

    /// Writes a whole file, creating parent folders. An existing file is replaced atomically.
    ///
    /// # Errors
    ///
    /// If the name leads out of the folder, or the operating system refuses (disk full, no permission, a folder of
    /// that name). An existing file is unchanged then.
    pub fn write(&self, relative: &str, bytes: &[u8]) -> Result<()> {
        let target = self.inside(relative)?;
        let take = |left: u64| left.checked_sub(1);
        if self
            .writes_left
            .as_ref()
            .is_some_and(|left| left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_err())
        {
            return Err(Error::io(&target, "write a file of the run", &io::ErrorKind::StorageFull.into()));
        }
        let parent = target.parent().expect("a name inside a folder has a parent");
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, "make a folder of the run", &e))?;
        let partial = partial_name(&target);
        let written = write_through(&partial, bytes).and_then(|()| fs::rename(&partial, &target));
        written.map_err(|e| {
            // report the first error; the leftover is hidden and never read
            let _ = fs::remove_file(&partial);
            Error::io(&target, "write a file of the run", &e)
        })
    }

    /// Reads a whole file.
    ///
    /// # Errors
    ///
    /// If the name leads out of the folder, or the file is missing or unreadable.
    pub fn read(&self, relative: &str) -> Result<Vec<u8>> {
        let path = self.inside(relative)?;
        fs::read(&path).map_err(|e| {
            Error::io(&path, "read a file of the run", &e).fix("start again with another `--out`, if it is lost")
        })
    }

    /// Reads a whole text file without its byte order mark.
    ///
    /// # Errors
    ///
    /// As [`RunFolder::read`], and [`ErrorKind::Input`] for a file that is not UTF-8.
    pub fn read_text(&self, relative: &str) -> Result<String> {
        let bytes = self.read(relative)?;
        Ok(text::of(&bytes).map_err(|e| e.within(self.path(relative).display()))?.to_owned())
    }

    /// Whether this file exists.
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

/// An unused path below `base`: `base/name`, else `base/name-2`, `base/name-3`, …
///
/// Letters, digits, `-`, `_` and inner dots of the name are kept; every run of other characters becomes one `-`. An
/// empty result becomes `run`.
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

/// A unique hidden name beside the target for a temporary file.
fn partial_name(target: &Path) -> PathBuf {
    static WRITES: AtomicU64 = AtomicU64::new(0);
    let number = WRITES.fetch_add(1, Ordering::Relaxed);
    let name = target.file_name().expect("checked to be a plain name").to_string_lossy();
    target.with_file_name(format!(".{name}.{}-{number}.partial", std::process::id()))
}

fn write_through(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Whether a name is that of a temporary file; see [`partial_name`].
fn is_partial(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".partial")
}

/// Whether another process, or another run of this one, holds the lock.
fn is_locked(mark: &Path) -> bool {
    File::open(mark).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

fn at_work(folder: &Path) -> Error {
    Error::new(ErrorKind::Input, "another process is at work on the run in this folder")
        .at(folder.display())
        .fix("wait until it ends, or stop it; or name another folder with `--out`")
}

fn not_a_folder(path: &Path) -> Error {
    Error::new(ErrorKind::Input, "the folder of the run is not a folder")
        .at(path.display())
        .found("a file, here or above")
        .wanted("a folder")
        .fix("name another folder with `--out`")
}
