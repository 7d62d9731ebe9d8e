//! Segmentation of the object in a film.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::pictures::Series;
use super::pile::{check_size, halved_with, shrunk};
use super::{Decoded, FilmSettings, Wanted, backdrop, corrected, lost, network, objects};
use crate::video::clip::Frame;
use crate::video::foreground::{Foreground, masked, on_white};
use crate::video::image::Image;
use crate::video::mask::Mask;
use crate::video::matte::{self, Light, Matte};

/// Maximum deviation of a plain background's border from its median per channel, and the minimum share of border
/// pixels within it.
const PLAIN: (u8, f64) = (12, 0.95);

/// Minimum channel value of a white background.
const WHITE: u8 = 248;

/// Number of background refinements.
const ROUNDS: usize = 2;

/// Result of the segmentation.
pub(super) struct Found {
    pub foreground: Foreground,
    /// The frames, with the object alone on white.
    pub frames: Vec<Frame>,
    /// The same with parts in the background's hue (see [`super::Film::hueless`]).
    pub hueless: Option<Vec<Frame>>,
    /// Frames in which the object was not found; their weight is 0.
    pub lost: Vec<usize>,
    /// Further messages.
    pub said: Vec<String>,
}

/// The foreground source and the mattes it yields.
struct Told {
    foreground: Foreground,
    mattes: Vec<Matte>,
    /// The mattes with parts in the background's hue included.
    hueless: Option<Vec<Matte>>,
    said: Vec<String>,
}

/// Segments the object by the first available source: given masks, a given network, the pictures' alpha channel, a
/// given background, a plain background (white or another colour), or a background estimated from the frames.
pub(super) fn frames(path: &Path, pictures: Decoded, settings: &FilmSettings, wanted: Wanted) -> Result<Found> {
    let (width, height) = (pictures.images[0].width, pictures.images[0].height);
    let Told { foreground, mut mattes, mut hueless, mut said } = mattes(&pictures, settings, wanted)?;
    drop(pictures);
    let all: Vec<Vec<bool>> =
        mattes.iter().map(|(_, alpha)| alpha.iter().map(|alpha| *alpha > 0.5).collect()).collect();
    if let Some(alone) = objects::alone(&mut mattes, width, height, &path.display().to_string())? {
        for ((matte, (_, left)), all) in hueless.iter_mut().flatten().zip(&mattes).zip(&all) {
            objects::leave_out_of(matte, left, all, [width, height]);
        }
        mattes.truncate(alone.frames);
        hueless.iter_mut().for_each(|hueless| hueless.truncate(alone.frames));
        said.push(alone.said);
    }
    let lost = lost::frames(path, &mattes, foreground, wanted)?;
    let frame = |(k, (rgb, alpha)): (usize, Matte)| match lost.contains(&k) {
        true => lost::nothing(width, height),
        false => Frame {
            rgb: Array3::from_shape_vec((height, width, 3), rgb.into_iter().flatten().collect())
                .expect("three values a pixel"),
            alpha: Array2::from_shape_vec((height, width), alpha).expect("one value a pixel"),
            weight: Array2::ones((height, width)),
        },
    };
    let frames = |mattes: Vec<Matte>| mattes.into_iter().enumerate().map(frame).collect::<Vec<_>>();
    Ok(Found { foreground, frames: frames(mattes), hueless: hueless.map(frames), lost, said })
}

