//! Folders of numbered pictures.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use super::Wanted;
use crate::folder::{Part, entries, name, parts};

/// Numbers are times if their steps are at least this large and differ by less than this factor.
const TIMES: (u128, u128) = (5, 2);

/// A series of consecutive pictures in a folder.
#[derive(Debug, Clone)]
pub(super) struct Series {
    /// In order.
    pub files: Vec<PathBuf>,
    /// Messages about the names.
    pub said: Vec<String>,
    /// The numbers that count the pictures, if their names have any.
    numbers: Option<Vec<u128>>,
}

/// Whether a folder contains pictures.
pub(super) fn are_in(folder: &Path) -> bool {
    entries(folder, "the pictures").is_ok_and(|paths| paths.iter().any(|path| is_picture(path) && path.is_file()))
}

fn is_picture(path: &Path) -> bool {
    matches!(super::ending(path).as_str(), "png" | "jpg" | "jpeg")
}

impl Series {
    /// The pictures of a folder whose names differ in numbers only, ordered by these numbers. Other pictures and
    /// hidden files are ignored.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a path that is no folder, two pictures with the same number, or several series.
    pub fn of(folder: &Path) -> Result<Self> {
        let pictures: Vec<PathBuf> = entries(folder, "the pictures")?.into_iter().filter(|p| is_picture(p)).collect();
        let mut kinds: BTreeMap<Vec<String>, Vec<(Vec<u128>, PathBuf)>> = BTreeMap::new();
        for path in pictures {
            let (text, numbers) = read_name(&path);
            kinds.entry(text).or_default().push((numbers, path));
        }
        let count: usize = kinds.values().map(Vec::len).sum();
        let counted = |kind: &Vec<(Vec<u128>, PathBuf)>| if kind[0].0.is_empty() { 0 } else { kind.len() };
        let largest = kinds.values().map(counted).max().unwrap_or(0);
        if largest < 2 {
            // names without numbers are equivalent
            let mut files: Vec<PathBuf> = kinds.into_values().flatten().map(|(_, path)| path).collect();
            files.sort_by(|a, b| crate::folder::natural(&name(a), &name(b)));
            return Ok(Self { files, said: vec![], numbers: None });
        }
        let mut largest_kinds = kinds.values().filter(|kind| counted(kind) == largest);
        let (kind, other) = (largest_kinds.next().expect("one is the largest"), largest_kinds.next());
        if let Some(other) = other {
            return Err(several(folder, &kind[0].1, &other[0].1));
        }
        let mut said = Vec::new();
        if count > largest {
            let others = kinds.values().filter(|other| counted(other) != largest).flatten();
            let names: Vec<String> = others.map(|(_, path)| name(path)).collect();
            let named = names.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
            let more = if names.len() > 3 { format!(" and {} more", names.len() - 3) } else { String::new() };
            said.push(format!("no frames: {named}{more}; frames are called like {}", name(&kind[0].1)));
        }
        let mut kind = kind.clone();
        kind.sort();
        if let Some(pair) = kind.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let numbers: Vec<String> = pair[0].0.iter().map(u128::to_string).collect();
            return Err(Error::new(ErrorKind::Input, format!("two pictures are frame {}", numbers.join("_")))
                .at(folder.display())
                .found(format!("{} and {}", name(&pair[0].1), name(&pair[1].1)))
                .wanted("one picture of each number")
                .fix("remove or rename one of them"));
        }
        let (numbers, files): (Vec<Vec<u128>>, Vec<PathBuf>) = kind.into_iter().unzip();
        if let Some(other) = repeated(&numbers) {
            return Err(several(folder, &files[0], &files[other]));
        }
        Ok(Self { numbers: counter(&numbers), files, said })
    }

    /// The wanted pictures.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if one of them is missing or is no file.
    pub fn chosen(&self, folder: &Path, wanted: Wanted) -> Result<&[PathBuf]> {
        let first = wanted.first.min(self.files.len());
        let last = first.saturating_add(wanted.count).min(self.files.len());
        let files = &self.files[first..last];
        let missing = |what: String, found: String| {
            Error::new(ErrorKind::Input, what)
                .at(folder.display())
                .found(found)
                .wanted("every picture from the first to the last: a missing one shifts the time of those behind it")
                .fix("add it, number the others anew, or choose pictures without a gap (--first-frame, --frames)")
        };
        if let Some(path) = files.iter().find(|path| !path.is_file()) {
            let found = if path.is_dir() { "a folder" } else { "a link to nothing" };
            return Err(missing(format!("{} is no picture", name(path)), found.to_owned()));
        }
        let Some(numbers) = &self.numbers else { return Ok(files) };
        if let Some((k, number)) = gap(&numbers[first..last]) {
            let found = format!("{} follows {}", name(&files[k + 1]), name(&files[k]));
            return Err(missing(format!("picture {number} is missing"), found));
        }
        Ok(files)
    }
}

/// The text parts of a name between its numbers, and the numbers; the extension is ignored.
fn read_name(path: &Path) -> (Vec<String>, Vec<u128>) {
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let (mut text, mut numbers) = (Vec::new(), Vec::new());
    for part in parts(&stem) {
        match part {
            Part::Number(number) => {
                numbers.push(number);
                text.push(String::new());
            }
            Part::Text(own) => text.push(own.to_lowercase()),
        }
    }
    (text, numbers)
}

/// The positions in the names at which the numbers differ, each with its numbers.
fn varying(numbers: &[Vec<u128>]) -> impl Iterator<Item = Vec<u128>> + '_ {
    let places = numbers.first().map_or(0, Vec::len);
    let columns = (0..places).map(|place| numbers.iter().map(|own| own[place]).collect::<Vec<_>>());
    columns.filter(|column| column.iter().any(|number| *number != column[0]))
}

