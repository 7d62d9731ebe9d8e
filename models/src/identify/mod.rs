//! Identify: geometry, velocity and material, from the pixels.
//!
//! [`Problem`] is the forward model (unknowns → rollout → splat → march → loss), in reverse mode on one tape and in forward
//! mode as least squares ([`Problem::linearise`]). [`reconstruct`](reconstruct()) runs the stages in order and keeps a run
//! folder up to date:
//!
//! 1. **geometry**: visual hull, then voxels fitted to the first frame, then particles;
//! 2. **velocity**: frames before contact, where the motion does not depend on the material;
//! 3. **material**: a pool of hypotheses from the prior of one family or of five, searched by successive halving: a coarse body,
//!    the full body with few substeps, the full forward model (`pipeline`, `solve`, `hypotheses`);
//!    A film whose contacts are shorter than a frame shows nothing of it: there the free flights tell the restitution
//!    (`bounces`), and what follows is left out;
//! 4. **shape in motion**: voxels fitted to all frames, and the material to the new shape;
//! 5. **posterior**: the mixture of what the surviving hypotheses say, under one covariance (`uncertainty`).
//!
//! [`dynamic_step`] is the published forward model on the particles of a radiance field; [`estimate`] moves unknowns by
//! reverse mode; [`RangePenalty`] keeps parameters plausible, and [`LossConfig`] says what else counts where views are imagined.
//! [`Changes`] makes a reconstructed object move under other conditions. Where the particles themselves were tracked,
//! [`Tracks`] finds velocity and material without pictures.

mod again;
mod bounces;
mod config;
mod contact;
mod estimate;
mod fall;
mod field_file;
mod flight;
mod flowing;
mod free_fall;
mod ground;
mod ground_contact;
mod hypotheses;
mod interval;
mod lean;
mod pitch;
mod linearise;
mod loss;
mod own_law;
mod penalty;
mod pipeline;
mod pixels;
mod problem;
mod reconstruct;
mod run;
mod settings_file;
mod sharpness;
mod solve;
mod spin;
mod stages;
mod temporal_start;
mod tracks;
mod uncertainty;
mod unknowns;
mod with_voxels;

#[cfg(test)]
mod tests;

pub use crate::physics::materials::FAMILIES;
pub use again::Changes;
pub use config::{ClipConfig, Config, EstimateConfig, GeometryConfig, ImagineConfig, MaterialConfig, WorldConfig};
pub(crate) use config::{law_of, no_such_parameter, outside_range};
pub use contact::first_contact;
pub use estimate::{Evaluation, estimate};
pub(crate) use field_file::Reached;
pub(crate) use flight::velocity_of_silhouettes;
pub use flowing::FlowingConfig;
pub use ground_contact::GroundContact;
pub use interval::Interval;
pub use lean::Sight;
pub use linearise::Linearised;
pub use loss::LossConfig;
pub use own_law::OwnLaw;
pub use penalty::RangePenalty;
pub(crate) use pipeline::{Survey, known};
pub use pixels::{FramePixels, MotionLoss, MotionSettings, body_of, dynamic_step};
pub use problem::{Observed, Problem};
pub(crate) use reconstruct::{DTYPE, describe, half_of_imagined, particle_spacing, shrink_factor};
pub use reconstruct::{Reconstruction, reconstruct};
pub use run::{HistoryRow, Run, Standing, State};
pub use temporal_start::TemporalConfig;
pub use tracks::{TANGENT_COST, Tracks, TracksFit};
pub(crate) use uncertainty::error_budget::{Discrepancy, ErrorBudget, OneCamera, Outliers};
pub(crate) use uncertainty::normal;
pub(crate) use unknowns::coordinate;
pub use unknowns::{Bound, FRICTION, Free, Ground, SPIN, Unknowns, VELOCITY};
