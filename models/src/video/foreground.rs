//! The foreground source of a camera, and assembling a frame from its images.

use std::fmt;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};

use super::clip::Frame;
use super::image::Image;
use super::layout::{EXCLUDED, Format, Kind, Layout, PLATE};
use super::mask::Mask;
use super::matte::{self, Light};
use super::select::ranges;

/// How a camera's images are separated into object and background.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Foreground {
    /// Given masks `a_{camera}_{frame}.png`: the object with its alpha channel.
    MaskAlpha,
    /// Given masks `m_{camera}_{frame}.png`: the object on white.
    MaskOnWhite,
    /// Given masks in `masks/`, white on the object.
    Mask,
    /// The transparent pixels of the images themselves.
    ImageAlpha,
    /// Difference against a background plate (`r_{camera}_-1.png` in PAC-NeRF's layout).
    Plate,
    /// A white background.
    White,
    /// A background of one colour.
    Plain,
    /// Difference against a background estimated from the frames in which the object is elsewhere.
    Still,
    /// A given matting network.
    Network,
}

impl fmt::Display for Foreground {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Foreground::MaskAlpha => "given masks a_{camera}_{frame}.png",
            Foreground::MaskOnWhite => "given masks m_{camera}_{frame}.png on white",
            Foreground::Mask => "given masks, white where the object is",
            Foreground::ImageAlpha => "the alpha channel of the images",
            Foreground::Plate => "difference against the background plate",
            Foreground::White => "difference from white",
            Foreground::Plain => "difference from the background's one colour",
            Foreground::Still => "difference against what is seen while it is elsewhere",
            Foreground::Network => "a matting network",
        })
    }
}

/// The foreground source of one camera, with the images it needs besides the frame itself.
pub(super) struct Source {
    pub foreground: Foreground,
    plate: Option<Image>,
    /// Illumination of the images, if they are compared with a plate.
    light: Light,
    /// 0 for excluded pixels, 1 elsewhere.
    weight: Vec<f32>,
}

impl Source {
    /// Chooses the foreground source of a camera with these images.
    pub fn choose(layout: &Layout, camera: i64, frames: &[i64], images: &[Image]) -> Result<Source> {
        let size = [images[0].width, images[0].height];
        let foreground = choose(layout, camera, frames, images.iter().any(Image::is_transparent_somewhere))?;
        let read = |frame: i64| -> Result<Image> {
            let path = layout.file(Kind::Image, camera, frame);
            let image = Image::read_frame(&path)?;
            same_size(&path, (image.width, image.height), camera, size)?;
            Ok(image)
        };
        let plate = if foreground == Foreground::Plate { Some(read(PLATE)?) } else { None };
        let excluded = if layout.has(Kind::Image, camera, EXCLUDED) { Some(read(EXCLUDED)?) } else { None };
        if let Some(mask) = &excluded
            && !mask.has_alpha
        {
            return Err(Error::new(ErrorKind::Input, "the plate of excluded pixels has no alpha channel")
                .at(layout.file(Kind::Image, camera, EXCLUDED).display())
                .found("an opaque image")
                .wanted("an RGBA image whose alpha above 50/255 marks the pixels to leave out")
                .fix("export it with transparency, or remove it"));
        }
        let weight = match &excluded {
            None => vec![1.0; size[0] * size[1]],
            Some(mask) => mask.pixels.iter().map(|p| if p[3] > 50 { 0.0 } else { 1.0 }).collect(),
        };
        let light = plate.as_ref().map(|plate| Light::of(images, plate, &weight)).unwrap_or_default();
        Ok(Source { foreground, plate, light, weight })
    }

    /// Makes a frame from an image just read from `layout`.
    pub fn frame(&self, layout: &Layout, camera: i64, frame: i64, image: &Image) -> Result<Frame> {
        let (w, h) = (image.width, image.height);
        let mask = |kind: Kind| -> Result<Image> {
            let path = layout.file(kind, camera, frame);
            let mask = Image::read_frame(&path)?;
            same_size(&path, (mask.width, mask.height), camera, [w, h])?;
            if kind == Kind::MaskAlpha && !mask.has_alpha {
                return Err(Error::new(ErrorKind::Input, "the mask has no alpha channel")
                    .at(path.display())
                    .found("an opaque image")
                    .wanted("an RGBA image of the object")
                    .fix("export it with transparency; an object on white belongs into an m_ file"));
            }
            Ok(mask)
        };
        let (rgb, alpha) = match (self.foreground, &self.plate) {
            (Foreground::MaskAlpha, _) => on_white(&mask(Kind::MaskAlpha)?),
            (Foreground::MaskOnWhite, _) => matte::from_white(&mask(Kind::MaskOnWhite)?),
            (Foreground::Mask, _) => {
                let path = layout.file(Kind::Mask, camera, frame);
                let mask = Mask::read(&path)?;
                same_size(&path, (mask.width, mask.height), camera, [w, h])?;
                masked(image, &mask)
            }
            (Foreground::Plate, Some(plate)) => matte::against_plate(image, plate, &self.weight, &self.light),
            _ => on_white(image),
        };
        Ok(Frame {
            rgb: Array3::from_shape_vec((h, w, 3), rgb.into_iter().flatten().collect()).expect("three values a pixel"),
            alpha: Array2::from_shape_vec((h, w), alpha).expect("one value a pixel"),
            weight: Array2::from_shape_vec((h, w), self.weight.clone()).expect("one value a pixel"),
        })
    }
}

