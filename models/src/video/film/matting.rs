//! Segmentation of the object in a film.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::chosen::Chosen;
use super::median::median;
use super::pictures::Series;
use super::source::shrunk;
use super::window::{self, Window};
use super::{FilmSettings, Wanted, backdrop, corrected, lost, network, objects, plate};
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
pub(super) fn frames(path: &Path, chosen: &mut Chosen, settings: &FilmSettings) -> Result<Found> {
    let (width, height) = (chosen.images[0].width, chosen.images[0].height);
    let Told { foreground, mut mattes, mut hueless, mut said } = mattes(chosen, settings)?;
    (chosen.images, chosen.beside) = (vec![], vec![]);
    let all: Vec<Vec<bool>> =
        mattes.iter().map(|(_, alpha)| alpha.iter().map(|alpha| *alpha > 0.5).collect()).collect();
    let numbers = &chosen.numbers;
    if let Some(alone) = objects::alone(&mut mattes, width, height, &path.display().to_string())? {
        for ((matte, (_, left)), all) in hueless.iter_mut().flatten().zip(&mattes).zip(&all) {
            objects::leave_out_of(matte, left, all, [width, height]);
        }
        mattes.truncate(alone.frames);
        hueless.iter_mut().for_each(|hueless| hueless.truncate(alone.frames));
        said.push(alone.said);
    }
    let lost =
        lost::frames(path, &mattes, foreground, numbers, chosen.survey.as_ref().is_some_and(|s| s.run.is_some()))?;
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
fn mattes(chosen: &Chosen, settings: &FilmSettings) -> Result<Told> {
    let images = &chosen.images;
    let (width, height) = (images[0].width, images[0].height);
    let only = |foreground, mattes| Ok(Told { foreground, mattes, hueless: None, said: vec![] });
    let under = |masks: &[Mask]| images.iter().zip(masks).map(|(image, mask)| masked(image, mask)).collect();
    if let Some(folder) = &settings.masks {
        let (masks, said) = masks(folder, chosen)?;
        return Ok(Told { foreground: Foreground::Mask, mattes: under(&masks), hueless: None, said });
    }
    if let Some(settings) = &settings.matting {
        let (masks, said) = network::masks(settings, images)?;
        return Ok(Told { foreground: Foreground::Network, mattes: under(&masks), hueless: None, said });
    }
    if images.iter().any(Image::is_transparent_somewhere) {
        return only(Foreground::ImageAlpha, images.iter().map(on_white).collect());
    }
    let scale = chosen.scale();
    let surveyed = chosen.survey.as_ref().zip(scale);
    let windows = surveyed.map(|(survey, scale)| window::all(chosen, survey, scale));
    // the object alone where the survey knows which it is
    let tidy = |told: Result<Told>| -> Result<Told> {
        let mut told = told?;
        if let Some((survey, scale)) = surveyed {
            for mattes in std::iter::once(&mut told.mattes).chain(&mut told.hueless) {
                window::alone(mattes, &chosen.numbers, survey, scale, [width, height]);
            }
        }
        Ok(told)
    };
    let told = |foreground, (mattes, hueless)| Ok(Told { foreground, mattes, hueless, said: vec![] });
    if let Some(file) = &settings.background {
        let plate = Image::read_any(file)?;
        same_size(file, (plate.width, plate.height), chosen.size)?;
        let plate = shrunk(plate, (width, height));
        return tidy(told(Foreground::Plate, against(chosen, &plate, windows.as_deref())));
    }
    match plain(images) {
        Some(colour) if colour.iter().all(|v| *v >= WHITE) => {
            tidy(only(Foreground::White, images.par_iter().map(matte::from_white).collect()))
        }
        Some([r, g, b]) => {
            let plate = Image { pixels: vec![[r, g, b, 255]; images[0].pixels.len()], ..images[0].clone() };
            tidy(told(Foreground::Plain, against(chosen, &plate, windows.as_deref())))
        }
        None => {
            let Some((survey, scale)) = surveyed else {
                let mut empty = backdrop::of(images);
                for _ in 0..ROUNDS {
                    // prefer an object region that is too large to one that is too small
                    let (without, with) = against(chosen, &empty, None);
                    empty = corrected::of(images, with.as_ref().unwrap_or(&without), &empty);
                }
                return told(Foreground::Still, against(chosen, &empty, None));
            };
            let empty = plate::of(chosen, survey, scale);
            tidy(told(Foreground::Still, against(chosen, &empty, windows.as_deref())))
        }
    }
}

/// Mattes by difference against a plate, in windows where they are known; for pictures of few colours those with
/// parts in the background's hue, too.
fn against(chosen: &Chosen, plate: &Image, windows: Option<&[Window]>) -> (Vec<Matte>, Option<Vec<Matte>>) {
    let images = &chosen.images;
    let (width, height) = (plate.width, plate.height);
    let whole = vec![Window { left: 0, top: 0, width, height }; images.len()];
    let windows = windows.unwrap_or(&whole);
    let parts: Vec<(Image, Image)> =
        images.iter().zip(windows).map(|(image, window)| (window.of(image), window.of(plate))).collect();
    if chosen.few_colours {
        let both = |((image, plate), window): (&(Image, Image), &Window)| {
            let (without, with) = matte::of_few_colours(image, plate);
            (window.into_whole(without, width, height), window.into_whole(with, width, height))
        };
        let (without, with): (Vec<_>, Vec<_>) = parts.par_iter().zip(windows).map(both).unzip();
        return (without, Some(with));
    }
    let light = Light::of_pairs(&parts);
    let one = |((image, plate), window): (&(Image, Image), &Window)| {
        let weight = vec![1.0; plate.pixels.len()];
        window.into_whole(matte::against_plate(image, plate, &weight, &light), width, height)
    };
    (parts.par_iter().zip(windows).map(one).collect(), None)
}

/// The border colour of all frames, if it is uniform.
fn plain(images: &[Image]) -> Option<[u8; 3]> {
    let border = |image: &Image| {
        let (w, h) = (image.width, image.height);
        let at_edge = move |i: &usize| i % w < 2 || i % w + 2 >= w || i / w < 2 || i / w + 2 >= h;
        (0..w * h).filter(at_edge).map(|i| image.pixels[i]).collect::<Vec<_>>()
    };
    let pixels: Vec<[u8; 4]> = images.iter().flat_map(border).collect();
    let middle = [0, 1, 2].map(|c| median(&mut pixels.iter().map(|p| p[c]).collect::<Vec<u8>>()));
    let near = |p: &&[u8; 4]| (0..3).all(|c| p[c].abs_diff(middle[c]) <= PLAIN.0);
    (pixels.iter().filter(near).count() as f64 >= PLAIN.1 * pixels.len() as f64).then_some(middle)
}

/// A mask for each picture, and messages about their names.
fn masks(folder: &Path, chosen: &Chosen) -> Result<(Vec<Mask>, Vec<String>)> {
    let (first, last) = (chosen.numbers[0], chosen.numbers[chosen.numbers.len() - 1]);
    let series = Series::of(folder)?;
    let files = series.chosen(folder, Wanted { first, count: last + 1 - first })?;
    if files.len() < last + 1 - first {
        return Err(Error::new(ErrorKind::Input, "the film has more frames than masks")
            .at(folder.display())
            .found(format!("{} PNG or JPEG files", series.files.len()))
            .wanted(format!("one for each of the frames {first} to {last}"))
            .fix("add the missing masks, numbered as the frames are, or take fewer frames (--frames)"));
    }
    let (width, height) = (chosen.images[0].width, chosen.images[0].height);
    let read = |number: &usize| {
        let file = &files[number - first];
        let mask = Mask::read(file)?;
        same_size(file, (mask.width, mask.height), chosen.size)?;
        let pixels = mask.coverage.iter().map(|&v| [v, v, v, 255]).collect();
        let mask = shrunk(Image { width: mask.width, height: mask.height, pixels, has_alpha: false }, (width, height));
        Ok(Mask { width, height, coverage: mask.pixels.iter().map(|p| p[0]).collect() })
    };
    Ok((chosen.numbers.iter().map(read).collect::<Result<_>>()?, series.said))
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
