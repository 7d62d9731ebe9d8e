//! Focal length from the Exif data of pictures.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};

use exif::{In, Reader, Tag};

use super::Series;

/// Diagonal of a 35 mm film frame \[mm\].
const DIAGONAL: f64 = 43.27;

/// Accepted 35 mm equivalent focal lengths \[mm\].
const BELIEVED: std::ops::RangeInclusive<f64> = 5.0..=2000.0;

/// The focal length as a share of the picture's diagonal, from its 35 mm equivalent \[mm\], which is along the
/// diagonal.
pub(super) fn share(equivalent: f64) -> Option<f64> {
    BELIEVED.contains(&equivalent).then_some(equivalent / DIAGONAL)
}

/// The focal length as a share of the picture's diagonal, from the Exif data of the first picture of a series.
pub(super) fn focal(series: &Series) -> Option<f64> {
    share(of_picture(&mut BufReader::new(File::open(series.files.first()?).ok()?))?)
}

fn of_picture(file: &mut (impl BufRead + Seek)) -> Option<f64> {
    // pictures with missing or damaged Exif data are ignored
    let exif = Reader::new().read_from_container(file).ok()?;
    exif.get_field(Tag::FocalLengthIn35mmFilm, In::PRIMARY)?.value.get_uint(0).map(f64::from)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A JPEG file with only a focal length.
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
        let folder = tempfile::TempDir::new().unwrap();
        std::fs::write(folder.path().join("f_2.jpg"), picture(50)).unwrap();
        std::fs::write(folder.path().join("f_1.jpg"), picture(28)).unwrap();
        let focal = || super::focal(&Series::of(folder.path()).unwrap());
        assert!((focal().unwrap() - 28.0 / DIAGONAL).abs() < 1e-12);
        std::fs::write(folder.path().join("f_1.jpg"), picture(0)).unwrap();
        assert_eq!(focal(), None);
    }
}
