//! A folder of meshes: training split, held-out split, and a cache of loaded meshes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use gradreel::{Error, ErrorKind, Key, Result};
use rayon::prelude::*;

use super::dice::Dice;
use super::mesh::ENDINGS;
use super::{Object, TexturedMesh};
use crate::fnv1a::fnv1a;
use crate::folder::entries;

/// How a folder of meshes is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FolderSettings {
    /// Share of meshes held out from training.
    pub held_out: f64,
    /// Size of the mesh cache \[bytes\].
    pub memory: usize,
}

impl Default for FolderSettings {
    /// A tenth, and a gigabyte.
    fn default() -> Self {
        Self { held_out: 0.1, memory: 1 << 30 }
    }
}

/// A file of a [`MeshFolder`].
#[derive(Debug)]
pub struct MeshFile {
    /// Path relative to the folder, separated by `/`.
    pub name: String,
    /// File size \[bytes\].
    pub length: u64,
    /// Number of triangles, or why the file is unusable.
    pub triangles: Result<usize>,
    /// Whether it is in the training split.
    pub trained: bool,
    /// Whether it is in the held-out split.
    pub shown: bool,
}

/// Textured meshes that replace procedural objects.
pub struct MeshFolder {
    root: PathBuf,
    files: Vec<MeshFile>,
    trained: Vec<usize>,
    unseen: Vec<usize>,
    kept: Mutex<Kept>,
}

/// Loaded meshes with the time of their last use.
#[derive(Default)]
struct Kept {
    meshes: HashMap<usize, (Arc<TexturedMesh>, u64)>,
    bytes: usize,
    most: usize,
    used: u64,
}

impl MeshFolder {
    /// Searches a folder recursively for `.obj`, `.glb` and `.gltf` files (except hidden files and links to
    /// folders) and reads each once, calling `read` after each; [`MeshFolder::files`] reports unusable ones.
    ///
    /// The split of a file follows from its relative path without extension, so that it does not change when files
    /// are added, and an object in two formats is not in both splits. Each split has at least one file if there are
    /// two.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if `root` is no folder, or holds no usable mesh.
    pub fn open(root: &Path, settings: FolderSettings, read: &(dyn Fn() + Sync)) -> Result<Self> {
        if root.exists() && !root.is_dir() {
            return Err(Error::new(ErrorKind::Input, "the meshes are looked for in a folder")
                .at(root.display())
                .found("something that is no folder")
                .wanted("a folder with `.obj`, `.glb` or `.gltf` files")
                .fix("put the mesh into a folder and give that"));
        }
        let mut files = Vec::new();
        list(root, "", &mut files)?;
        files.sort();
        let kept = Mutex::new(Kept { most: settings.memory, ..Kept::default() });
        let files = files.into_par_iter().enumerate().map(|(index, (name, length))| {
            let mesh = TexturedMesh::read_inside(&root.join(&name), &name).map(Arc::new);
            read();
            let triangles = mesh.as_ref().map(|mesh| mesh.triangles()).map_err(Error::clone);
            if let Ok(mesh) = mesh {
                lock(&kept).keep(index, &mesh, false);
            }
            MeshFile { name, length, triangles, trained: false, shown: false }
        });
        let mut files: Vec<MeshFile> = files.collect();
        let usable: Vec<usize> = (0..files.len()).filter(|file| files[*file].triangles.is_ok()).collect();
        if usable.is_empty() {
            let what = if files.is_empty() {
                "there are no meshes in the folder"
            } else {
                "no mesh in the folder can be used"
            };
            let why = files
                .first()
                .map(|file| format!("of {} the first one: {}", files.len(), file.why().unwrap_or_default()));
            return Err(Error::new(ErrorKind::Input, what)
                .at(root.display())
                .found(why.unwrap_or_else(|| "no file with one of these endings".into()))
                .wanted("`.obj`, `.glb` or `.gltf` files, in the folder or below it")
                .fix("give the folder that holds the objects"));
        }
        let (trained, unseen) = divided(&files, usable, settings.held_out);
        trained.iter().for_each(|file| files[*file].trained = true);
        unseen.iter().for_each(|file| files[*file].shown = true);
        Ok(Self { root: root.to_owned(), files, trained, unseen, kept })
    }

    /// All files found, ordered by name.
    pub fn files(&self) -> &[MeshFile] {
        &self.files
    }

    /// The files of the training split.
    pub fn trained(&self) -> impl ExactSizeIterator<Item = &MeshFile> {
        self.trained.iter().map(|file| &self.files[*file])
    }

    /// The files of the held-out split, in display order.
    pub fn unseen(&self) -> impl ExactSizeIterator<Item = &MeshFile> {
        self.unseen.iter().map(|file| &self.files[*file])
    }

    /// Whether the splits are disjoint. If there is only one file, or nothing is held out, both contain the same
    /// files.
    pub fn is_divided(&self) -> bool {
        self.files.iter().all(|file| !(file.trained && file.shown))
    }

