//! Identify: geometry, velocity and material, each by derivatives from the pixels.
//!
//! [`Problem`] is the forward model (unknowns → rollout → splat → march → loss), in reverse mode on one tape and in forward
//! mode as least squares ([`Problem::linearise`]); [`estimate`] and [`gauss_newton`](gauss_newton()) move unknowns with it;
//! [`reconstruct`](reconstruct()) runs the stages in order and keeps a run folder up to date:
//!
//! 1. **geometry**: visual hull, then voxels fitted to the first frame, then particles;
//! 2. **velocity**: frames before contact, where the motion does not depend on the material: as the middles of the silhouettes
//!    move, then by Gauss–Newton;
//! 3. **family**: if it was not said, which of them foretells the frames that it was not fitted to;
//! 4. **material**: a scan of what is plausible (and of how the body leans that a single camera saw), Gauss–Newton from the best of it, and on from the best of these, all on the frames
//!    around the contact where the body is elastic; then, in rounds, the voxels are fitted to the motion and the material to the
//!    new shape, of these frames first, then of all; of what a single camera saw fall the velocity is fitted again with
//!    the material, from the pixels after the contact;
//! 5. **otherwise**: what the material would be on a grid of twice the spacing and, where a single camera made the shape, of a
//!    thinner body;
//! 6. **most probable**: what is plausible, weighed with what the clip shows;
//! 7. **intervals**: how sure all that is.
//!
//! [`dynamic_step`] is the published forward model on the particles of a radiance field; [`RangePenalty`] keeps parameters
//! plausible, and [`LossConfig`] says what else counts where views are imagined. [`Changes`] makes a reconstructed object move under other
//! conditions. Where the particles themselves were tracked, [`Tracks`] finds velocity and material without pictures.

mod again;
mod bias;
mod config;
mod contact;
mod estimate;
mod fall;
mod family;
mod field_file;
mod finer_grid;
mod flight;
mod flowing;
mod free_fall;
mod gauss_newton;
mod ground;
mod hypotheses;
mod interval;
mod lean;
mod linearise;
mod loss;
mod oracle;
mod other_end;
mod own_law;
mod penalty;
mod pipeline;
mod pixels;
mod plausible;
mod problem;
mod profile;
mod recent;
mod reconstruct;
mod run;
mod second_look;
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

pub use again::Changes;
pub use config::{
    ClipConfig, Config, EstimateConfig, FAMILIES, GeometryConfig, ImagineConfig, MaterialConfig, Method, PoolConfig,
    WorldConfig,
};
pub(crate) use config::{law_of, no_such_parameter};
pub use contact::first_contact;
pub use estimate::{Evaluation, estimate};
pub use family::{Candidate, choose, compared};
pub(crate) use field_file::Reached;
pub(crate) use flight::velocity_of_silhouettes;
pub use flowing::FlowingConfig;
pub use gauss_newton::{Steps, apart, gauss_newton, scan};
pub use interval::{Interval, intervals};
pub use lean::Sight;
pub use linearise::{Linearised, Score};
pub use loss::LossConfig;
pub use oracle::{Answer, Listener};
pub use own_law::OwnLaw;
pub use penalty::RangePenalty;
pub(crate) use pipeline::{Survey, known};
pub use pixels::{FramePixels, MotionLoss, MotionSettings, body_of, dynamic_step};
pub use problem::{Observed, Problem};
pub(crate) use reconstruct::half_of_imagined;
pub use reconstruct::{Reconstruction, reconstruct};
pub use run::{HistoryRow, Run, State};
pub use temporal_start::TemporalConfig;
pub use tracks::{TANGENT_COST, Tracks, TracksFit};
pub(crate) use uncertainty::error_budget::{Discrepancy, ErrorBudget, Outliers};
pub(crate) use uncertainty::normal;
pub(crate) use unknowns::coordinate;
pub use unknowns::{Bound, Free, Ground, SPIN, Unknowns, VELOCITY};
