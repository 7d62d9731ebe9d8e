//! From a video to shape, motion and material: the stages of the method, in the order in which data flows.
//!
//! ```text
//! video → monocular → views → field → particles → physics → render → identify → report
//!                          scenes → physics → report
//! ablation: what the parts of it are worth
//! ```

mod constant;
mod fnv1a;
mod folder;
mod nearest;
mod text;
mod vector;
pub mod layers;
pub mod video;
pub mod views;
pub mod field;
pub mod monocular;
pub mod particles;
pub mod physics;
pub mod render;
pub mod identify;
pub mod scenes;
pub mod report;
pub mod ablation;
pub mod cli;
