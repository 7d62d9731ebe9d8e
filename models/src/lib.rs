//! From a video to shape, motion and material: the stages of the method, in the order in which data flows.
//!
//! ```text
//! video → field → particles → physics → render → identify → report
//! ```

pub mod video;
pub mod field;
pub mod particles;
pub mod physics;
pub mod render;
pub mod identify;
pub mod report;
