//! From a video to shape, motion and material: the stages of the method, in the order in which data flows.

pub mod physics;
pub mod report;
pub mod video;
