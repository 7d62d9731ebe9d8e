//! The forward model: from unknowns to pixels, with its derivatives in both modes.

pub(super) mod contact;
pub(super) mod depth_shear;
pub(super) mod fall;
pub(super) mod flight;
pub(super) mod free_fall;
pub(super) mod ground;
pub(super) mod ground_contact;
pub(super) mod linearise;
pub(super) mod loss;
pub(super) mod penalty;
pub(super) mod pitch;
pub(super) mod pixels;
pub(super) mod problem;
pub(super) mod shutter;
pub(super) mod spin;
pub(super) mod substeps;
pub(super) mod unknowns;
pub(super) mod with_voxels;
