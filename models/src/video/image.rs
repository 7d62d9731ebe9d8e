//! PNG and JPEG images, decoded within size limits.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::{ZByteReaderTrait, ZCursor};
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::orientation::Orientation;
use crate::text;

/// Maximum side \[pixels\].
const MAX_SIDE: u32 = 16_384;
/// Maximum image size \[pixels\].
const MAX_PIXELS: u64 = 64 << 20;
/// Maximum size of an image file \[bytes\].
pub(super) const MAX_BYTES: u64 = 256 << 20;

/// An 8-bit RGBA image with straight alpha, row by row from the upper left corner.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[u8; 4]>,
    /// Whether the file has an alpha channel.
    pub has_alpha: bool,
}

impl Image {
    /// Decodes a PNG or JPEG file, recognised by its first bytes, and applies its Exif orientation.
    pub fn read_any(path: &Path) -> Result<Image> {
        let (image, orientation) = match start_of(path)?[..] {
            [0xff, 0xd8, 0xff, ..] => Self::decode_jpeg(&jpeg(path)?, path)?,
            [0x89, b'P', b'N', b'G'] => Self::decode_png(open(path)?, path)?,
            ref start => return Err(unknown(path, start)),
        };
        Ok(orientation.turned(image))
    }

    /// Decodes a PNG or JPEG file in memory without applying its orientation; `name` identifies it in errors.
    pub fn decode(bytes: &[u8], name: &Path) -> Result<Image> {
        match bytes {
            [0xff, 0xd8, 0xff, ..] => Self::decode_jpeg(bytes, name),
            [0x89, b'P', b'N', b'G', ..] => Self::decode_png(opened(Cursor::new(bytes), name)?, name),
            _ => return Err(unknown(name, &bytes[..bytes.len().min(4)])),
        }
        .map(|(image, _)| image)
    }

    /// Decodes a frame of a calibrated camera without applying its orientation, since the calibration refers to the
    /// stored image: JPEG if it starts like one, PNG otherwise.
    pub fn read_frame(path: &Path) -> Result<Image> {
        match starts_as_jpeg(path)? {
            true => Self::decode_jpeg(&jpeg(path)?, path),
            false => Self::decode_png(open(path)?, path),
        }
        .map(|(image, _)| image)
    }

    /// Stored width and height of a frame, from its header alone.
    ///
    /// # Errors
    /// As [`Image::read_frame`] for a damaged header or one that declares too large an image.
    pub fn frame_size(path: &Path) -> Result<(usize, usize)> {
        match starts_as_jpeg(path)? {
            true => header_of(&mut JpegDecoder::new_with_options(ZCursor::new(&jpeg(path)?[..]), options()), path),
            false => open(path).map(|reader| (reader.info().width as usize, reader.info().height as usize)),
        }
    }

    /// Decodes a JPEG file, which must be complete.
    fn decode_jpeg(bytes: &[u8], path: &Path) -> Result<(Image, Orientation)> {
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options());
        let (width, height) = header_of(&mut decoder, path)?;
        let orientation = Orientation::of(decoder.exif().map(Vec::as_slice));
        let rgb = decoder.decode().map_err(|e| broken_jpeg(path, e.to_string()))?;
        if rgb.len() != 3 * width * height {
            return Err(broken_jpeg(path, format!("{} bytes for {width} × {height} pixels", rgb.len())));
        }
        let pixels = rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255]).collect();
        Ok((Image { width, height, pixels, has_alpha: false }, orientation))
    }

    /// Decodes a PNG file of any colour type; 16-bit samples are reduced to their upper byte.
    fn decode_png<R: BufRead + Seek>(mut reader: png::Reader<R>, path: &Path) -> Result<(Image, Orientation)> {
        let size = reader.output_buffer_size().ok_or_else(|| too_large(path, reader.info().size()))?;
        let mut bytes = vec![0; size];
        let info = reader.next_frame(&mut bytes).map_err(|e| broken(path, &e))?;
        let (width, height) = (info.width as usize, info.height as usize);
        let bytes = &bytes[..info.buffer_size()];
        let (pixels, has_alpha) = match info.color_type {
            png::ColorType::Grayscale => (bytes.iter().map(|&v| [v, v, v, 255]).collect(), false),
            png::ColorType::GrayscaleAlpha => (bytes.chunks_exact(2).map(|p| [p[0], p[0], p[0], p[1]]).collect(), true),
            png::ColorType::Rgb => (bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255]).collect(), false),
            png::ColorType::Rgba => (bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect(), true),
            png::ColorType::Indexed => unreachable!("palettes are expanded while decoding"),
        };
        let orientation = Orientation::of(reader.info().exif_metadata.as_deref());
        Ok((Image { width, height, pixels, has_alpha }, orientation))
    }

    /// Whether any pixel is not opaque.
    pub fn is_transparent_somewhere(&self) -> bool {
        self.has_alpha && self.pixels.iter().any(|p| p[3] < 250)
    }
}

/// JPEG decoder options.
fn options() -> DecoderOptions {
    DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE as usize)
        .set_max_height(MAX_SIDE as usize)
        .jpeg_set_out_colorspace(ColorSpace::RGB)
}

