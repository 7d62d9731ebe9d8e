//! The temporal field: one moving voxel field in place of one field per frame.
//!
//! A network of three layers maps the coordinates of every frame to those of the first. Features interpolated there at
//! several distances are merged with the encoded original coordinates and a neural embedding of the time; a last layer
//! returns density and, with the viewing direction, colour. J. Fang and others, "Fast Dynamic Radiance Fields with
//! Time-Aware Neural Voxels", SIGGRAPH Asia 2022. [`TemporalSettings`] documents where the default differs.
//!
//! `TemporalField` renders, [`TemporalFit`] fits it to a clip, and `FieldMotion` is the motion derived from it:
//! position in each frame, first contact with the ground, and velocity before. `Agreement` finds images that
//! contradict the field. `FirstFrames` is a small fit to the frames before contact.

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

pub(crate) use batch::ClipRays;
pub use batch::RayBatch;
pub(crate) use first_frames::{FirstFrames, FirstFramesClip, Flight};
pub(crate) use fit::TemporalProgress;
pub use fit::{TemporalFit, TemporalFitSettings};
pub use losses::{RayTargets, TemporalWeights};
pub(crate) use render::TemporalField;
pub use settings::TemporalSettings;
