//! Field: density and colour voxels of the first frame.
//!
//! [`hull`] carves the visual hull from the silhouettes; [`Field`] holds raw density and colour at the hull's voxels, and
//! `fit` makes the rendered voxels agree with the images. A voxel is a particle-to-be: the voxel spacing is the particle
//! spacing, half a cell of the simulation.

mod fit;
mod hull;
mod voxels;

pub use fit::{FitSettings, FitState, Pose, fit};
pub use hull::{Hull, Sphere, bounding_sphere, hull};
pub use voxels::Field;
