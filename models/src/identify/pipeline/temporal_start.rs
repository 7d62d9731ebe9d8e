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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemporalConfig {
    /// Whether the search of the velocity starts from what the temporal field says. Without it, which is quicker, it starts from
    /// how the middles of the silhouettes move.
    pub enabled: bool,
    /// Updates of the field. More sharpen it, and take as much longer.
    pub iterations: usize,
    /// The fit otherwise.
    #[serde(skip)]
    pub(crate) first: FirstFrames,
}

impl Default for TemporalConfig {
    fn default() -> Self {
        let first = FirstFrames::default();
        Self { enabled: false, iterations: first.fit.iterations, first }
    }
}

impl TemporalConfig {
    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        match (1..=1_000_000).contains(&self.iterations) {
            true => Ok(()),
            false => Err(outside_range("temporal.iterations", "1 to 1000000")),
        }
    }

    /// The fit with so many updates.
    pub(crate) fn first(&self) -> FirstFrames {
        let mut first = self.first.clone();
        first.fit.iterations = self.iterations;
        first
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
            let settings = run.config.temporal.first();
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
