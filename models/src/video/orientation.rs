//! Exif orientation: phone pictures are stored in sensor orientation, with a tag that says how to rotate them.

use exif::{In, Reader, Tag};

use super::image::Image;

/// Exif `Orientation`: how to display a stored picture, from 1 (as stored) to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Orientation(u8);

impl Orientation {
    /// Reads the orientation from Exif data; missing or damaged data mean 1.
    pub fn of(exif: Option<&[u8]>) -> Self {
        let value = || {
            let data = exif?;
            let tiff = data.strip_prefix(b"Exif\0\0").unwrap_or(data).to_vec();
            // damage elsewhere in the data does not matter
            let found = match Reader::new().continue_on_error(true).read_raw(tiff) {
                Ok(found) => found,
                Err(error) => error.distill_partial_result(|_| {}).ok()?,
            };
            found.get_field(Tag::Orientation, In::PRIMARY)?.value.get_uint(0)
        };
        Self(value().and_then(|value| u8::try_from(value).ok()).filter(|value| (1..=8).contains(value)).unwrap_or(1))
    }

    /// Width, height and pixels, row by row, in display orientation.
    pub fn turned_pixels<T: Copy>(self, (w, h): (usize, usize), pixels: Vec<T>) -> (usize, usize, Vec<T>) {
        if self.0 == 1 {
            return (w, h, pixels);
        }
        // stored column and row shown at a position
        let from = |x: usize, y: usize| match self.0 {
            2 => (w - 1 - x, y),
            3 => (w - 1 - x, h - 1 - y),
            4 => (x, h - 1 - y),
            5 => (y, x),
            6 => (y, h - 1 - x),
            7 => (w - 1 - y, h - 1 - x),
            8 => (w - 1 - y, x),
            _ => (x, y),
        };
        let (width, height) = if self.0 >= 5 { (h, w) } else { (w, h) };
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        (width, height, places.map(|(x, y)| from(x, y)).map(|(x, y)| pixels[y * w + x]).collect())
    }

    /// The picture in display orientation.
    pub fn turned(self, image: Image) -> Image {
        let (width, height, pixels) = self.turned_pixels((image.width, image.height), image.pixels);
        Image { width, height, pixels, has_alpha: image.has_alpha }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exif data with only an orientation, in either byte order.
    fn exif(orientation: u16, big: bool) -> Vec<u8> {
        let short = |v: u16| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let long = |v: u32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let start = if big { b"MM" } else { b"II" };
        let entry = [&short(0x0112)[..], &short(3), &long(1), &short(orientation), &short(0)].concat();
        [&start[..], &short(42), &long(8), &short(1), &entry, &long(0)].concat()
    }

    /// Letters stored as `ABC/DEF` and as displayed: by the Exif standard the number says where the stored first
    /// row and first column appear.
    #[test]
    fn all_eight_ways() {
        let stored = Image {
            width: 3,
            height: 2,
            pixels: b"ABCDEF".iter().map(|letter| [*letter, 0, 0, 255]).collect(),
            has_alpha: false,
        };
        let shown = ["ABC/DEF", "CBA/FED", "FED/CBA", "DEF/ABC", "AD/BE/CF", "DA/EB/FC", "FC/EB/DA", "CF/BE/AD"];
        for (value, wanted) in (1..).zip(shown) {
            for big in [false, true] {
                let turned = Orientation::of(Some(&exif(value, big))).turned(stored.clone());
                let rows = turned.pixels.chunks(turned.width);
                let rows: Vec<String> = rows.map(|row| row.iter().map(|p| p[0] as char).collect()).collect();
                assert_eq!(rows.join("/"), wanted, "orientation {value}");
                assert_eq!(rows.len(), turned.height);
            }
        }
        let prefixed = [b"Exif\0\0", &exif(6, true)[..]].concat();
        assert_eq!(Orientation::of(Some(&prefixed)), Orientation(6));
        for nothing in [None, Some(&b"rubbish"[..]), Some(exif(0, true).as_slice()), Some(exif(9, false).as_slice())] {
            assert_eq!(Orientation::of(nothing), Orientation(1));
        }
    }
}
