//! The files of real shapes: coloured meshes in safetensors, one file a split.

use std::path::Path;
use std::sync::Arc;

use gradreel::io::{Archive, Entry, Stored};
use gradreel::{DType, Element, Error, ErrorKind, Result, Tensor};

use super::Solid;

/// What the objects of a file are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// To learn from.
    Train,
    /// To choose by.
    Val,
    /// To report on.
    Test,
}

impl Split {
    /// The split's file.
    pub fn file(self) -> &'static str {
        match self {
            Self::Train => "shapes_train.safetensors",
            Self::Val => "shapes_val.safetensors",
            Self::Test => "shapes_test.safetensors",
        }
    }
}

/// Position = number / `UNITS`.
const UNITS: f32 = 65534.0;
/// Most numbers of a tensor that is read.
const MOST: usize = 1 << 28;

/// The meshes of a split, read from a folder.
///
/// ```no_run
/// use std::path::Path;
///
/// use gradreel_models::depth::{Split, read_shapes};
///
/// let solids = read_shapes(Path::new("shapes"), Split::Val)?;
/// println!("{} objects, the first of {} triangles", solids.len(), solids[0].triangles().len());
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// [`ErrorKind::Input`] for a file that is missing, damaged, or not of five tensors that fit each other, naming the tensor and
/// the object.
pub fn read_shapes(folder: &Path, split: Split) -> Result<Vec<Arc<Solid>>> {
    if !folder.is_dir() {
        return Err(Error::new(ErrorKind::Input, "there is no folder of shapes")
            .at(folder.display())
            .found(if folder.exists() { "a file" } else { "nothing" })
            .wanted(format!("a folder with {}", split.file()))
            .fix("give the folder of the shapes to --shapes"));
    }
    let path = folder.join(split.file());
    let archive = Archive::open(&path).map_err(|e| e.fix("give the folder of the shapes to --shapes"))?;
    of_archive(&archive).map_err(|e| e.within(path.display()))
}

fn of_archive(archive: &Archive) -> Result<Vec<Arc<Solid>>> {
    let [positions, colours] = [("vertices", Stored::I16), ("colours", Stored::U8)]
        .map(|(name, stored)| numbers::<f32>(archive, name, stored, Some(3)));
    let (positions, colours) = (positions?, colours?);
    let triangles = numbers::<u32>(archive, "triangles", Stored::U16, Some(3))?;
    if colours.len() != positions.len() {
        return Err(misfit(
            "colours",
            colours.len() / 3,
            format!("a colour for each of {} vertices", positions.len() / 3),
        ));
    }
    let vertex = offsets(archive, "vertex_offsets", positions.len() / 3)?;
    let triangle = offsets(archive, "triangle_offsets", triangles.len() / 3)?;
    if vertex.len() != triangle.len() {
        let wanted = format!("{}, as many as vertex_offsets", vertex.len());
        return Err(misfit("triangle_offsets", triangle.len(), wanted));
    }
    let solid = |k: usize| {
        let corners = 3 * vertex[k]..3 * vertex[k + 1];
        let rows = |values: &[f32]| -> Vec<[f32; 3]> { values.as_chunks::<3>().0.to_vec() };
        let places = rows(&positions[corners.clone()]).into_iter().map(|c| c.map(|x| x / UNITS)).collect();
        let colours = rows(&colours[corners]).into_iter().map(|c| c.map(|x| x as u8)).collect();
        let triangles = triangles[3 * triangle[k]..3 * triangle[k + 1]].as_chunks::<3>().0.to_vec();
        Solid::new(places, colours, triangles).map(Arc::new).map_err(|e| e.at(format!("object {k}")))
    };
    (0..vertex.len() - 1).map(solid).collect()
}

fn misfit(name: &str, found: impl ToString, wanted: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "the file does not hold shapes")
        .at(name)
        .found(found.to_string())
        .wanted(wanted)
        .fix("fetch the file again, or write it as the guide to training says")
}

/// A tensor of rows of so many numbers, or of numbers.
fn numbers<T: Element>(archive: &Archive, name: &str, stored: Stored, columns: Option<usize>) -> Result<Vec<T>> {
    let Entry { stored: found, shape, .. } = archive.entry(name).map_err(|e| {
        e.wanted("vertices, colours, triangles, vertex_offsets, triangle_offsets").fix("give the folder of the shapes")
    })?;
    if *found != stored {
        return Err(misfit(name, found, format!("numbers of the type {stored}")));
    }
    let fits = match (shape.dims(), columns) {
        ([_, last], Some(columns)) => *last == columns,
        ([_], None) => true,
        _ => false,
    };
    if !fits || shape.len() > MOST {
        let wanted = columns.map_or("one axis".to_owned(), |columns| format!("[count, {columns}]"));
        return Err(misfit(name, shape, format!("{wanted}, at most {MOST} numbers")));
    }
    let tensor: Tensor = archive.load_as(name, T::DTYPE)?;
    Ok(tensor.slice::<T>().to_vec())
}

