//! Masks as written by segmentation tools.

use std::collections::BTreeSet;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use super::samples::{Sample, Samples};

/// A mask with more than two values must reach this brightness.
const BRIGHT: u16 = 128;

/// Alpha below which a pixel counts as transparent.
const SOLID: u8 = 250;

/// Minimum alpha at which the colour of a cut-out's pixel is used.
const OPAQUE: u8 = 128;

/// Coverage by the object, 0 to 255 per pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mask {
    pub width: usize,
    pub height: usize,
    pub coverage: Vec<u8>,
}

impl Mask {
    /// Reads a mask from a PNG or JPEG file. Accepted are:
    ///
    /// - white on black with grey levels between, or a cut-out of the object on a transparent background;
    /// - two values, 0 and any other: 0 and 1, 0 and 255 in 16 bits, black and any one colour, a palette of two.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that cannot be decoded, or that is no mask by these rules; the message gives
    /// its brightest value.
    pub fn read(path: &Path) -> Result<Self> {
        let samples = Samples::read(path)?;
        let coverage = coverage(&samples).map_err(|found| {
            Error::new(ErrorKind::Input, "the mask is too dark, or of several objects")
                .at(path.display())
                .found(found)
                .wanted(
                    "255 where the object is and 0 elsewhere; or two values, 0 and any other; or the object cut out",
                )
                .fix("multiply its values so that the object is white, and leave other objects out")
        })?;
        Ok(Self { width: samples.width, height: samples.height, coverage })
    }
}

/// Coverage by these rules, or what the file contains instead.
fn coverage(samples: &Samples) -> Result<Vec<u8>, String> {
    let Samples { pixels, most, labels, .. } = samples;
    let brightness = |colour: [u16; 3]| colour.into_iter().max().unwrap_or(0);
    let shares = |share: &dyn Fn(u16) -> u32| -> Vec<u8> {
        let one = |pixel: &Sample| (share(brightness(pixel.colour)) * u32::from(pixel.alpha) / 255) as u8;
        pixels.iter().map(one).collect()
    };
    let opaque = few(pixels.iter().filter(|pixel| pixel.alpha >= OPAQUE));
    // a partly transparent black-and-white image is still a mask; any other transparent image is a cut-out
    let cut_out = pixels.iter().any(|pixel| pixel.alpha < SOLID);
    if cut_out && opaque != BTreeSet::from([[0; 3], [*most; 3]]) {
        return Ok(pixels.iter().map(|pixel| pixel.alpha).collect());
    }
    let colours = few(pixels.iter());
    let dark = colours.iter().copied().min_by_key(|colour| (brightness(*colour), *colour)).unwrap_or_default();
    if colours.len() <= 2 && (dark == [0; 3] || (*labels && colours.len() == 2)) {
        let object = |pixel: &Sample| if pixel.colour == dark { 0 } else { pixel.alpha };
        return Ok(pixels.iter().map(object).collect());
    }
    if *labels {
        return Err("several colours of a palette".to_owned());
    }
    let brightest = pixels.iter().map(|pixel| brightness(pixel.colour)).max().unwrap_or(0);
    // 16-bit files may hold 8-bit values
    let full = if brightest <= 255 { 255 } else { *most };
    if u32::from(brightest) * 255 < u32::from(BRIGHT) * u32::from(full) {
        return Err(format!("the brightest value is {brightest} of {most}"));
    }
    Ok(shares(&|value| (u32::from(value) * 255 + u32::from(full) / 2) / u32::from(full)))
}

