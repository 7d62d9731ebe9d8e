//! The temporal field: a voxel field that moves, in one piece instead of one field per frame.
//!
//! A network of three layers bends the coordinates of every frame into those of the first; features interpolated there at
//! several distances are merged with the encoded (unbent) coordinates and a neural embedding of the time, and a last layer
//! reads density and, with the viewing direction, colour from them. J. Fang and others, "Fast Dynamic Radiance Fields with
//! Time-Aware Neural Voxels", SIGGRAPH Asia 2022; [`TemporalSettings`] says where the default differs.
//!
//! [`TemporalField`] renders, [`TemporalFit`] fits it to a clip, [`FieldMotion`] is what it says of the motion: where the
//! object is in each frame, when it first touches the ground, and how fast it was before. [`Agreement`] says which pictures
//! contradict it. [`FirstFrames`] is a small fit of what a clip shows before contact.

mod batch;
mod consistency;
mod distances;
mod first_frames;
mod fit;
mod losses;
mod motion;
mod network;
mod render;
mod settings;
mod silhouettes;

pub use batch::{ClipRays, RayBatch};
pub use consistency::Agreement;
pub use first_frames::{FirstFrames, FirstFramesClip, Flight};
pub use fit::{TemporalFit, TemporalFitSettings, TemporalProgress};
pub use losses::{RayTargets, TemporalLoss, TemporalWeights};
pub use motion::FieldMotion;
pub use network::{Moments, TemporalNet, TemporalSample};
pub use render::{TemporalField, TemporalPixels};
pub use settings::{Canonical, TemporalSettings};
