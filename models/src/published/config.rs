//! Settings of the chain: table `[published]` of a run's `config.toml`.

use std::path::PathBuf;

use gradreel::Result;
use serde::{Deserialize, Serialize};

use crate::field::temporal::{TemporalFitSettings, TemporalSettings};
use crate::identify::outside_range;

/// Settings of the published chain; a run that has them is one of it.
///
/// The scale of the view-adaptive loss is `loss.views.alpha`, ranges of parameters are `loss.ranges`.
///
/// ```
/// use gradreel_models::identify::Config;
///
/// assert!(Config::default().published.is_none());
/// let config = Config::parse("[published]\nsteps = 8")?;
/// assert_eq!(config.published.unwrap().steps, Some(8));
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PublishedConfig {
    /// Weights of the multi-view model; the built-in model if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<PathBuf>,
    /// Boxes of the object as a detector leaves them; those of the masks if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boxes: Option<PathBuf>,
    /// Whether the spatial-aware module places the object where the weights have one; otherwise views of a centred object are moved
    /// to where the film has it.
    pub spatial_aware: bool,
    /// Sampling steps; as the model is used to if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
    /// Strength of the guidance by the picture, 1 being none; as the model is used to if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guidance: Option<f64>,
    /// The noise of all frames: another one guesses another back.
    pub seed: u64,
    /// Updates of the temporal field.
    pub field: usize,
    /// Rays of an update.
    pub rays: usize,
    /// Nodes of its finest grid, around the object.
    pub nodes: usize,
    /// Evaluations at most for the velocity, from what the field's motion says; 0 leaves it at that.
    pub velocity: usize,
    /// Magnitudes of the material that are tried before the search, evenly over its plausible range; the best is where it starts.
    pub starts: usize,
    /// Evaluations at most of the search for the material.
    pub material: usize,
}

impl Default for PublishedConfig {
    fn default() -> Self {
        Self {
            weights: None,
            boxes: None,
            spatial_aware: true,
            steps: None,
            guidance: None,
            seed: 0,
            field: 2500,
            rays: 1024,
            nodes: 60_000,
            velocity: 12,
            starts: 5,
            material: 30,
        }
    }
}

impl PublishedConfig {
    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        let rules = [
            (self.steps.is_none_or(|n| (1..=1000).contains(&n)), "steps", "1 to 1000"),
            (self.guidance.is_none_or(f64::is_finite), "guidance", "a number"),
            (i64::try_from(self.seed).is_ok(), "seed", "at most 9223372036854775807"),
            ((1..=1_000_000).contains(&self.field), "field", "1 to 1000000"),
            ((1..=1 << 20).contains(&self.rays), "rays", "1 to 1048576"),
            ((512..=1 << 26).contains(&self.nodes), "nodes", "512 to 67108864"),
            (self.velocity <= 10_000, "velocity", "at most 10000"),
            (self.starts <= 100, "starts", "at most 100"),
            ((1..=10_000).contains(&self.material), "material", "1 to 10000"),
        ];
        match rules.into_iter().find(|(holds, ..)| !holds) {
            None => Ok(()),
            Some((_, name, wanted)) => Err(outside_range(&format!("published.{name}"), wanted)),
        }
    }

    /// Sizes of the temporal field.
    pub(super) fn sizes(&self) -> TemporalSettings {
        TemporalSettings { width: 32, channels: 6, position_levels: 4, time_levels: 4, ..TemporalSettings::default() }
    }

    /// The temporal field's fit.
    pub(super) fn fit(&self) -> TemporalFitSettings {
        TemporalFitSettings {
            iterations: self.field,
            rays: self.rays,
            rays_at_once: self.rays,
            nodes: self.nodes,
            refinements: 2,
            grid_rate: 0.2,
            network_rate: 2e-3,
            bending_rate: 2e-3,
            mask_nodes: 12_000,
            mask_every: 50,
            ..TemporalFitSettings::default()
        }
    }
}
