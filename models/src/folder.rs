//! Folder listings: hidden files omitted, names in natural order.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

/// The entries of a folder in natural order, without hidden ones (`._0001.png`, `.DS_Store`).
///
/// `what` names the contents in errors, as in `"the masks"`.
///
/// # Errors
/// [`ErrorKind::Input`] if the folder does not exist, is a file or cannot be accessed; [`ErrorKind::Io`] if reading
/// fails.
pub(crate) fn entries(folder: &Path, what: &str) -> Result<Vec<PathBuf>> {
    let failed = |e: std::io::Error| Error::io(folder, &format!("list {what}"), &e).fix("give the path of a folder");
    if folder.exists() && !folder.is_dir() {
        return Err(Error::new(ErrorKind::Input, format!("cannot list {what}"))
            .at(folder.display())
            .found("a file")
            .wanted("a folder")
            .fix("give the path of the folder"));
    }
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if !is_hidden(&path) {
            paths.push(path);
        }
    }
    paths.sort_by(|a, b| natural(&name(a), &name(b)));
    Ok(paths)
}

/// Whether a file name begins with a dot.
pub(crate) fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().first() == Some(&b'.'))
}

/// The last component of a path, for messages.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// A part of a name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part<'a> {
    /// A run of digits as a number; longer runs than a `u128` holds are text.
    Number(u128),
    /// Anything else.
    Text(&'a str),
}

/// Splits a name into numbers and the text between them.
pub(crate) fn parts(name: &str) -> Vec<Part<'_>> {
    let mut parts = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let digits = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != digits).unwrap_or(rest.len());
        let (part, after) = rest.split_at(end);
        parts.push(part.parse().ok().filter(|_| digits).map_or(Part::Text(part), Part::Number));
        rest = after;
    }
    parts
}

/// Natural order of names: 2 before 10. Names that differ only by leading zeros are ordered as text.
pub(crate) fn natural(a: &str, b: &str) -> Ordering {
    parts(a).cmp(&parts(b)).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_the_order_of_their_numbers() {
        let sorted = |names: &[&str]| {
            let mut names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            names.sort_by(|a, b| natural(a, b));
            names
        };
        assert_eq!(sorted(&["b_10_cam2", "b_2_cam2", "b_1_cam2"]), ["b_1_cam2", "b_2_cam2", "b_10_cam2"]);
        assert_eq!(sorted(&["x10y2", "x10y1", "x9y30"]), ["x9y30", "x10y1", "x10y2"]);
        assert_eq!(sorted(&["10", "9", "a", "009"]), ["009", "9", "10", "a"]);
        // more digits than a u128 holds
        let long = "1".repeat(60);
        assert_eq!(sorted(&[&format!("{long}2"), "5"])[0], "5");
        assert_eq!(natural("Ä1", "Ä1"), Ordering::Equal);
    }

    #[test]
    fn hidden_files_are_passed_over_and_a_file_is_no_folder() {
        let folder = std::env::temp_dir().join(format!("gradreel-folder-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for name in ["._2.png", ".DS_Store", "10.png", "2.png"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        let found: Vec<String> = entries(&folder, "the frames").unwrap().iter().map(|path| name(path)).collect();
        assert_eq!(found, ["2.png", "10.png"]);
        for (path, found) in [(folder.join("2.png"), "a file"), (folder.join("nothing"), "nothing")] {
            let error = entries(&path, "the frames").unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Input);
            assert!(error.to_string().contains(found) && error.to_string().contains("the frames"), "{error}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
