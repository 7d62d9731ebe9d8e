//! Front and back depth of a solid from one masked picture: a small network, its training pictures, and its training.
//!
//! A silhouette says how wide a body is, not how deep, nor to which side it tilts. What shading and texture say of it is learnt
//! from pictures of real and procedural solids, drawn afresh for every step: a z-buffer with two layers gives colours
//! and depths. The network predicts in the camera's frame, in diameters `D = 2 √(A/π)` of the silhouette's area `A`.
//!
//! ```text
//! shapes, made ─► camera ─► raster ─► picture ─► features ─► network ─► loss ─► training
//!                           light ──────┘
//! ```

mod agreement;
mod batch;
mod camera;
mod comparison;
mod features;
mod light;
mod loss;
mod made;
mod measure;
mod network;
mod picture;
mod pose;
mod predict;
mod raster;
mod sample;
mod shapes;
mod solid;
#[cfg(test)]
mod testing;
mod training;
mod window;

pub(crate) use agreement::{Agreement, agreement, preview, two_views};
pub(crate) use batch::Batch;
pub use camera::Attitude;
pub(crate) use comparison::{Comparison, Estimate, Figures};
pub(crate) use made::made_solids;
pub use network::DepthSizes;
pub use predict::{DepthNetwork, LayeredDepth};
pub(crate) use sample::{Sample, training_sample};
pub use shapes::{Split, read_shapes};
pub use solid::Solid;
pub(crate) use training::{Plan, Training};
pub use window::{MaskedPicture, Window};