/// Start of a second series, if the names combine two numbers in all pairs: views of several cameras.
fn repeated(numbers: &[Vec<u128>]) -> Option<usize> {
    let mut columns: Vec<Vec<u128>> = varying(numbers).collect();
    columns.iter_mut().for_each(|column| {
        column.sort_unstable();
        column.dedup();
    });
    let product = columns.iter().try_fold(1usize, |product, column| product.checked_mul(column.len()))?;
    let first = columns.first()?;
    (columns.len() > 1 && product == numbers.len()).then(|| numbers.len() / first.len().max(1))
}

/// The numbers that count the pictures: of the varying ones, those with the most even steps.
fn counter(numbers: &[Vec<u128>]) -> Option<Vec<u128>> {
    let rising = |column: &Vec<u128>| column.windows(2).all(|pair| pair[0] < pair[1]);
    let mut columns: Vec<Vec<u128>> = varying(numbers).filter(rising).collect();
    columns.sort_by_key(|column| gap(column).is_some());
    columns.into_iter().next()
}

/// The first gap in rising numbers: the index before it and the missing number. Numbers that are times have no
/// gaps.
fn gap(numbers: &[u128]) -> Option<(usize, u128)> {
    let steps: Vec<u128> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = steps.clone();
    sorted.sort_unstable();
    let (least, usual, most) = (*sorted.first()?, sorted[(sorted.len() - 1) / 2], *sorted.last()?);
    if least >= TIMES.0 && most < least.saturating_mul(TIMES.1) {
        return None;
    }
    let k = steps.iter().position(|step| *step > usual)?;
    Some((k, numbers[k] + usual))
}

fn several(folder: &Path, one: &Path, other: &Path) -> Error {
    Error::new(ErrorKind::Input, "the folder has pictures of several series")
        .at(folder.display())
        .found(format!("{} and {}", name(one), name(other)))
        .wanted("the frames of one camera, whose names differ in one number")
        .fix("put the pictures of each camera, and masks, into a folder of their own")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with empty files of these names.
    fn folder(name: &str, files: &[&str]) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("gradreel-pictures-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        files.iter().for_each(|file| std::fs::write(folder.join(file), "").unwrap());
        folder
    }

    const ALL: Wanted = Wanted { first: 0, count: usize::MAX };

    /// The names of a series, or its error.
    fn chosen(folder: &Path, wanted: Wanted) -> Result<String, String> {
        let series = Series::of(folder).map_err(|e| e.to_string())?;
        let files = series.chosen(folder, wanted).map_err(|e| e.to_string())?;
        Ok(files.iter().map(|path| name(path)).chain(series.said.clone()).collect::<Vec<_>>().join(" "))
    }

    #[track_caller]
    fn order(label: &str, files: &[&str], wanted: &str) {
        let folder = folder(label, files);
        assert_eq!(chosen(&folder, ALL).unwrap(), wanted);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[track_caller]
    fn refused(label: &str, files: &[&str], parts: &[&str]) {
        let folder = folder(label, files);
        let told = chosen(&folder, ALL).unwrap_err();
        assert!(parts.iter().all(|part| told.contains(part)), "{told}");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn pictures_are_in_the_order_of_their_numbers() {
        order("two", &["b_10_cam2.png", "b_9_cam2.png", "b_8_cam2.png"], "b_8_cam2.png b_9_cam2.png b_10_cam2.png");
        order("hidden", &["._1.png", "1.png", "2.jpg", ".3.png"], "1.png 2.jpg");
        order("none", &["b.png", "a.png"], "a.png b.png");
        order("tens", &["0.png", "20.png", "10.png"], "0.png 10.png 20.png");
        let odd = "f1.png f2.png no frames: background.png; frames are called like f1.png";
        order("odd", &["f1.png", "f2.png", "background.png"], odd);
        // times in milliseconds, and times of day
        order("times", &["t33.png", "t67.png", "t100.png", "t134.png"], "t33.png t67.png t100.png t134.png");
        order("clock", &["9-59.png", "10-00.png", "10-01.png"], "9-59.png 10-00.png 10-01.png");
    }

    #[test]
    fn gaps_and_doubles_are_refused() {
        refused("gap", &["1.png", "2.png", "3.png", "5.png"], &["picture 4 is missing", "5.png follows 3.png"]);
        refused("tens-gap", &["0.png", "10.png", "20.png", "40.png"], &["picture 30 is missing"]);
        refused("double", &["2.png", "3.png", "003.png"], &["two pictures are frame 3", "003.png and 3.png"]);
        refused("kinds", &["2.png", "3.png", "3.jpg"], &["two pictures are frame 3"]);
        refused("cameras", &["c1_1.png", "c1_2.png", "c2_1.png", "c2_2.png"], &["several series", "c2_1.png"]);
        refused("beside", &["f1.png", "f2.png", "f1_mask.png", "f2_mask.png"], &["several series"]);
    }

    #[test]
    fn what_is_no_picture_is_missed_where_it_is_wanted() {
        let folder = folder("folder", &["1.png", "2.png", "4.png"]);
        std::fs::create_dir(folder.join("3.png")).unwrap();
        let told = chosen(&folder, ALL).unwrap_err();
        assert!(told.contains("3.png is no picture") && told.contains("a folder"), "{told}");
        assert_eq!(chosen(&folder, Wanted { first: 0, count: 2 }).unwrap(), "1.png 2.png");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("nowhere", folder.join("5.png")).unwrap();
            let told = chosen(&folder, Wanted { first: 3, count: 9 }).unwrap_err();
            assert!(told.contains("5.png is no picture") && told.contains("a link to nothing"), "{told}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}
