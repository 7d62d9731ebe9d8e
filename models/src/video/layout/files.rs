//! Mapping of images to files, and frames in folders by the number in their names.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::folder::entries;
pub(super) use crate::folder::name as last;

/// Content of an image file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in super::super) enum Kind {
    /// A frame, or a plate under the frame number −1 or −2.
    Image,
    /// The object with its alpha.
    MaskAlpha,
    /// The object on white.
    MaskOnWhite,
    /// White where the object is, black elsewhere.
    Mask,
}

/// Locations of a clip's files.
#[derive(Debug, Clone)]
pub(super) enum Files {
    /// `data/r_{camera}_{frame}.png` etc.: the path is built from the numbers only, whatever path the list states.
    Numbered,
    /// As listed or found.
    Listed(BTreeMap<(Kind, i64, i64), PathBuf>),
}

impl Files {
    pub fn path(&self, root: &Path, kind: Kind, camera: i64, frame: i64) -> Option<PathBuf> {
        match self {
            Files::Numbered => {
                let prefix = match kind {
                    Kind::Image => 'r',
                    Kind::MaskAlpha => 'a',
                    Kind::MaskOnWhite => 'm',
                    Kind::Mask => return None,
                };
                Some(root.join("data").join(format!("{prefix}_{camera}_{frame}.png")))
            }
            Files::Listed(files) => files.get(&(kind, camera, frame)).cloned(),
        }
    }
}

/// File name extensions of images.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Whether the path has an image extension.
fn is_image(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
}

/// The path of a listed file, relative to `folder`. The listed path may be absolute or contain `..`, but must
/// resolve inside the folder.
///
/// # Errors
/// A description of the fault, for a path that leads out of the folder or is the folder itself.
pub(super) fn inside(folder: &Path, listed: &str) -> Result<PathBuf, String> {
    let plain = listed.replace('\\', "/");
    let drive = cfg!(not(windows)) && plain.as_bytes().get(1) == Some(&b':');
    let path = Path::new(&plain);
    let inner = match drive || plain.contains('\0') {
        true => None,
        false => relative(path).or_else(|| below(folder, path)),
    };
    match inner {
        None => Err(format!("the path {listed:?} leaves the clip's folder")),
        Some(inner) if inner.as_os_str().is_empty() => Err(format!("the path {listed:?} names no file")),
        Some(inner) => Ok(inner),
    }
}

/// A relative path without `.` and `..`, if it stays inside the folder.
fn relative(path: &Path) -> Option<PathBuf> {
    let mut inner = PathBuf::new();
    for component in path.components() {
        match component {
            Component::Normal(part) => inner.push(part),
            Component::CurDir => {}
            Component::ParentDir if inner.pop() => {}
            _ => return None,
        }
    }
    Some(inner)
}

/// The part of a path below a folder; the path may include the folder's own name.
fn below(folder: &Path, path: &Path) -> Option<PathBuf> {
    let written = std::path::absolute(folder).ok().map(|folder| flat(&folder));
    let real = folder.canonicalize().ok();
    let found = [&written, &real].into_iter().flatten().find_map(|folder| {
        let path = flat(&folder.join(path));
        path.strip_prefix(folder).ok().map(Path::to_path_buf)
    });
    // the same location by another name, such as /tmp for /private/tmp
    found.or_else(|| path.canonicalize().ok()?.strip_prefix(real?).ok().map(Path::to_path_buf))
}

/// A path with `.` and `..` resolved lexically.
fn flat(path: &Path) -> PathBuf {
    let mut flat = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => drop(flat.pop()),
            other => flat.push(other),
        }
    }
    flat
}

/// The image file of a listed path, which may lack its extension.
pub(super) fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    let added = |extension: &str| PathBuf::from(format!("{}.{extension}", path.display()));
    let upper = EXTENSIONS.map(str::to_uppercase);
    let names = EXTENSIONS.iter().copied().chain(upper.iter().map(String::as_str));
    if let Some(found) = names.map(added).find(|path| path.is_file()) {
        return found;
    }
    if is_image(&path) { path } else { added("png") }
}

/// The mask of an image: `masks/` and the image's path, with or without its first folder, as `.png` or with `.png`
/// added.
pub(super) fn mask_beside(root: &Path, image: &Path) -> Option<PathBuf> {
    let relative = image.strip_prefix(root).ok()?;
    let below: PathBuf = relative.components().skip(1).collect();
    let masks = root.join("masks");
    [relative, below.as_path()]
        .into_iter()
        .filter(|path| !path.as_os_str().is_empty())
        .flat_map(|path| {
            let path = masks.join(path);
            [path.with_extension("png"), PathBuf::from(format!("{}.png", path.display()))]
        })
        .find(|path| path.is_file())
}

/// The images of a folder by the last number in their names, and the count of images without a number.
pub(super) fn numbered(folder: &Path) -> Result<(BTreeMap<i64, PathBuf>, usize)> {
    let (mut found, mut without) = (BTreeMap::new(), 0);
    for path in entries(folder, "the folder of frames")? {
        if !is_image(&path) || !path.is_file() {
            continue;
        }
        let Some(number) = last_number(&path) else {
            without += 1;
            continue;
        };
        if let Some(other) = found.insert(number, path.clone()) {
            let mut names = [other, path];
            names.sort();
            return Err(Error::new(ErrorKind::Input, format!("two images are frame {number}"))
                .at(folder.display())
                .found(names.map(|path| last(&path)).join(" and "))
                .wanted("one image of each number; the last number of a name is the frame's")
                .fix("remove or rename one of them"));
        }
    }
    Ok((found, without))
}

/// The last number in a file name without its extension; `None` if it is negative or missing.
pub(super) fn last_number(path: &Path) -> Option<i64> {
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let before = stem[..end].trim_end_matches(|c: char| c.is_ascii_digit());
    if before == "-" || before.ends_with("_-") {
        return None;
    }
    stem[before.len()..end].parse().ok()
}

/// Frames of cameras with numbered files: per camera the frames and their times in frame intervals, the files with
/// their masks, and the assumptions made about the numbers.
pub(super) struct Counted {
    pub times: Vec<BTreeMap<i64, f64>>,
    pub files: Files,
    pub said: Option<String>,
}

/// Numbers the frames of all cameras by their file numbers; a common stride is divided out. `mask` returns the mask
/// of an image.
pub(super) fn count(cameras: &[BTreeMap<i64, PathBuf>], mask: impl Fn(&Path) -> Option<PathBuf>) -> Counted {
    let numbers = || cameras.iter().flat_map(|camera| camera.keys().copied());
    let first = numbers().min().unwrap_or(0);
    let step = numbers().fold(0u64, |step, number| greatest_common_divisor(step, number.abs_diff(first)));
    let step = i64::try_from(step).unwrap_or(i64::MAX).max(1);
    let mut files = BTreeMap::new();
    let mut times = Vec::new();
    for (camera, images) in (0..).zip(cameras) {
        let mut at = BTreeMap::new();
        for (&number, path) in images {
            let position = (number - first) / step;
            let frame = if step == 1 { number } else { position };
            at.insert(frame, position as f64);
            if let Some(mask) = mask(path) {
                files.insert((Kind::Mask, camera, frame), mask);
            }
            files.insert((Kind::Image, camera, frame), path.clone());
        }
        times.push(at);
    }
    let said = (step > 1).then(|| format!("frames are the numbers {first}, {}, … in the file names", first + step));
    Counted { times, files: Files::Listed(files), said }
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}
