//! Field: density and colour voxels of the first frame.
//!
//! [`hull`] carves the visual hull from the silhouettes; [`Field`] holds raw density and colour at the hull's voxels,
//! and `fit` fits the rendered voxels to the images. Each voxel becomes a particle: the voxel spacing is the particle
//! spacing, half a cell of the simulation.
//!
//! The published voxel radiance field is also here: [`RadianceField`] holds raw density and features on a [`DenseGrid`]
//! with a colour network, [`Occupancy`] masks the nodes that may be opaque, [`static_step`](static_step()) is one
//! evaluation and [`StaticFit`] the complete fit to the first frame. [`temporal`] is the moving field: one network maps
//! the coordinates of every frame to those of the first.

mod dense;
mod faces;
mod fit;
mod hull;
mod inflate;
mod occupancy;
mod radiance;
mod solid;
mod static_fit;
mod static_step;
pub mod temporal;
mod variation;
mod voxels;

pub(crate) use dense::channel;
pub use dense::{DenseGrid, opacity_shift};
pub use faces::Faces;
pub use fit::{FitSettings, FitState, fit};
pub use hull::{Hull, Sphere, bounding_sphere, hull};
pub(crate) use hull::{fill_gaps, meeting_point, middle, place};
pub(crate) use inflate::Inflated;
pub use inflate::half_thickness;
pub use occupancy::Occupancy;
pub(crate) use occupancy::opacity;
pub use radiance::{ColourNet, RadianceField, RadianceSizes};
pub use static_fit::{StaticFit, StaticFitSettings, StaticProgress};
pub use static_step::{StaticSettings, StaticStep, entropy, static_step};
pub use variation::{Reach, variation_gradient, with_variation};
pub use voxels::Field;