/// Chooses the foreground source and computes the mattes.
fn mattes(pictures: &Decoded, settings: &FilmSettings, wanted: Wanted) -> Result<Told> {
    let images = &pictures.images;
    let against = |plate: &Image| {
        if pictures.few_colours {
            let (without, with): (Vec<_>, Vec<_>) =
                images.par_iter().map(|image| matte::of_few_colours(image, plate)).unzip();
            return (without, Some(with));
        }
        let weight = vec![1.0; plate.pixels.len()];
        let light = Light::of(images, plate, &weight);
        (images.par_iter().map(|image| matte::against_plate(image, plate, &weight, &light)).collect(), None)
    };
    let only = |foreground, mattes| Ok(Told { foreground, mattes, hueless: None, said: vec![] });
    let under = |masks: &[Mask]| images.iter().zip(masks).map(|(image, mask)| masked(image, mask)).collect();
    if let Some(folder) = &settings.masks {
        let (masks, said) = masks(folder, pictures, wanted)?;
        return Ok(Told { foreground: Foreground::Mask, mattes: under(&masks), hueless: None, said });
    }
    if let Some(settings) = &settings.matting {
        let (masks, said) = network::masks(settings, images)?;
        return Ok(Told { foreground: Foreground::Network, mattes: under(&masks), hueless: None, said });
    }
    if images.iter().any(Image::is_transparent_somewhere) {
        return only(Foreground::ImageAlpha, images.iter().map(on_white).collect());
    }
    let (foreground, (mattes, hueless)) = if let Some(file) = &settings.background {
        let plate = Image::read_any(file)?;
        same_size(file, (plate.width, plate.height), pictures.size)?;
        (Foreground::Plate, against(&shrunk(plate, pictures.halvings)))
    } else {
        match plain(images) {
            Some(colour) if colour.iter().all(|v| *v >= WHITE) => {
                return only(Foreground::White, images.par_iter().map(matte::from_white).collect());
            }
            Some([r, g, b]) => {
                let plate = Image { pixels: vec![[r, g, b, 255]; images[0].pixels.len()], ..images[0].clone() };
                (Foreground::Plain, against(&plate))
            }
            None => {
                let mut empty = backdrop::of(images);
                for _ in 0..ROUNDS {
                    // prefer an object region that is too large to one that is too small
                    let (without, with) = against(&empty);
                    empty = corrected::of(images, with.as_ref().unwrap_or(&without), &empty);
                }
                (Foreground::Still, against(&empty))
            }
        }
    };
    Ok(Told { foreground, mattes, hueless, said: vec![] })
}

/// The border colour of all frames, if it is uniform.
fn plain(images: &[Image]) -> Option<[u8; 3]> {
    let border = |image: &Image| {
        let (w, h) = (image.width, image.height);
        let at_edge = move |i: &usize| i % w < 2 || i % w + 2 >= w || i / w < 2 || i / w + 2 >= h;
        (0..w * h).filter(at_edge).map(|i| image.pixels[i]).collect::<Vec<_>>()
    };
    let pixels: Vec<[u8; 4]> = images.iter().flat_map(border).collect();
    let middle = [0, 1, 2].map(|c| median_of(pixels.iter().map(|p| p[c]).collect()));
    let near = |p: &&[u8; 4]| (0..3).all(|c| p[c].abs_diff(middle[c]) <= PLAIN.0);
    (pixels.iter().filter(near).count() as f64 >= PLAIN.1 * pixels.len() as f64).then_some(middle)
}

fn median_of(mut values: Vec<u8>) -> u8 {
    let middle = values.len() / 2;
    *values.select_nth_unstable(middle).1
}

/// A mask for each picture, and messages about their names.
fn masks(folder: &Path, pictures: &Decoded, wanted: Wanted) -> Result<(Vec<Mask>, Vec<String>)> {
    let count = pictures.images.len();
    let series = Series::of(folder)?;
    let chosen = series.chosen(folder, Wanted { count, ..wanted })?;
    if chosen.len() < count {
        return Err(Error::new(ErrorKind::Input, "the film has more frames than masks")
            .at(folder.display())
            .found(format!("{} PNG or JPEG files", series.files.len()))
            .wanted(format!("one for each of the frames {} to {}", wanted.first, wanted.first + count - 1))
            .fix("add the missing masks, numbered as the frames are, or take fewer frames (--frames)"));
    }
    let read = |file: &std::path::PathBuf| {
        check_size(file, Image::frame_size(file)?)?;
        let mask = Mask::read(file)?;
        same_size(file, (mask.width, mask.height), pictures.size)?;
        Ok((0..pictures.halvings).fold(mask, |mask, _| halved(&mask)))
    };
    Ok((chosen.iter().map(read).collect::<Result<_>>()?, series.said))
}

/// A mask at half the width and height.
fn halved(mask: &Mask) -> Mask {
    let mean = |four: [u8; 4]| ((four.iter().map(|v| u32::from(*v)).sum::<u32>() + 2) / 4) as u8;
    let coverage = halved_with(&mask.coverage, (mask.width, mask.height), mean);
    Mask { width: (mask.width / 2).max(1), height: (mask.height / 2).max(1), coverage }
}

fn same_size(file: &Path, found: (usize, usize), wanted: (usize, usize)) -> Result<()> {
    if found == wanted {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the picture has another size than the film")
        .at(file.display())
        .found(format!("{} × {} pixels", found.0, found.1))
        .wanted(format!("{} × {} pixels", wanted.0, wanted.1))
        .fix("export it at the film's size"))
}
