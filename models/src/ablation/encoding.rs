//! Temporal fits, evaluated on a held-out view.

use gradreel::optim::Params;
use gradreel::{DType, Error, ErrorKind, Result, Tape};

use super::{AblationSettings, Cell, CellResult};
use crate::field::temporal::{ClipRays, FirstFramesClip, TemporalField, TemporalSettings};
use crate::identify::VELOCITY;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::video::Clip;

/// Minimum coverage, filmed or rendered, of pixels that are compared.
const COVERED: f64 = 0.02;

impl AblationSettings {
    /// Fits the field to all views but one, and renders the held-out view.
    pub(super) fn encode(&self, cell: Cell, clip: &Clip, progress: &Progress) -> Result<CellResult> {
        if clip.cameras.len() < 3 {
            return Err(Error::new(ErrorKind::Input, "a view is to be held out: too few are left")
                .at(clip.root.display())
                .found(format!("{} cameras", clip.cameras.len()))
                .wanted("at least three"));
        }
        let settings = &self.config.temporal.first();
        let FirstFramesClip { clip, corners } = settings.of(clip)?;
        // the view halfway around the list from the real one
        let held = (self.primary_of(&clip) + clip.cameras.len() / 2) % clip.cameras.len();
        let others: Vec<usize> = (0..clip.cameras.len()).filter(|view| *view != held).collect();
        let [filmed, unseen] =
            [&others[..], &[held][..]].map(|views| FirstFramesClip { clip: of_views(&clip, views), corners });
        let alike = &self.config.loss.views;
        let (rays, unseen) = (filmed.rays(alike), unseen.rays(alike));
        let sizes =
            TemporalSettings { time: cell != Cell::Still, merged: cell != Cell::Bending, ..settings.field.clone() };
        let bar = progress.stage(cell.label(), settings.fit.iterations as u64);
        let fitted = settings.fit(&filmed, &rays, &sizes, |state| {
            bar.set(state.iteration as u64, &format!("{:.1} dB, {} nodes", state.psnr, state.nodes));
            interrupt::check()
        })?;
        let psnr = psnr(&fitted.field, &fitted.params, &unseen, filmed.clip.frame_count())?;
        let mut result = CellResult::default();
        result.quality.insert("psnr_held_out_db".into(), psnr);
        let world = &self.config.world;
        // a field without opaque nodes has no motion
        if let Ok(flight) = filmed.flight(&fitted, &rays, world.gravity, world.ground) {
            let named = VELOCITY.into_iter().zip(flight.velocity);
            result.estimates = named.map(|(name, value)| (name.to_owned(), value)).collect();
        }
        bar.finish(&format!("{psnr:.1} dB in a view that was held out"));
        Ok(result)
    }
}

/// A selection of views of a clip, all of them marked real.
fn of_views(clip: &Clip, views: &[usize]) -> Clip {
    Clip {
        cameras: views.iter().map(|&view| clip.cameras[view].clone()).collect(),
        frames: views.iter().map(|&view| clip.frames[view].clone()).collect(),
        foreground: views.iter().map(|&view| clip.foreground[view]).collect(),
        imagined: vec![false; views.len()],
        ..clip.clone()
    }
}

/// Peak signal-to-noise ratio \[dB\] over the images of the first view, where filmed or rendered coverage is present.
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
