//! What the model is shown of each frame, and where its views belong.

use gradreel::{Error, ErrorKind, Result, Tensor};
use ndarray::{Array2, Array3};

use super::placed::{Move, moved, within};
use super::{Path, Placing, Rig};
use crate::vector::minus;
use crate::video::{Camera, Clip, Frame};
use crate::views::{Detection, ImageBox, ModelSizes};

/// Least size of an object that the spatial-aware module places, in units of the model; smaller ones it was never shown.
const SMALLEST: f64 = 0.2;

/// Sides of the pictures of moved views at most, in those of the model.
const FINEST: usize = 4;

/// Darkness below which a pixel of a view counts as white, and that above which it is all object, in 0…1.
const WHITE: [f32; 2] = [0.05, 0.15];

/// Pixels of a centred object along its longer side where a model does not say, of 256.
const USUAL_CROP: usize = 128;

/// All frames of a film with the object's place in each.
pub(crate) struct Pictures<'a> {
    pub film: &'a Clip,
    pub boxes: &'a [ImageBox],
    pub path: &'a Path,
    pub rig: &'a Rig,
}

/// What the model is shown of a frame.
#[derive(Debug, Clone)]
pub(crate) struct Shown {
    /// `[1, 3, s, s]` in −1…1.
    pub picture: Tensor,
    /// Elevation of the camera that took it \[rad\].
    pub elevation: f64,
    /// Where the object is in it, for the spatial-aware module.
    pub seen: Option<Detection>,
}

impl Pictures<'_> {
    /// How the object comes to its place: by the module, if the model has one, it is wanted, and the object is as large beside its path
    /// as those that modules are trained on.
    pub fn placing(&self, sizes: &ModelSizes, wanted: bool) -> Placing {
        let least = self.path.radii.iter().copied().fold(f64::INFINITY, f64::min);
        match wanted && sizes.denoiser.spatial_aware.is_some() && 2.0 * least / self.rig.scale() >= SMALLEST {
            true => Placing::Module,
            false => Placing::Moved,
        }
    }

    /// What the model is shown of a frame.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] where the object is behind the camera.
    pub fn shown(&self, frame: usize, sizes: &ModelSizes, placing: Placing) -> Result<Shown> {
        let (size, bounds) = (sizes.image, &self.boxes[frame]);
        let object = within(&self.film.frames[0][frame], bounds);
        let from = self.in_pixels(bounds.centre());
        let ([to, scale], elevation, seen) = match placing {
            Placing::Module => {
                let camera = self.rig.input(size);
                let [u, v, depth] = projected(&camera, self.path.places[frame])?;
                let scale = camera.fx / depth / self.density(frame)?;
                let half = self.in_pixels([0, 1].map(|axis| 0.5 * (bounds.high[axis] - bounds.low[axis])));
                let end = |sign: f64| [0, 1].map(|axis| ([u, v][axis] + sign * scale * half[axis]) / size as f64);
                let depth = Some(depth / self.rig.scale());
                let seen = Detection { bounds: ImageBox { low: end(-1.0), high: end(1.0) }, depth };
                ([[u, v], [scale; 2]], self.rig.elevation(), Some(seen))
            }
            Placing::Moved => {
                let scale = self.centred(frame, sizes)? / self.density(frame)?;
                let away = minus(self.film.cameras[0].centre(), self.path.places[frame]);
                ([[0.5 * size as f64; 2], [scale; 2]], away[1].atan2(away[0].hypot(away[2])), None)
            }
        };
        let picture = moved(&object, Move { from, to, scale: scale[0] }, [size; 2]);
        Ok(Shown { picture: planes(&picture), elevation, seen })
    }

    /// The cameras of all views.
    ///
    /// # Errors
    /// As [`Pictures::shown`].
    pub fn cameras(&self, sizes: &ModelSizes, placing: Placing) -> Result<Vec<Camera>> {
        let side = match placing {
            Placing::Module => sizes.image,
            Placing::Moved => {
                // pixels as fine as those of the views
                let camera = self.rig.camera(0, sizes.image);
                let [.., depth] = projected(&camera, self.path.places[0])?;
                let finer = self.centred(0, sizes)? * depth / camera.fx;
                (finer.clamp(1.0, FINEST as f64) * sizes.image as f64).round() as usize
            }
        };
        let first = self.film.cameras[0].id + 1;
        Ok((0..self.rig.views())
            .map(|view| Camera { id: first + view as i64, ..self.rig.camera(view, side) })
            .collect())
    }

    /// The views of a frame `[views, 3, s, s]` in −1…1, with the object where it is.
    ///
    /// # Errors
    /// As [`Pictures::shown`]; where a picture cannot be read.
    pub fn views(&self, frame: usize, pictures: &Tensor, sizes: &ModelSizes, placing: Placing) -> Result<Vec<Frame>> {
        let cameras = self.cameras(sizes, placing)?;
        let frames = of_planes(pictures)?;
        if placing == Placing::Module {
            return Ok(frames);
        }
        let density = self.centred(frame, sizes)?;
        let middle = [0.5 * sizes.image as f64; 2];
        let place = |(view, camera): (&Frame, &Camera)| {
            let [u, v, depth] = projected(camera, self.path.places[frame])?;
            let by = Move { from: middle, to: [u, v], scale: camera.fx / depth / density };
            Ok(moved(view, by, [camera.width, camera.height]))
        };
        frames.iter().zip(&cameras).map(place).collect()
    }

    /// Pixels of the film per metre at the object's distance.
    fn density(&self, frame: usize) -> Result<f64> {
        let camera = &self.film.cameras[0];
        let [.., depth] = projected(camera, self.path.places[frame])?;
        Ok(camera.fx / depth)
    }

    /// Pixels per metre of a centred object: in every frame as many as in the first, unless it has spread beyond what a model draws.
    fn centred(&self, frame: usize, sizes: &ModelSizes) -> Result<f64> {
        let crop = if sizes.crop == 0 { USUAL_CROP } else { sizes.crop };
        let fits = |frame: usize| (crop * sizes.image) as f64 / 256.0 / (2.0 * self.path.radii[frame]);
        Ok(fits(frame).min(fits(0)))
    }

    fn in_pixels(&self, share: [f64; 2]) -> [f64; 2] {
        let camera = &self.film.cameras[0];
        [share[0] * camera.width as f64, share[1] * camera.height as f64]
    }
}

