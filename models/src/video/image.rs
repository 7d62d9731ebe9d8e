//! PNG and JPEG images as bytes, decoded within limits.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest accepted side \[pixels\].
const MAX_SIDE: u32 = 16_384;
/// Largest accepted image \[pixels\].
const MAX_PIXELS: u64 = 64 << 20;

/// An 8-bit RGBA image, row by row from the upper left corner, alpha not multiplied in.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[u8; 4]>,
    /// Whether the file stores transparency.
    pub has_alpha: bool,
}

impl Image {
    /// Decodes a PNG or JPEG file; which it is, its first bytes tell.
    pub fn read_any(path: &Path) -> Result<Image> {
        let mut start = Vec::new();
        let file = File::open(path).map_err(|e| Error::io(path, "open the image", &e))?;
        file.take(4).read_to_end(&mut start).map_err(|e| Error::io(path, "read the image", &e))?;
        match start[..] {
            [0xff, 0xd8, 0xff, ..] => Self::read_jpeg(path),
            [0x89, b'P', b'N', b'G'] => Self::read(path),
            _ => Err(unknown(path, &start)),
        }
    }

    /// Decodes a PNG or JPEG file in memory; `name` is what errors call it.
    pub fn decode(bytes: &[u8], name: &Path) -> Result<Image> {
        match bytes {
            [0xff, 0xd8, 0xff, ..] => Self::decode_jpeg(bytes, name),
            [0x89, b'P', b'N', b'G', ..] => Self::decode_png(opened(Cursor::new(bytes), name)?, name),
            _ => Err(unknown(name, &bytes[..bytes.len().min(4)])),
        }
    }

    /// Decodes a frame of a clip: JPEG if it starts like one, PNG otherwise.
    pub fn read_frame(path: &Path) -> Result<Image> {
        if starts_as_jpeg(path)? { Self::read_jpeg(path) } else { Self::read(path) }
    }

    /// Width and height of a frame, from its header alone.
    pub fn frame_size(path: &Path) -> Result<(usize, usize)> {
        if !starts_as_jpeg(path)? {
            return Self::size(path);
        }
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read the image", &e))?;
        let mut decoder = JpegDecoder::new(ZCursor::new(&bytes[..]));
        decoder.decode_headers().ok().and_then(|()| decoder.dimensions()).ok_or_else(|| {
            Error::new(ErrorKind::Input, "cannot decode the image")
                .at(path.display())
                .found("a JPEG file without a readable header")
                .fix("copy or export this image again")
        })
    }

    /// Decodes a JPEG file, which must be complete.
    fn read_jpeg(path: &Path) -> Result<Image> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read the image", &e))?;
        Self::decode_jpeg(&bytes, path)
    }

    fn decode_jpeg(bytes: &[u8], path: &Path) -> Result<Image> {
        let broken = |found: String| {
            Error::new(ErrorKind::Input, "cannot decode the image")
                .at(path.display())
                .found(found)
                .wanted(format!("a complete JPEG file of at most {MAX_SIDE} pixels a side"))
                .fix("copy or export this image again")
        };
        let options = DecoderOptions::default()
            .set_strict_mode(true)
            .set_max_width(MAX_SIDE as usize)
            .set_max_height(MAX_SIDE as usize)
            .jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(|e| broken(e.to_string()))?;
        let (width, height) = decoder.dimensions().ok_or_else(|| broken("no size".into()))?;
        if (width as u64) * (height as u64) > MAX_PIXELS {
            return Err(broken(format!("{width} × {height} pixels")));
        }
        let rgb = decoder.decode().map_err(|e| broken(e.to_string()))?;
        if rgb.len() != 3 * width * height {
            return Err(broken(format!("{} bytes for {width} × {height} pixels", rgb.len())));
        }
        let pixels = rgb.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255]).collect();
        Ok(Image { width, height, pixels, has_alpha: false })
    }

    /// Decodes a PNG file of any colour type; 16-bit samples keep their upper byte.
    pub fn read(path: &Path) -> Result<Image> {
        Self::decode_png(open(path)?, path)
    }

    fn decode_png<R: BufRead + Seek>(mut reader: png::Reader<R>, path: &Path) -> Result<Image> {
        let size = reader.output_buffer_size().ok_or_else(|| too_large(path, reader.info()))?;
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
        Ok(Image { width, height, pixels, has_alpha })
    }

    /// Width and height of a PNG file, from the header alone.
    fn size(path: &Path) -> Result<(usize, usize)> {
        let reader = open(path)?;
        Ok((reader.info().width as usize, reader.info().height as usize))
    }

    /// Whether some pixel lets the background through.
    pub fn is_transparent_somewhere(&self) -> bool {
        self.has_alpha && self.pixels.iter().any(|p| p[3] < 250)
    }
}

fn starts_as_jpeg(path: &Path) -> Result<bool> {
    let mut start = Vec::new();
    let file = File::open(path).map_err(|e| Error::io(path, "open the image", &e))?;
    file.take(3).read_to_end(&mut start).map_err(|e| Error::io(path, "read the image", &e))?;
    Ok(start == [0xff, 0xd8, 0xff])
}

/// Reads the header and refuses sizes that cannot be a video frame, before anything is allocated for them.
fn open(path: &Path) -> Result<png::Reader<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io(path, "open the image", &e))?;
    opened(BufReader::new(file), path)
}

fn opened<R: BufRead + Seek>(source: R, path: &Path) -> Result<png::Reader<R>> {
    let limits = png::Limits { bytes: 1 << 30 };
    let mut decoder = png::Decoder::new_with_limits(source, limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let header = decoder.read_header_info().map_err(|e| broken(path, &e))?;
    if header.width.max(header.height) > MAX_SIDE || u64::from(header.width) * u64::from(header.height) > MAX_PIXELS {
        return Err(too_large(path, header));
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

fn broken(path: &Path, error: &png::DecodingError) -> Error {
    Error::new(ErrorKind::Input, "cannot decode the image")
        .at(path.display())
        .found(error)
        .wanted("a complete PNG file")
        .fix("copy or export this image again")
}

fn too_large(path: &Path, info: &png::Info<'_>) -> Error {
    Error::new(ErrorKind::Input, "the image is too large")
        .at(path.display())
        .found(format!("{} × {} pixels", info.width, info.height))
        .wanted(format!("at most {MAX_SIDE} pixels a side and {} megapixels", MAX_PIXELS >> 20))
        .fix("shrink the frames before opening the clip")
}
