//! What is in a folder: without what computers leave there, in the order in which people count.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

/// The entries of a folder in natural order, without hidden ones: `._0001.png` and `.DS_Store` are notes that computers make for
/// themselves.
///
/// `what` names what is looked for in errors, as in `"the masks"`.
///
/// # Errors
/// [`ErrorKind::Input`] if there is no such folder, it is a file, or nobody may look into it; [`ErrorKind::Io`] if reading fails.
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

/// Whether the name of a file begins with a dot.
pub(crate) fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().first() == Some(&b'.'))
}

/// The last component of a path, for messages.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// A stretch of a name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part<'a> {
    /// Digits as the number that they write; more digits than a number has room for are text.
    Number(u128),
    /// Anything else.
    Text(&'a str),
}

/// The numbers of a name and the text between them.
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

/// The order of names in which 2 is before 10; names that differ by leading zeros only are ordered as text.
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
        // more digits than any number has room for
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
