//! Files referenced by a mesh: only those in its own folder are read, within a size limit.

use std::cell::Cell;
use std::path::{Component, Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::mesh_files::{self, LARGEST};

/// The folder of a mesh.
pub(super) struct Beside {
    folder: PathBuf,
    /// Remaining bytes that may be read, out of [`LARGEST`] for all referenced files.
    left: Cell<u64>,
}

impl Beside {
    pub fn of(folder: &Path) -> Self {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        Self { folder: folder.to_owned(), left: Cell::new(LARGEST) }
    }

    /// Whether a file of this name exists.
    pub fn has(&self, named: &str) -> bool {
        self.place(named).is_some_and(|path| path.is_file())
    }

    /// Reads a referenced file; `what` describes its purpose in errors.
    pub fn read(&self, named: &str, what: &str) -> Result<Vec<u8>> {
        let outside = |found: String| {
            Error::new(ErrorKind::Input, format!("{what} is not in the folder of the mesh"))
                .at(named)
                .found(found)
                .wanted("a file beside the mesh or in a folder below it")
                .fix("put it there and name it by its path from the mesh's folder")
        };
        let path = self.place(named).ok_or_else(|| outside("a path that leads elsewhere".into()))?;
        let io = |e: std::io::Error| {
            Error::io(named, &format!("read {what}"), &e)
                .wanted("the file that the mesh names (large and small letters differ)")
                .fix("put it beside the mesh, or correct its name in the file that names it")
        };
        let (folder, whole) = (self.folder.canonicalize().map_err(io)?, path.canonicalize().map_err(io)?);
        if !whole.starts_with(&folder) {
            return Err(outside("a link that leads elsewhere".into()));
        }
        let bytes = mesh_files::read(&whole, what, "remove or replace the file").map_err(|e| e.at(named))?;
        let left = self.left.get().checked_sub(bytes.len() as u64);
        self.left.set(left.ok_or_else(|| too_large(named, what))?);
        Ok(bytes)
    }

    /// The path of a referenced file, if it stays in the folder.
    fn place(&self, named: &str) -> Option<PathBuf> {
        let named = named.replace('\\', "/");
        if named.contains('\0') || named.as_bytes().get(1) == Some(&b':') {
            return None;
        }
        let mut path = self.folder.clone();
        let mut depth = 0;
        for component in Path::new(&named).components() {
            match component {
                Component::Normal(part) => {
                    path.push(part);
                    depth += 1;
                }
                Component::CurDir => {}
                Component::ParentDir if depth > 0 => {
                    path.pop();
                    depth -= 1;
                }
                _ => return None,
            }
        }
        (depth > 0).then_some(path)
    }
}

fn too_large(at: &str, what: &str) -> Error {
    Error::new(ErrorKind::Input, format!("{what} is too large"))
        .at(at)
        .found(format!("more than {} MB with the files before it", LARGEST >> 20))
        .wanted(format!("at most {} MB", LARGEST >> 20))
        .fix("simplify the mesh, or shrink its textures")
}
