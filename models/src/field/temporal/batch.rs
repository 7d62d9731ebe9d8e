//! Rays drawn from all views and frames of a clip.

use std::ops::Range;

use gradreel::{DType, Key, Result, Tape, Tensor};

use super::losses::RayTargets;
use crate::render::{Rays, ViewWeights, camera_angles};
use crate::vector::minus;
use crate::video::{Clip, PixelRect};

/// Margin around the object's bounding rectangle \[pixels\].
const MARGIN: usize = 4;

/// A batch of rays with their times and targets.
#[derive(Debug, Clone)]
pub struct RayBatch {
    /// The rays.
    pub rays: Rays,
    /// The frame of each ray, an index into `ClipRays::times`.
    pub moment_of: Vec<u32>,
    /// Their targets.
    pub targets: RayTargets,
}

impl RayBatch {
    /// A contiguous part of the batch.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    ///
    /// # Panics
    /// When the range exceeds the batch.
    pub fn part(&self, range: Range<usize>) -> Result<Self> {
        if range == (0..self.rays.len()) {
            return Ok(self.clone());
        }
        let tape = Tape::new();
        let rows = |x: &Tensor| tape.constant(x.clone()).slice(0, range.clone()).value().cloned();
        Ok(Self {
            rays: self.rays.picked(&range.clone().collect::<Vec<_>>()),
            moment_of: self.moment_of[range.clone()].to_vec(),
            targets: RayTargets {
                colours: rows(&self.targets.colours)?,
                weight: rows(&self.targets.weight)?,
                imagined: self.targets.imagined.as_ref().map(rows).transpose()?,
            },
        })
    }
}

/// The pixels of a clip, as rays to sample from.
pub struct ClipRays<'c> {
    pub(super) clip: &'c Clip,
    views: ViewWeights,
    angles: Vec<f64>,
    primary: usize,
    pub(super) imagined: Vec<bool>,
    object_share: f64,
    rects: Vec<Vec<Option<PixelRect>>>,
    /// How far the field's coordinates of each frame are from the world's \[m\].
    pub(super) offsets: Vec<[f64; 3]>,
    /// Normalised time of each frame: 0 at the first, 1 at the last.
    pub times: Vec<f64>,
}

impl<'c> ClipRays<'c> {
    /// All pixels of a clip. Cameras are sampled with the weights `views`, by their angle to the camera `primary` as
    /// seen from `centre` \[m\]. `imagined` lists the indices of imagined cameras. A share `object_share` of the rays
    /// is drawn from the bounding rectangle of the object.
    ///
    /// # Panics
    /// When `primary` is out of range.
    pub fn new(
        clip: &'c Clip,
        views: &ViewWeights,
        centre: [f64; 3],
        primary: usize,
        imagined: &[usize],
        object_share: f64,
    ) -> Self {
        let frames = clip.frame_count();
        let rects = (0..clip.cameras.len()).map(|c| (0..frames).map(|f| clip.pixel_rect(c, f, MARGIN)).collect());
        let span = (clip.times[frames - 1] - clip.times[0]).max(f64::MIN_POSITIVE);
        Self {
            clip,
            views: views.clone(),
            angles: camera_angles(&clip.cameras, centre, primary),
            primary,
            imagined: (0..clip.cameras.len()).map(|c| imagined.contains(&c)).collect(),
            object_share,
            rects: rects.collect(),
            offsets: vec![[0.0; 3]; frames],
            times: clip.times.iter().map(|t| (t - clip.times[0]) / span).collect(),
        }
    }

    /// The same in coordinates that follow the object: those of each frame are moved by its offset \[m\].
    ///
    /// # Panics
    /// When there is not one offset for each frame.
    #[must_use]
    #[track_caller]
    pub fn following(self, offsets: Vec<[f64; 3]>) -> Self {
        assert_eq!(offsets.len(), self.times.len(), "one offset for each frame");
        Self { offsets, ..self }
    }

