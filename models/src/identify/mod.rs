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

mod config;
mod hypotheses;
mod model;
mod pipeline;
mod resimulate;
mod run;
mod solve;
mod tracks;
mod uncertainty;

#[cfg(test)]
mod tests;

pub use crate::physics::materials::FAMILIES;
pub use config::flowing::FlowingConfig;
pub use config::own_law::OwnLaw;
pub use config::{ClipConfig, Config, EstimateConfig, GeometryConfig, ImagineConfig, MaterialConfig, WorldConfig};
pub(crate) use config::{law_of, no_such_parameter, outside_range};
pub use model::contact::first_contact;
pub use model::depth_shear::Sight;
pub(crate) use model::flight::velocity_of_silhouettes;
pub use model::ground_contact::GroundContact;
pub use model::linearise::Linearised;
pub use model::loss::LossConfig;
pub use model::penalty::RangePenalty;
pub use model::pixels::{FramePixels, MotionLoss, MotionSettings, body_of, dynamic_step};
pub use model::problem::{Observed, Problem};
pub use model::substeps::Substeps;
pub(crate) use model::unknowns::coordinate;
pub use model::unknowns::{Bound, FRICTION, Free, Ground, SPIN, Unknowns, VELOCITY};
pub(crate) use pipeline::reconstruct::{DTYPE, describe, half_of_imagined, particle_spacing, shrink_factor};
pub use pipeline::reconstruct::{Reconstruction, reconstruct};
pub use pipeline::stage::Stage;
pub use pipeline::temporal_start::TemporalConfig;
pub(crate) use pipeline::{Survey, known};
pub use resimulate::Changes;
pub(crate) use run::field_file::Reached;
pub use run::{HistoryRow, Run, Standing, State};
pub use solve::lbfgs::{Evaluation, estimate};
pub use tracks::{TANGENT_COST, Tracks, TracksFit};
pub(crate) use uncertainty::error_budget::{Discrepancy, ErrorBudget, OneCamera, Outliers};
pub use uncertainty::interval::Interval;
pub(crate) use uncertainty::normal;
