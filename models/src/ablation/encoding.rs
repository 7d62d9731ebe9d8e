//! Fits of the temporal field, judged by a view that they do not see.

use gradreel::optim::Params;
use gradreel::{DType, Error, ErrorKind, Result, Tape};
use serde::{Deserialize, Serialize};

use super::{AblationSettings, Cell, CellResult};
use crate::field::bounding_sphere;
use crate::field::temporal::{ClipRays, TemporalField, TemporalFit, TemporalFitSettings, TemporalSettings};
use crate::render::ViewWeights;
use crate::report::interrupt;
use crate::report::progress::Progress;
use crate::video::Clip;

/// How the temporal field is fitted and judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EncodingSettings {
    /// Frames at most, from the first on.
    pub frames: usize,
    /// Images are shrunk to at most so many pixels a side.
    pub side: usize,
    /// Sizes of the field.
    pub field: TemporalSettings,
    /// Effort.
    pub fit: TemporalFitSettings,
}

impl Default for EncodingSettings {
    fn default() -> Self {
        Self {
            frames: 6,
            side: 80,
            field: TemporalSettings { width: 32, channels: 6, position_levels: 4, time_levels: 4, ..Default::default() },
            fit: TemporalFitSettings {
                iterations: 400,
                rays: 1024,
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
/// Pixels that are compared have at least this coverage, filmed or rendered.
const COVERED: f64 = 0.02;
/// The object touches the ground when it is this near \[m\].
const REACH: f64 = 0.03;
/// Nodes on which the field is looked at for its motion.
const NODES: usize = 30_000;

impl AblationSettings {
    /// Fits the field to all views but one, and renders that one.
    pub(super) fn encode(&self, cell: Cell, clip: &Clip, progress: &Progress) -> Result<CellResult> {
        let EncodingSettings { frames, side, field, fit } = &self.encoding;
        if clip.cameras.len() < 3 {
            return Err(Error::new(ErrorKind::Input, "a view is to be held out: too few are left")
                .at(clip.root.display())
                .found(format!("{} cameras", clip.cameras.len()))
                .wanted("at least three"));
        }
        let largest = clip.cameras.iter().map(|camera| camera.width.max(camera.height)).max().unwrap_or(1);
        let clip = &clip.scaled(largest.div_ceil(*side).max(1));
        // the view that is farthest in the list from the real one
        let held = (self.primary_of(clip) + clip.cameras.len() / 2) % clip.cameras.len();
        let others: Vec<usize> = (0..clip.cameras.len()).filter(|view| *view != held).collect();
        let (filmed, unseen) = (part(clip, &others, *frames), part(clip, &[held], *frames));
        let (low, high) = surroundings(clip, filmed.frame_count())?;
        let centre = [0, 1, 2].map(|axis| (low[axis] + high[axis]) / 2.0);
        let alike = ViewWeights { alpha: 0.0, ..ViewWeights::default() };
        let rays_of = |clip| ClipRays::new(clip, &alike, centre, 0, &[], OBJECT_SHARE);
        let (rays, unseen) = (rays_of(&filmed), rays_of(&unseen));
        let sizes = TemporalSettings { time: cell != Cell::Still, merged: cell != Cell::Bending, ..field.clone() };
        let mut fitted = TemporalFit::new(low, high, &sizes, fit, DType::F32)?.within_silhouettes(&rays)?;
        let bar = progress.stage(cell.label(), fit.iterations as u64);
        fitted.run(&rays, |_, state| {
            bar.set(state.iteration as u64, &format!("{:.1} dB, {} nodes", state.psnr, state.nodes));
            interrupt::check()
        })?;
        let psnr = psnr(&fitted.field, &fitted.params, &unseen, filmed.frame_count())?;
        let mut result = CellResult::default();
        result.quality.insert("psnr_held_out_db".into(), psnr);
        let world = &self.config.world;
        let motion = fitted.field.motion(&fitted.params, &rays.times, &filmed.times, NODES);
        let velocity = motion.and_then(|motion| {
            let flight = motion.first_contact(world.ground, REACH).unwrap_or(filmed.frame_count());
            motion.ballistic(world.gravity, flight.max(2))
        });
        // a field that is nowhere opaque says nothing of the motion
        if let Ok((_, velocity)) = velocity {
            let named = ["velocity_x", "velocity_y", "velocity_z"].into_iter().zip(velocity);
            result.estimates = named.map(|(name, value)| (name.to_owned(), value)).collect();
        }
        bar.finish(&format!("{psnr:.1} dB in a view that was held out"));
        Ok(result)
    }
}

/// Some views and the first frames of a clip.
fn part(clip: &Clip, views: &[usize], frames: usize) -> Clip {
    let frames = frames.clamp(1, clip.frame_count());
    Clip {
        name: clip.name.clone(),
        root: clip.root.clone(),
        cameras: views.iter().map(|&view| clip.cameras[view].clone()).collect(),
        times: clip.times[..frames].to_vec(),
        frame_numbers: clip.frame_numbers[..frames].to_vec(),
        frames: views.iter().map(|&view| clip.frames[view][..frames].to_vec()).collect(),
        foreground: views.iter().map(|&view| clip.foreground[view]).collect(),
        imagined: vec![false; views.len()],
        assumptions: clip.assumptions.clone(),
    }
}

/// A box \[m\] that holds the object in the first frames.
fn surroundings(clip: &Clip, frames: usize) -> Result<([f64; 3], [f64; 3])> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for frame in 0..frames {
        let ball = bounding_sphere(clip, frame)?;
        for axis in 0..3 {
            low[axis] = low[axis].min(ball.centre[axis] - ball.radius);
            high[axis] = high[axis].max(ball.centre[axis] + ball.radius);
        }
    }
    Ok((low, high))
}

/// The peak signal-to-noise ratio \[dB\] of the first view's pictures, where the object is or seems to be.
fn psnr(field: &TemporalField, params: &Params, rays: &ClipRays<'_>, frames: usize) -> Result<f64> {
    let (mut squares, mut count) = (0.0, 0.0);
    for frame in 0..frames {
        let batch = rays.picture(0, frame, DType::F32)?;
        let tape = Tape::new();
        let seen = field.render(&params.bind(&tape), &batch.rays, &batch.moment_of, &rays.times)?;
        let (found, left) = (seen.pixels.rgb.value()?.to_vec()?, seen.pixels.left.value()?.to_vec()?);
        let (wanted, weight) = (batch.targets.colours.to_vec()?, batch.targets.weight.to_vec()?);
        let covered = rays.coverage(0, frame);
        for i in 0..left.len() {
            if weight[i] > 0.0 && covered[i].max(1.0 - left[i]) >= COVERED {
                squares += (0..3).map(|c| (found[3 * i + c] - wanted[3 * i + c]).powi(2)).sum::<f64>();
                count += 3.0;
            }
        }
    }
    Ok(-10.0 * (squares / f64::max(count, 1.0)).max(1e-12).log10())
}
