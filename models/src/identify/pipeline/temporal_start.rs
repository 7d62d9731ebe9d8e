//! Where a reconstruction starts, from the temporal field.

use std::time::Instant;

use gradreel::{ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::field::temporal::{FirstFrames, Flight};
use crate::identify::Stage;
use crate::identify::config::outside_range;
use crate::identify::pipeline::context::Context;
use crate::identify::run::Run;
use crate::runtime::interrupt;

/// Whether the temporal field is fitted before the shape is, and what of it is used.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemporalConfig {
    /// Whether the search of the velocity starts from what the temporal field says. Without it, which is quicker, it starts from
    /// how the middles of the silhouettes move.
    pub enabled: bool,
    /// The fit.
    pub first: FirstFrames,
}

impl TemporalConfig {
    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        let FirstFrames { frames, side, field, fit } = &self.first;
        let rules = [
            (*frames >= 2, "frames", "at least 2"),
            (*side >= 8, "side", "at least 8 pixels"),
            ((1..=4096).contains(&field.width), "field.width", "1 to 4096"),
            ((1..=256).contains(&field.channels), "field.channels", "1 to 256"),
            (field.step > 0.0 && field.step <= 4.0, "field.step", "above 0, at most 4"),
            (field.opacity > 0.0 && field.opacity < 1.0, "field.opacity", "between 0 and 1"),
            (fit.rays >= 1, "fit.rays", "at least 1"),
            ((64..=1 << 26).contains(&fit.nodes), "fit.nodes", "64 to 67108864"),
            ((8..=1 << 24).contains(&fit.mask_nodes), "fit.mask_nodes", "8 to 16777216"),
            (fit.refinements <= 10, "fit.refinements", "at most 10"),
            (fit.decay > 0.0 && fit.decay <= 1.0, "fit.decay", "above 0, at most 1"),
        ];
        let Some((_, name, wanted)) = rules.into_iter().find(|(holds, ..)| !holds) else { return Ok(()) };
        let name = format!("temporal.first.{name}");
        Err(outside_range(&name, wanted))
    }
}

impl Context<'_> {
    /// The velocity that the temporal field of the first frames shows, if it is to be used and shows one.
    pub(in crate::identify) fn flight_of_field(&self, run: &mut Run) -> Result<Option<[f64; 3]>> {
        if !run.config.temporal.enabled {
            return Ok(None);
        }
        if !run.has_finished(Stage::TemporalField) {
            let since = Instant::now();
            let settings = run.config.temporal.first.clone();
            let bar = self.progress.stage(&Stage::TemporalField.to_string(), settings.fit.iterations as u64);
            let first = settings.of(self.clip)?;
            let rays = first.rays(&run.config.loss.views);
            let fit = settings.fit(&first, &rays, &settings.field, |state| {
                bar.set(state.iteration as u64, &format!("{:.1} dB, {} nodes", state.psnr, state.nodes));
                interrupt::check()
            })?;
            let world = &run.config.world;
            run.state.flight = match first.flight(&fit, &rays, world.gravity, world.ground) {
                Err(error) if error.kind() == ErrorKind::Input => {
                    run.note(format!("the temporal field shows no flight: {error}"));
                    None
                }
                flight => Some(flight?),
            };
            if let Some(Flight { velocity: [x, y, z], contact }) = run.state.flight {
                let touch = contact.map_or("none of its frames".to_owned(), |frame| format!("frame {frame}"));
                run.note(format!(
                    "the temporal field shows ({x:.3}, {y:.3}, {z:.3}) m/s, and the first contact in {touch}"
                ));
                bar.finish(&format!("v ({x:.3}, {y:.3}, {z:.3}) m/s"));
            }
            run.finish(Stage::TemporalField, since)?;
        }
        Ok(run.state.flight.map(|flight| flight.velocity))
    }
}
