//! Identify: geometry, velocity and material, each by gradients from the pixels.
//!
//! [`Problem`] is the forward model on one tape (unknowns → rollout → splat → march → loss); [`estimate`] moves unknowns
//! against its gradient; [`reconstruct`](reconstruct()) runs the stages in order and keeps a run folder up to date:
//!
//! 1. **geometry**: visual hull, then voxels fitted to the first frame, then particles;
//! 2. **velocity**: frames before contact, where the motion does not depend on the material;
//! 3. **coarse**: the material on a grid of twice the spacing, first around contact, then on all frames;
//! 4. **fine**: material and velocity together, on the full grid and all frames.
//!
//! [`dynamic_step`] is the published forward model on the particles of a radiance field; [`RangePenalty`] keeps parameters
//! plausible. Where the particles themselves were tracked, [`Tracks`] finds velocity and material without pictures.

mod config;
mod contact;
mod estimate;
mod penalty;
mod pixels;
mod problem;
mod reconstruct;
mod run;
mod tracks;
mod unknowns;

pub use config::{ClipConfig, Config, EstimateConfig, GeometryConfig, MaterialConfig, WorldConfig};
pub use contact::first_contact;
pub use estimate::{Evaluation, estimate};
pub use penalty::RangePenalty;
pub use pixels::{FramePixels, MotionLoss, MotionSettings, body_of, dynamic_step, is_stiffness, motion_loss};
pub use problem::{Observed, Problem};
pub use reconstruct::{Reconstruction, reconstruct};
pub use run::{ClipIdentity, HistoryRow, Run, State};
pub use tracks::{TANGENT_COST, Tracks, TracksFit};
pub use unknowns::{Bound, Free, Unknowns};