/// Chooses a camera's foreground source by the files that exist.
pub(super) fn choose(layout: &Layout, camera: i64, frames: &[i64], transparent: bool) -> Result<Foreground> {
    let listed = |f: &i64| layout.path(Kind::Mask, camera, *f).filter(|path| !path.is_file());
    if let Some(lost) = frames.iter().find_map(listed) {
        return Err(Error::new(ErrorKind::Input, format!("a listed mask of camera {camera} does not exist"))
            .at(layout.list.display())
            .found(format!("no file {}", lost.display()))
            .wanted("masks at the places that mask_path names")
            .fix("add the mask, correct mask_path, or leave mask_path out"));
    }
    for (kind, foreground, name) in [
        (Kind::MaskAlpha, Foreground::MaskAlpha, format!("a_{camera}_{{frame}}.png")),
        (Kind::MaskOnWhite, Foreground::MaskOnWhite, format!("m_{camera}_{{frame}}.png")),
        (Kind::Mask, Foreground::Mask, "masks".to_owned()),
    ] {
        let given: Vec<i64> = frames.iter().copied().filter(|&f| layout.has(kind, camera, f)).collect();
        if given.len() == frames.len() {
            return Ok(foreground);
        }
        if !given.is_empty() {
            return Err(Error::new(ErrorKind::Input, format!("camera {camera} has masks for some frames only"))
                .at(place(layout).display())
                .found(format!("{name} for frames {}", ranges(&given)))
                .wanted(format!("masks for frames {}, or none", ranges(frames)))
                .fix("add the missing masks, or remove the others"));
        }
    }
    if transparent {
        return Ok(Foreground::ImageAlpha);
    }
    if layout.has(Kind::Image, camera, PLATE) {
        return Ok(Foreground::Plate);
    }
    let (wanted, fix) = match layout.format {
        Format::PacNerf => (
            format!(
                "masks a_{camera}_{{frame}}.png or m_{camera}_{{frame}}.png, or images with transparency, or the plate \
                 r_{camera}_-1.png"
            ),
            "film the scene once without the object and save it as the plate, or leave this camera out",
        ),
        _ => (
            "images with transparency, or a mask for each image under masks/ with the image's path, as .png, white where \
             the object is"
                .to_owned(),
            "make masks with a segmentation tool, or leave this camera out",
        ),
    };
    Err(Error::new(ErrorKind::Input, format!("nothing tells the object from the background in camera {camera}"))
        .at(place(layout).display())
        .found("opaque images, no masks, no background plate")
        .wanted(wanted)
        .fix(fix))
}

/// The folder named in messages about masks.
fn place(layout: &Layout) -> PathBuf {
    if layout.format == Format::PacNerf { layout.root.join("data") } else { layout.root.clone() }
}

/// Rejects an image whose size differs from that of its camera.
pub(super) fn same_size(path: &Path, found: (usize, usize), camera: i64, [width, height]: [usize; 2]) -> Result<()> {
    if found == (width, height) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, format!("an image of camera {camera} has another size than the others"))
        .at(path.display())
        .found(format!("{} × {} pixels", found.0, found.1))
        .wanted(format!("{width} × {height} pixels, like the first image of this camera"))
        .fix("export all images of a camera at one size"))
}

/// Composites an image with straight alpha on white.
pub(super) fn on_white(image: &Image) -> (Vec<[f32; 3]>, Vec<f32>) {
    image
        .pixels
        .iter()
        .map(|&[r, g, b, a]| {
            let alpha = f32::from(a) / 255.0;
            ([r, g, b].map(|v| alpha * f32::from(v) / 255.0 + (1.0 - alpha)), alpha)
        })
        .unzip()
}

/// Composites the masked part of an image on white.
pub(super) fn masked(image: &Image, mask: &Mask) -> (Vec<[f32; 3]>, Vec<f32>) {
    let pixels = image.pixels.iter().zip(&mask.coverage);
    let one = |(&[r, g, b, a], &covered): (&[u8; 4], &u8)| {
        let alpha = f32::from(covered) / 255.0 * f32::from(a) / 255.0;
        ([r, g, b].map(|v| alpha * f32::from(v) / 255.0 + (1.0 - alpha)), alpha)
    };
    pixels.map(one).unzip()
}
