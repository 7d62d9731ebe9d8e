//! What all stages share, and what they ask of a run.

use gradreel::Result;

use crate::identify::model::fall::Fallen;
use crate::identify::run::Run;
use crate::identify::{Observed, Unknowns, WorldConfig};
use crate::physics::Law;
use crate::runtime::progress::Progress;
use crate::video::Clip;

/// What all stages share.
#[derive(Clone, Copy)]
pub(in crate::identify) struct Context<'a> {
    pub clip: &'a Clip,
    pub observed: &'a Observed,
    /// The first frame from all around, and its pixels.
    pub around: Option<(&'a Clip, &'a Observed)>,
    pub law: &'a Law,
    pub spacing: f64,
    pub progress: &'a Progress,
}

impl Context<'_> {
    /// Whether it is not known how the body lies along the line of sight. That the spin of a body depends on it is not differentiated,
    /// so that one that may spin is taken to lie as it was taken to.
    pub fn depth_is_open(&self, run: &Run) -> bool {
        self.observed.sight.is_some() && !run.config.estimate.spin
    }

    /// Whether the height of the ground is not known to a part of a grid cell: a single camera leaves it open how far away, and so how
    /// high, the object is, and hulls are larger than objects.
    pub fn unsure_ground(&self, run: &Run) -> bool {
        self.clip.cameras.len() == 1 || run.config.world.find_ground
    }

    /// Whether the clip is a film whose fall is known.
    pub fn is_film(&self) -> bool {
        self.observed.rows.is_some() && self.clip.flight.is_some()
    }

    /// What the fall of what a single camera saw says of its velocity.
    pub fn fall(&self, run: &Run) -> Result<Option<Fallen>> {
        self.clip
            .flight
            .as_ref()
            .map(|flight| Fallen::of(flight, self.distance_is_open(run), self.pitch_is_open(run)))
            .transpose()
    }

    /// Whether only the fall says how far away the body is, in a world that is known. Where the world's metres follow from the fall as
    /// well, nothing is seen to be nearer or further than it was taken to be.
    pub fn distance_is_open(&self, run: &Run) -> bool {
        self.depth_is_open(run) && self.clip.flight.is_some_and(|flight| !flight.scales_world)
    }

    /// Whether only the fall, and what follows it, says how far down the camera looks.
    pub fn pitch_is_open(&self, run: &Run) -> bool {
        self.depth_is_open(run) && self.clip.flight.is_some_and(|flight| flight.pitch.deviation > 0.0)
    }

    /// The standard deviation of all lengths, as a share, that the fall of what a single camera saw leaves: at a given pitch, if that is
    /// an unknown.
    pub fn length(&self, run: &Run) -> f64 {
        let Some(flight) = &self.clip.flight else { return 0.0 };
        let of_pitch = if self.pitch_is_open(run) { flight.pitch.with_distance / flight.pitch.deviation } else { 0.0 };
        (flight.deviation.powi(2) - of_pitch.powi(2)).max(0.0).sqrt()
    }

    /// The pressure `ρ v²` with which the body meets the ground \[Pa\].
    pub fn impact(&self, run: &Run, at: &Unknowns) -> f64 {
        let WorldConfig { density, gravity, .. } = run.config.world;
        let falls = run.state.contact.unwrap_or(0) as f64 * self.observed.frame_dt;
        density * at.velocity.iter().zip(gravity).map(|(v, g)| (v + g * falls).powi(2)).sum::<f64>()
    }
}

/// The least loss that no motion explains: pictures have noise.
pub(in crate::identify) const LEAST: f64 = 1e-3;