    /// Draws a batch of rays. The same key gives the same batch.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn draw(&self, key: Key, count: usize, dtype: DType) -> Result<RayBatch> {
        let [views, frames, places, shares] = key.split();
        let cameras = self.views.draw(&self.angles, self.primary, views, count);
        let frames: Vec<usize> = frames.below(self.times.len(), count).collect();
        let places: Vec<f64> = places.uniform(2 * count).collect();
        let shares: Vec<f64> = shares.uniform(count).collect();
        let mut batch = Vec::with_capacity(count);
        for i in 0..count {
            let (camera, frame) = (cameras[i], frames[i]);
            let size = &self.clip.cameras[camera];
            let whole = PixelRect { left: 0, top: 0, right: size.width, bottom: size.height };
            let rect = self.rects[camera][frame].filter(|_| shares[i] < self.object_share).unwrap_or(whole);
            let column = rect.left + (places[2 * i] * rect.width() as f64) as usize;
            let row = rect.top + (places[2 * i + 1] * rect.height() as f64) as usize;
            batch.push((camera, frame, row, column));
        }
        self.batch(&batch, dtype)
    }

    /// Number of cameras.
    pub fn cameras(&self) -> usize {
        self.clip.cameras.len()
    }

    /// Draws a camera by the view weights.
    pub fn draw_camera(&self, key: Key) -> usize {
        self.views.draw(&self.angles, self.primary, key, 1)[0]
    }

    /// Draws rays of one image, or all of them if the image has no more pixels.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    ///
    /// # Panics
    /// When the camera or frame is out of range.
    pub fn draw_from(&self, camera: usize, frame: usize, key: Key, count: usize, dtype: DType) -> Result<RayBatch> {
        let width = self.clip.cameras[camera].width;
        let pixels = width * self.clip.cameras[camera].height;
        if count >= pixels {
            return self.picture(camera, frame, dtype);
        }
        let place = |i: usize| (camera, frame, i / width, i % width);
        self.batch(&key.below(pixels, count).map(place).collect::<Vec<_>>(), dtype)
    }

    /// Every pixel of one image, row by row.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    ///
    /// # Panics
    /// When the camera or frame is out of range.
    pub fn picture(&self, camera: usize, frame: usize, dtype: DType) -> Result<RayBatch> {
        let size = &self.clip.cameras[camera];
        let pixels = (0..size.height).flat_map(|row| (0..size.width).map(move |column| (camera, frame, row, column)));
        self.batch(&pixels.collect::<Vec<_>>(), dtype)
    }

    /// Coverage of each pixel of an image, row by row.
    ///
    /// # Panics
    /// When the camera or frame is out of range.
    pub fn coverage(&self, camera: usize, frame: usize) -> Vec<f64> {
        self.clip.frames[camera][frame].alpha.iter().map(|&alpha| f64::from(alpha)).collect()
    }

    fn batch(&self, pixels: &[(usize, usize, usize, usize)], dtype: DType) -> Result<RayBatch> {
        let mut rays = Rays::default();
        let (mut colours, mut weight, mut imagined) = (Vec::new(), Vec::new(), Vec::new());
        for &(camera, frame, row, column) in pixels {
            let (origin, direction) = self.clip.cameras[camera].ray(column as f64 + 0.5, row as f64 + 0.5);
            rays.origins.push(minus(origin, self.offsets[frame]));
            rays.directions.push(direction);
            let image = &self.clip.frames[camera][frame];
            colours.extend((0..3).map(|c| image.rgb[[row, column, c]]));
            weight.push(image.weight[[row, column]]);
            imagined.push(f32::from(u8::from(self.imagined[camera])));
        }
        let count = pixels.len();
        let flags = |imagined| Tensor::from_vec(imagined, [count]).cast(dtype);
        let targets = RayTargets {
            colours: Tensor::from_vec(colours, [count, 3]).cast(dtype)?,
            weight: Tensor::from_vec(weight, [count]).cast(dtype)?,
            imagined: self.imagined.contains(&true).then(|| flags(imagined)).transpose()?,
        };
        Ok(RayBatch { rays, moment_of: pixels.iter().map(|(_, frame, ..)| *frame as u32).collect(), targets })
    }
}