fn projected(camera: &Camera, place: [f64; 3]) -> Result<[f64; 3]> {
    camera.project(place).ok_or_else(|| {
        Error::new(ErrorKind::Input, "the object is behind a camera")
            .at(format!("camera {}", camera.id))
            .found(format!("{place:.3?} m"))
            .fix("check the boxes of all frames (--boxes)")
    })
}

/// A picture over white as planes `[1, 3, h, w]` in −1…1.
fn planes(frame: &Frame) -> Tensor {
    let (height, width) = frame.alpha.dim();
    let value = |i: usize| {
        let (channel, pixel) = (i / (width * height), i % (width * height));
        2.0 * frame.rgb[[pixel / width, pixel % width, channel]] - 1.0
    };
    Tensor::from_vec((0..3 * width * height).map(value).collect::<Vec<f32>>(), [1, 3, height, width])
}

/// Views `[views, 3, s, s]` in −1…1 as frames of what is not white.
pub(crate) fn of_planes(pictures: &Tensor) -> Result<Vec<Frame>> {
    let [views, 3, height, width] = pictures.dims()[..] else {
        return Err(Error::new(ErrorKind::Input, "these are no views").found(pictures.shape().to_string()));
    };
    let values = pictures.to_vec()?;
    let area = width * height;
    let frame = |view: usize| {
        let at = |y: usize, x: usize, c: usize| {
            ((values[(3 * view + c) * area + y * width + x] + 1.0) / 2.0).clamp(0.0, 1.0) as f32
        };
        let alpha = Array2::from_shape_fn((height, width), |(y, x)| {
            let darkness = (0..3).map(|c| 1.0 - at(y, x, c)).fold(0.0, f32::max);
            ((darkness - WHITE[0]) / (WHITE[1] - WHITE[0])).clamp(0.0, 1.0)
        });
        // what counts as white is white
        let colour = |(y, x, c)| {
            at(y, x, c) * f32::from(u8::from(alpha[[y, x]] > 0.0)) + f32::from(u8::from(alpha[[y, x]] == 0.0))
        };
        Frame { rgb: Array3::from_shape_fn((height, width, 3), colour), weight: Array2::ones((height, width)), alpha }
    };
    Ok((0..views).map(frame).collect())
}