    /// The training object of a key: a file, a rotation about the vertical, and a lamp.
    ///
    /// # Errors
    /// If the file can no longer be read.
    ///
    /// # Panics
    /// If all files are held out.
    #[track_caller]
    pub fn object(&self, key: Key) -> Result<Object> {
        let [which, about, light] = key.split();
        assert!(!self.trained.is_empty(), "all meshes are held out");
        self.turned(self.trained[Dice::new(which).below(self.trained.len())], about, light)
    }

    /// The held-out object with an index: cycles through the files, with another rotation in every cycle.
    ///
    /// # Errors
    /// If the file can no longer be read.
    pub fn unseen_object(&self, number: usize, key: Key) -> Result<Object> {
        let [_, about, light] = key.split();
        self.turned(self.unseen[number % self.unseen.len()], about, light)
    }

    fn turned(&self, file: usize, about: Key, light: Key) -> Result<Object> {
        let turn = Dice::new(about).within(0.0, std::f64::consts::TAU);
        Ok(Object::of_mesh(self.mesh(file)?, turn, light))
    }

    fn mesh(&self, file: usize) -> Result<Arc<TexturedMesh>> {
        if let Some(mesh) = lock(&self.kept).find(file) {
            return Ok(mesh);
        }
        let mesh = Arc::new(TexturedMesh::read(&self.root.join(&self.files[file].name))?);
        lock(&self.kept).keep(file, &mesh, true);
        Ok(mesh)
    }

    /// A fingerprint of the folder: the number of files, and FNV-1a of their names and sizes.
    pub fn mark(&self) -> String {
        let text: String = self.files.iter().map(|file| format!("{}\n{}\n", file.name, file.length)).collect();
        format!("{}-{:016x}", self.files.len(), fnv1a(text.as_bytes()))
    }
}

impl MeshFile {
    /// Why the file is unusable: the fault, its position, and what was found.
    pub fn why(&self) -> Option<String> {
        self.triangles.as_ref().err().map(Error::in_short)
    }
}

impl Kept {
    fn find(&mut self, file: usize) -> Option<Arc<TexturedMesh>> {
        self.used += 1;
        let (mesh, used) = self.meshes.get_mut(&file)?;
        *used = self.used;
        Some(mesh.clone())
    }

    /// Caches a mesh; with `instead`, it evicts the least recently used ones, otherwise it is kept only if there is
    /// room.
    fn keep(&mut self, file: usize, mesh: &Arc<TexturedMesh>, instead: bool) {
        let bytes = mesh.bytes();
        if bytes > self.most || (!instead && self.bytes + bytes > self.most) || self.meshes.contains_key(&file) {
            return;
        }
        while self.bytes + bytes > self.most {
            let oldest = self.meshes.iter().min_by_key(|(file, (_, used))| (*used, **file)).map(|(file, _)| *file);
            let Some((gone, _)) = oldest.and_then(|file| self.meshes.remove(&file)) else { break };
            self.bytes -= gone.bytes();
        }
        self.bytes += bytes;
        self.used += 1;
        self.meshes.insert(file, (mesh.clone(), self.used));
    }
}

/// Appends the names and sizes of the meshes below a folder.
fn list(root: &Path, below: &str, found: &mut Vec<(String, u64)>) -> Result<()> {
    let folder = root.join(below);
    let io = |e: std::io::Error| Error::io(&folder, "list the folder of meshes", &e).fix("give a folder with meshes");
    for path in entries(&folder, "the meshes")? {
        // names that are not valid text are skipped
        let Some(own) = path.file_name().and_then(|name| name.to_str()) else { continue };
        let name = if below.is_empty() { own.to_owned() } else { format!("{below}/{own}") };
        if std::fs::symlink_metadata(&path).map_err(io)?.is_dir() {
            list(root, &name, found)?;
        } else if ENDINGS.iter().any(|ending| own.to_lowercase().ends_with(&format!(".{ending}"))) {
            let length = std::fs::metadata(&path).map(|kind| if kind.is_file() { kind.len() } else { 0 });
            found.push((name, length.unwrap_or(0)));
        }
    }
    Ok(())
}

/// Splits the files into training and held-out; the latter are in an order independent of their names.
fn divided(files: &[MeshFile], mut usable: Vec<usize>, held_out: f64) -> (Vec<usize>, Vec<usize>) {
    let share = |file: &usize| {
        let name = &files[*file].name;
        let stem = name.rsplit_once('.').map_or(&**name, |(stem, _)| stem);
        (Key::new(fnv1a(stem.as_bytes())).uniform(1).next().expect("one number"), *file)
    };
    usable.sort_by(|a, b| share(a).partial_cmp(&share(b)).expect("shares are numbers"));
    let mut count = usable.iter().filter(|file| share(file).0 < held_out).count();
    if held_out > 0.0 && held_out < 1.0 && usable.len() > 1 {
        count = count.clamp(1, usable.len() - 1);
    }
    if count == 0 || (usable.len() == 1 && held_out < 1.0) {
        return (usable.clone(), usable);
    }
    let mut trained = usable.split_off(count);
    trained.sort_unstable();
    (trained, usable)
}

/// A poisoned lock is harmless, since meshes are inserted complete.
fn lock(kept: &Mutex<Kept>) -> std::sync::MutexGuard<'_, Kept> {
    kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
