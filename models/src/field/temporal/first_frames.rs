//! A small fit to the first frames of a clip, for the motion before contact.

use gradreel::{DType, Result};
use serde::{Deserialize, Serialize};

use super::{ClipRays, TemporalFit, TemporalFitSettings, TemporalProgress, TemporalSettings};
use crate::field::bounding_sphere;
use crate::render::ViewWeights;
use crate::video::Clip;

/// Settings of the fit to the first frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FirstFrames {
    /// Largest number of frames, from the first on.
    pub frames: usize,
    /// Largest side of the shrunk images \[pixels\].
    pub side: usize,
    /// Sizes of the field.
    pub field: TemporalSettings,
    /// Settings of the fit.
    pub fit: TemporalFitSettings,
}

impl Default for FirstFrames {
    fn default() -> Self {
        Self {
            frames: 6,
            side: 80,
            field: TemporalSettings {
                width: 32,
                channels: 6,
                position_levels: 4,
                time_levels: 4,
                ..Default::default()
            },
            fit: TemporalFitSettings {
                iterations: 400,
                rays: 1024,
                rays_at_once: 1024,
                nodes: 40_000,
                refinements: 1,
                grid_rate: 0.2,
                network_rate: 2e-3,
                bending_rate: 2e-3,
                mask_nodes: 8000,
                mask_every: 50,
                ..TemporalFitSettings::default()
            },
        }
    }
}

/// Share of rays drawn from the bounding rectangle of the object.
const OBJECT_SHARE: f64 = 0.7;
/// Distance to the ground that counts as contact, relative to the box's height.
const REACH: f64 = 0.04;
/// Nodes at which the field is evaluated for its motion.
const NODES: usize = 30_000;

/// The flight as derived from a field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flight {
    /// Initial velocity \[m/s\].
    pub velocity: [f64; 3],
    /// First frame in contact with the ground, if any.
    pub contact: Option<usize>,
}

/// The first frames of a clip, shrunk.
pub struct FirstFramesClip {
    /// The frames.
    pub clip: Clip,
    /// Lowest and highest corner of a box around the object \[m\].
    pub corners: [[f64; 3]; 2],
}

impl FirstFrames {
    /// Selects and shrinks the first frames of a clip.
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when some frame shows the object in no camera.
    pub fn of(&self, clip: &Clip) -> Result<FirstFramesClip> {
        let frames = self.frames.clamp(1, clip.frame_count());
        let largest = clip.cameras.iter().map(|camera| camera.width.max(camera.height)).max().unwrap_or(1);
        let mut clip = clip.scaled(largest.div_ceil(self.side.max(1)).max(1));
        clip.times.truncate(frames);
        clip.frame_numbers.truncate(frames);
        clip.frames.iter_mut().for_each(|view| view.truncate(frames));
        let [mut low, mut high] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for frame in 0..frames {
            let ball = bounding_sphere(&clip, frame)?;
            for axis in 0..3 {
                low[axis] = low[axis].min(ball.centre[axis] - ball.radius);
                high[axis] = high[axis].max(ball.centre[axis] + ball.radius);
            }
        }
        Ok(FirstFramesClip { clip, corners: [low, high] })
    }

    /// Fits a temporal field.
    ///
    /// # Errors
    /// Propagates errors of the fit and of `each`.
    pub fn fit(
        &self,
        first: &FirstFramesClip,
        rays: &ClipRays<'_>,
        sizes: &TemporalSettings,
        mut each: impl FnMut(TemporalProgress) -> Result<()>,
    ) -> Result<TemporalFit> {
        let [low, high] = first.corners;
        let mut fit = TemporalFit::new(low, high, sizes, &self.fit, DType::F32)?.within_silhouettes(rays)?;
        fit.run(rays, |_, progress| each(progress))?;
        Ok(fit)
    }
}

impl FirstFramesClip {
    /// The pixels to fit to. If some views are imagined, views are weighted by their angle to the first real one.
    pub fn rays(&self, views: &ViewWeights) -> ClipRays<'_> {
        let imagined: Vec<usize> = (0..self.clip.imagined.len()).filter(|&view| self.clip.imagined[view]).collect();
        let alpha = if imagined.is_empty() { 0.0 } else { views.alpha };
        let primary = self.clip.imagined.iter().position(|imagined| !imagined).unwrap_or(0);
        let [low, high] = self.corners;
        let centre = [0, 1, 2].map(|axis| (low[axis] + high[axis]) / 2.0);
        ClipRays::new(&self.clip, &ViewWeights { alpha, ..views.clone() }, centre, primary, &imagined, OBJECT_SHARE)
    }

    /// The flight over a ground at this height \[m\], from a fitted field.
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when the field is empty, or there is only one frame.
    pub fn flight(&self, fit: &TemporalFit, rays: &ClipRays<'_>, gravity: [f64; 3], ground: f64) -> Result<Flight> {
        let motion = fit.field.motion(&fit.params, &rays.times, &self.clip.times, NODES)?;
        let [low, high] = self.corners;
        let contact = motion.first_contact(ground, REACH * (high[1] - low[1]));
        let (_, velocity) = motion.ballistic(gravity, contact.unwrap_or(self.clip.frame_count()).max(2))?;
        Ok(Flight { velocity, contact })
    }
}
