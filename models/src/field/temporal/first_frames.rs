//! A small fit to the first frames of a clip: what the object does before it meets the ground.

use gradreel::{DType, Result};
use serde::{Deserialize, Serialize};

use super::{ClipRays, TemporalFit, TemporalFitSettings, TemporalProgress, TemporalSettings};
use crate::field::bounding_sphere;
use crate::render::ViewWeights;
use crate::video::Clip;

/// How the first frames are looked at; the default takes a minute or two on two cores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FirstFrames {
    /// Frames at most, from the first on.
    pub frames: usize,
    /// Images are shrunk to at most so many pixels a side.
    pub side: usize,
    /// Sizes of the field.
    pub field: TemporalSettings,
    /// Effort.
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

/// Share of rays through the rectangle around the object.
const OBJECT_SHARE: f64 = 0.7;
/// The object touches the ground when it is this near, in shares of the box's height.
const REACH: f64 = 0.04;
/// Nodes on which the field is looked at for its motion.
const NODES: usize = 30_000;

/// What a field says of the flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flight {
    /// Initial velocity \[m/s\].
    pub velocity: [f64; 3],
    /// First of the frames in contact with the ground, if there is one among them.
    pub contact: Option<usize>,
}

/// A clip's first frames, shrunk.
pub struct FirstFramesClip {
    /// The frames.
    pub clip: Clip,
    /// Lowest and highest corner of a box that holds the object \[m\].
    pub corners: [[f64; 3]; 2],
}

impl FirstFrames {
    /// The first frames of a clip as they are looked at.
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when no camera sees the object in one of them.
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

    /// Fits a field of these sizes.
    ///
    /// # Errors
    /// What the fit returns, and what `each` returns.
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
    /// The pixels to fit to. Views count by their angle to the first real one, if some are imagined.
    pub fn rays(&self, views: &ViewWeights) -> ClipRays<'_> {
        let imagined: Vec<usize> = (0..self.clip.imagined.len()).filter(|&view| self.clip.imagined[view]).collect();
        let alpha = if imagined.is_empty() { 0.0 } else { views.alpha };
        let primary = self.clip.imagined.iter().position(|imagined| !imagined).unwrap_or(0);
        let [low, high] = self.corners;
        let centre = [0, 1, 2].map(|axis| (low[axis] + high[axis]) / 2.0);
        ClipRays::new(&self.clip, &ViewWeights { alpha, ..views.clone() }, centre, primary, &imagined, OBJECT_SHARE)
    }

    /// What a fitted field says of the flight over a ground at this height \[m\].
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when the field is empty, or there is one frame only.
    pub fn flight(&self, fit: &TemporalFit, rays: &ClipRays<'_>, gravity: [f64; 3], ground: f64) -> Result<Flight> {
        let motion = fit.field.motion(&fit.params, &rays.times, &self.clip.times, NODES)?;
        let [low, high] = self.corners;
        let contact = motion.first_contact(ground, REACH * (high[1] - low[1]));
        let (_, velocity) = motion.ballistic(gravity, contact.unwrap_or(self.clip.frame_count()).max(2))?;
        Ok(Flight { velocity, contact })
    }
}