/// Width and height from the header of a JPEG file, if within the limits.
fn header_of<T: ZByteReaderTrait>(decoder: &mut JpegDecoder<T>, path: &Path) -> Result<(usize, usize)> {
    decoder.decode_headers().map_err(|e| broken_jpeg(path, e.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken_jpeg(path, "no size".into()))?;
    if (width as u64) * (height as u64) > MAX_PIXELS {
        return Err(too_large(path, (width as u32, height as u32)));
    }
    Ok((width, height))
}

/// The bytes of a JPEG file.
fn jpeg(path: &Path) -> Result<Vec<u8>> {
    text::bytes(path, "the image", "copy or export this image again", MAX_BYTES)
}

/// The first bytes of a file, which identify its format.
pub(super) fn start_of(path: &Path) -> Result<Vec<u8>> {
    let mut start = Vec::new();
    file(path)?.take(4).read_to_end(&mut start).map_err(|e| Error::io(path, "read the image", &e))?;
    Ok(start)
}

pub(super) fn starts_as_jpeg(path: &Path) -> Result<bool> {
    Ok(start_of(path)?.starts_with(&[0xff, 0xd8, 0xff]))
}

/// Opens the file of an image.
fn file(path: &Path) -> Result<File> {
    if path.is_dir() {
        let error = Error::new(ErrorKind::Input, "cannot open the image").at(path.display()).found("a folder");
        return Err(error.wanted("a PNG or JPEG file").fix("remove the folder, or put the image in its place"));
    }
    File::open(path).map_err(|e| Error::io(path, "open the image", &e).fix("give the path of a PNG or JPEG file"))
}

/// Reads the header and rejects oversized images before allocating memory for them.
fn open(path: &Path) -> Result<png::Reader<BufReader<File>>> {
    opened(BufReader::new(file(path)?), path)
}

fn opened<R: BufRead + Seek>(source: R, path: &Path) -> Result<png::Reader<R>> {
    opened_as(png::Transformations::normalize_to_color8(), source, path)
}

/// Like [`opened`], with sample transformations.
pub(super) fn opened_as<R: BufRead + Seek>(
    transformations: png::Transformations,
    source: R,
    path: &Path,
) -> Result<png::Reader<R>> {
    let mut decoder = png::Decoder::new_with_limits(source, png::Limits { bytes: 1 << 30 });
    decoder.set_transformations(transformations);
    let header = decoder.read_header_info().map_err(|e| broken(path, &e))?;
    if header.width.max(header.height) > MAX_SIDE || u64::from(header.width) * u64::from(header.height) > MAX_PIXELS {
        return Err(too_large(path, header.size()));
    }
    decoder.read_info().map_err(|e| broken(path, &e))
}

fn unknown(path: &Path, start: &[u8]) -> Error {
    Error::new(ErrorKind::Input, "the image has no format that is read")
        .at(path.display())
        .found(if start.is_empty() { "an empty file".to_owned() } else { format!("first bytes {start:02x?}") })
        .wanted("PNG or JPEG")
        .fix("export the image as PNG")
}

fn broken_jpeg(path: &Path, found: String) -> Error {
    Error::new(ErrorKind::Input, "cannot decode the image")
        .at(path.display())
        .found(found)
        .wanted(format!("a complete JPEG file of at most {MAX_SIDE} pixels a side"))
        .fix("copy or export this image again")
}

pub(super) fn broken(path: &Path, error: &png::DecodingError) -> Error {
    Error::new(ErrorKind::Input, "cannot decode the image")
        .at(path.display())
        .found(error)
        .wanted("a complete PNG file")
        .fix("copy or export this image again")
}

pub(super) fn too_large(path: &Path, (width, height): (u32, u32)) -> Error {
    Error::new(ErrorKind::Input, "the image is too large")
        .at(path.display())
        .found(format!("{width} × {height} pixels"))
        .wanted(format!("at most {MAX_SIDE} pixels a side and {} megapixels", MAX_PIXELS >> 20))
        .fix("shrink it")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A phone picture: a JPEG file with an Exif orientation inserted behind its first marker.
    #[test]
    fn a_picture_is_turned_where_nobody_calibrated_it() {
        let plain = include_bytes!("../../tests/cli/ball.jpg");
        let tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        let data = [&b"Exif\0\0"[..], tiff].concat();
        let length = (data.len() as u16 + 2).to_be_bytes();
        let marked = [&plain[..2], &[0xff, 0xe1], &length, &data, &plain[2..]].concat();
        let file = std::env::temp_dir().join(format!("gradreel-held-{}.jpg", std::process::id()));
        std::fs::write(&file, marked).unwrap();
        let stored = Image::read_frame(&file).unwrap();
        let shown = Image::read_any(&file).unwrap();
        std::fs::remove_file(file).unwrap();
        assert_eq!(stored.pixels, Image::decode(plain, "ball".as_ref()).unwrap().pixels);
        assert_eq!((shown.width, shown.height), (stored.height, stored.width));
        for (i, pixel) in shown.pixels.iter().enumerate() {
            let (x, y) = (i % shown.width, i / shown.width);
            assert_eq!(*pixel, stored.pixels[(stored.height - 1 - x) * stored.width + y], "column {x} of row {y}");
        }
    }
}