/// Boundaries that begin at 0, never fall and end at `count`.
fn offsets(archive: &Archive, name: &str, count: usize) -> Result<Vec<usize>> {
    debug_assert_eq!(u32::DTYPE, DType::U32);
    let found: Vec<usize> = numbers::<u32>(archive, name, Stored::U32, None)?.into_iter().map(|x| x as usize).collect();
    let rising = found.is_sorted() && found.first() == Some(&0) && found.last() == Some(&count) && found.len() > 1;
    if rising {
        return Ok(found);
    }
    let ends = format!("{} numbers from {:?} to {:?}", found.len(), found.first(), found.last());
    Err(misfit(name, ends, format!("two numbers or more that rise from 0 to {count}")))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A file with two objects: a triangle, and two triangles.
    pub(crate) fn tensors() -> Vec<(&'static str, &'static str, Vec<usize>, Vec<u8>)> {
        let le16 = |x: &[i32]| x.iter().flat_map(|x| (*x as i16).to_le_bytes()).collect::<Vec<u8>>();
        let le32 = |x: &[u32]| x.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let places = [[0, 0, 0], [32767, 0, 0], [0, 32767, 0], [0, 0, -32767], [100, 0, 0], [0, 9, 0], [5, 5, 5]];
        vec![
            ("vertices", "I16", vec![7, 3], le16(places.as_flattened())),
            ("colours", "U8", vec![7, 3], (0..21).collect()),
            ("triangles", "U16", vec![3, 3], le16(&[0, 1, 2, 0, 1, 2, 3, 1, 2])),
            ("vertex_offsets", "U32", vec![3], le32(&[0, 3, 7])),
            ("triangle_offsets", "U32", vec![3], le32(&[0, 1, 3])),
        ]
    }

    fn file(tensors: &[(&str, &str, Vec<usize>, Vec<u8>)]) -> Vec<u8> {
        let (mut head, mut data) = (Vec::new(), Vec::new());
        for (name, stored, shape, bytes) in tensors {
            let to = data.len() + bytes.len();
            head.push(format!(
                r#""{name}":{{"dtype":"{stored}","shape":{shape:?},"data_offsets":[{},{to}]}}"#,
                data.len()
            ));
            data.extend_from_slice(bytes);
        }
        let head = format!("{{{}}}", head.join(","));
        [&(head.len() as u64).to_le_bytes(), head.as_bytes(), &data].concat()
    }

    fn read(bytes: &[u8]) -> Result<Vec<Arc<Solid>>> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(Split::Train.file()), bytes).unwrap();
        read_shapes(folder.path(), Split::Train)
    }

    #[test]
    fn objects_are_cut_out_of_the_tensors() {
        let solids = read(&file(&tensors())).unwrap();
        assert_eq!(solids.len(), 2);
        assert_eq!(solids[0].corners(), [[0.0; 3], [32767.0 / 65534.0, 0.0, 0.0], [0.0, 0.5, 0.0]]);
        assert_eq!(solids[1].triangles(), [[0, 1, 2], [3, 1, 2]]);
        assert_eq!(solids[1].colours()[0], [9, 10, 11]);
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        type Spoil = fn(&mut Vec<(&'static str, &'static str, Vec<usize>, Vec<u8>)>);
        let cases: [(&str, Spoil, &[&str]); 10] = [
            ("no colours", |t| drop(t.remove(1)), &["colours"]),
            ("floats", |t| (t[0].1, t[0].2) = ("F16", vec![7, 3]), &["vertices", "f16", "i16"]),
            ("wide triangles", |t| (t[2].1, t[2].2) = ("U8", vec![18]), &["triangles", "u8", "u16"]),
            ("columns", |t| t[1].2 = vec![21], &["colours", "[count, 3]"]),
            ("a colour less", |t| (t[1].2, t[1].3) = (vec![6, 3], vec![0; 18]), &["colours", "7 vertices"]),
            ("an end beyond", |t| t[3].3[8] = 8, &["vertex_offsets", "from 0 to 7"]),
            ("falling", |t| t[4].3[4] = 9, &["triangle_offsets", "rise"]),
            ("not from 0", |t| t[4].3[0] = 1, &["triangle_offsets"]),
            ("another corner", |t| t[2].3[0] = 3, &["object 0", "numbers below 3"]),
            (
                "an object less",
                |t| (t[4].2, t[4].3) = (vec![2], vec![0, 0, 0, 0, 3, 0, 0, 0]),
                &["triangle_offsets", "3, as many"],
            ),
        ];
        for (what, spoil, parts) in cases {
            let mut tensors = tensors();
            spoil(&mut tensors);
            let error = read(&file(&tensors)).expect_err(what);
            let text = error.to_string();
            assert_eq!(error.kind(), ErrorKind::Input, "{what}: {text}");
            for part in parts.iter().chain(&["shapes_train.safetensors", "fix: "]) {
                assert!(text.contains(part), "{what}: no {part:?} in {text}");
            }
        }
    }

    #[test]
    fn damaged_and_missing_files_are_refused() {
        let whole = file(&tensors());
        for cut in [0, 4, 40, whole.len() - 1] {
            assert_eq!(read(&whole[..cut]).unwrap_err().kind(), ErrorKind::Input, "cut at {cut}");
        }
        let folder = tempfile::tempdir().unwrap();
        let text = read_shapes(folder.path(), Split::Val).unwrap_err().to_string();
        assert!(text.contains("shapes_val.safetensors") && text.contains("--shapes"), "{text}");
        let text = read_shapes(&folder.path().join("nowhere"), Split::Val).unwrap_err().to_string();
        assert!(text.contains("no folder of shapes") && text.contains("nowhere"), "{text}");
    }
}