/// Distinct colours of some pixels, at most three.
fn few<'a>(pixels: impl Iterator<Item = &'a Sample>) -> BTreeSet<[u16; 3]> {
    let mut colours = BTreeSet::new();
    for pixel in pixels {
        colours.insert(pixel.colour);
        if colours.len() > 2 {
            break;
        }
    }
    colours
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(colour: png::ColorType, depth: png::BitDepth, palette: Option<&[u8]>, bytes: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 2, 2);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if let Some(palette) = palette {
            encoder.set_palette(palette.to_vec());
        }
        encoder.write_header().unwrap().write_image_data(bytes).unwrap();
        file
    }

    /// The object is the lower right pixel of 2×2, encoded in each supported way.
    #[test]
    fn one_mask_in_many_files() {
        use png::BitDepth::{Eight, One, Sixteen, Two};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        let cut_out: Vec<u8> = [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [20, 30, 10, 255]].concat();
        let on_black: Vec<u8> = [[0, 0, 0, 255], [0, 0, 0, 255], [9, 9, 9, 0], [255, 255, 255, 255]].concat();
        let blue: Vec<u8> = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [30, 60, 90]].concat();
        let dark: [u8; 6] = [0, 0, 0, 128, 0, 0];
        let grey: [u8; 9] = [0, 0, 0, 255, 255, 255, 77, 77, 77];
        type File<'a> = (&'a str, png::ColorType, png::BitDepth, Option<&'a [u8]>, &'a [u8]);
        let files: [File<'_>; 12] = [
            ("0 and 255", Grayscale, Eight, None, &[0, 0, 0, 255]),
            ("0 and 1", Grayscale, Eight, None, &[0, 0, 0, 1]),
            ("0 and 7", Grayscale, Eight, None, &[0, 0, 0, 7]),
            ("one bit", Grayscale, One, None, &[0, 0x40]),
            ("two bits", Grayscale, Two, None, &[0, 0x10]),
            ("0 and 1 of 16 bits", Grayscale, Sixteen, None, &[0, 0, 0, 0, 0, 0, 0, 1]),
            ("0 and 255 of 16 bits", Grayscale, Sixteen, None, &[0, 0, 0, 0, 0, 0, 0, 255]),
            ("a dark palette", Indexed, Eight, Some(&dark[..]), &[0, 0, 0, 1]),
            ("a grey palette", Indexed, Eight, Some(&grey[..]), &[0, 0, 0, 1]),
            ("a cut-out", Rgba, Eight, None, &cut_out),
            ("black, white and transparent", Rgba, Eight, None, &on_black),
            ("black and blue", Rgb, Eight, None, &blue),
        ];
        for (name, colour, depth, palette, bytes) in files {
            let samples = Samples::decode(&written(colour, depth, palette, bytes), name.as_ref()).unwrap();
            assert_eq!(coverage(&samples).unwrap(), [0, 0, 0, 255], "{name}");
        }
        // grey levels
        let soft = written(Grayscale, Eight, None, &[0, 64, 128, 255]);
        assert_eq!(coverage(&Samples::decode(&soft, "".as_ref()).unwrap()).unwrap(), [0, 64, 128, 255]);
        let soft = written(Grayscale, Sixteen, None, &[0, 0, 0x40, 0x40, 0x80, 0x80, 0xff, 0xff]);
        assert_eq!(coverage(&Samples::decode(&soft, "".as_ref()).unwrap()).unwrap(), [0, 64, 128, 255]);
        let soft = written(Grayscale, Sixteen, None, &[0, 0, 0, 64, 0, 128, 0, 255]);
        assert_eq!(coverage(&Samples::decode(&soft, "".as_ref()).unwrap()).unwrap(), [0, 64, 128, 255]);
        let soft = written(GrayscaleAlpha, Eight, None, &[9, 0, 9, 64, 9, 128, 9, 255]);
        assert_eq!(coverage(&Samples::decode(&soft, "".as_ref()).unwrap()).unwrap(), [0, 64, 128, 255]);
        let nothing = written(Grayscale, Eight, None, &[0; 4]);
        assert_eq!(coverage(&Samples::decode(&nothing, "".as_ref()).unwrap()).unwrap(), [0; 4]);
    }

    #[test]
    fn what_is_no_mask_is_told() {
        use png::BitDepth::{Eight, Sixteen};
        use png::ColorType::{Grayscale, Indexed};
        let told = |file: Vec<u8>| coverage(&Samples::decode(&file, "".as_ref()).unwrap()).unwrap_err();
        let labels = written(Grayscale, Eight, None, &[0, 1, 2, 3]);
        assert!(told(labels).contains("the brightest value is 3 of 255"));
        let dark = written(Grayscale, Sixteen, None, &[0, 0, 0, 1, 0, 2, 0, 9]);
        assert!(told(dark).contains("the brightest value is 9 of 65535"));
        let several = written(Indexed, Eight, Some(&[0, 0, 0, 128, 0, 0, 0, 128, 0]), &[0, 1, 2, 2]);
        assert!(told(several).contains("palette"));
    }
}
