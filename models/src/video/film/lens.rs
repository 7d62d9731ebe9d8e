//! The lens that a film was taken with, where its file says.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use exif::{In, Reader, Tag};

use super::pictures::Series;
use super::stream;

/// The diagonal of a frame of 35 mm film \[mm\].
const DIAGONAL: f64 = 43.27;

/// Focal lengths of 35 mm film that are believed \[mm\].
const BELIEVED: std::ops::RangeInclusive<f64> = 5.0..=2000.0;

/// The focal length as a share of the picture's diagonal: from the Exif data of the first picture of a folder, or from the tags of a
/// video file. Both state the focal length with which 35 mm film shows as much along the diagonal.
pub(super) fn focal(path: &Path) -> Option<f64> {
    let equivalent = match path.is_dir() {
        true => of_picture(&mut BufReader::new(File::open(Series::of(path).ok()?.files.first()?).ok()?)),
        false => stream::tag(path, "camera.focal_length.35mm_equivalent").and_then(|text| text.trim().parse().ok()),
    };
    equivalent.filter(|focal| BELIEVED.contains(focal)).map(|focal| focal / DIAGONAL)
}

fn of_picture(file: &mut (impl BufRead + Seek)) -> Option<f64> {
    // a picture without such data, or with damaged data, says nothing
    let exif = Reader::new().read_from_container(file).ok()?;
    exif.get_field(Tag::FocalLengthIn35mmFilm, In::PRIMARY)?.value.get_uint(0).map(f64::from)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A JPEG file that holds nothing but a focal length.
    fn picture(focal: u16) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, value: u32| -> Vec<u8> {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        let folder = |entry: Vec<u8>| [&1u16.to_le_bytes()[..], &entry, &0u32.to_le_bytes()].concat();
        let tiff =
            [&b"II*\0\x08\0\0\0"[..], &folder(entry(0x8769, 4, 26)), &folder(entry(0xA405, 3, u32::from(focal)))]
                .concat();
        let data = [&b"Exif\0\0"[..], &tiff].concat();
        let length = (data.len() as u16 + 2).to_be_bytes();
        [&b"\xFF\xD8\xFF\xE1"[..], &length, &data, b"\xFF\xD9"].concat()
    }

    #[test]
    fn exif_data_tell_the_lens() {
        assert_eq!(of_picture(&mut Cursor::new(picture(26))), Some(26.0));
        let damaged = &picture(26)[..40];
        assert_eq!(of_picture(&mut Cursor::new(damaged)), None);
        assert_eq!(of_picture(&mut Cursor::new(b"no picture")), None);
    }

    #[test]
    fn a_folder_says_what_its_first_picture_says() {
        let folder = std::env::temp_dir().join(format!("gradreel-lens-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("f_2.jpg"), picture(50)).unwrap();
        std::fs::write(folder.join("f_1.jpg"), picture(28)).unwrap();
        let found = focal(&folder).unwrap();
        assert!((found - 28.0 / DIAGONAL).abs() < 1e-12, "{found}");
        std::fs::write(folder.join("f_1.jpg"), picture(0)).unwrap();
        assert_eq!(focal(&folder), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
