//! Field: density and colour voxels of the first frame.
//!
//! `hull` carves the visual hull from the silhouettes; `Field` holds raw density and colour at the hull's voxels,
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
#[cfg(test)]
mod tests;
mod variation;
mod voxels;

pub use dense::DenseGrid;
pub(crate) use dense::channel;
pub(crate) use dense::opacity_shift;
pub(crate) use faces::Faces;
pub use fit::FitSettings;
pub(crate) use fit::fit;
pub(crate) use hull::{Hull, Sphere, bounding_sphere, hull};
pub(crate) use hull::{fill_gaps, meeting_point, middle, place};
pub(crate) use inflate::Inflated;
pub use occupancy::Occupancy;
pub(crate) use occupancy::opacity;
pub(crate) use radiance::ColourNet;
pub use radiance::{RadianceField, RadianceSizes};
pub use static_fit::{StaticFit, StaticFitSettings};
pub(crate) use static_step::entropy;
pub use static_step::{StaticSettings, static_step};
pub(crate) use variation::{Reach, with_variation};
pub(crate) use voxels::{Field, mean_colour};
