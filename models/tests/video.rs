//! Clips: cameras, sources of the foreground, matting, and folders that are broken on purpose.

#[path = "video/builder.rs"]
mod builder;
#[path = "video/errors.rs"]
mod errors;
#[path = "video/foregrounds.rs"]
mod foregrounds;
#[path = "video/geometry.rs"]
mod geometry;
#[path = "video/imagined.rs"]
mod imagined;
#[path = "video/layouts.rs"]
mod layouts;
#[path = "video/lists.rs"]
mod lists;
#[path = "video/matting.rs"]
mod matting;
#[path = "video/networks.rs"]
mod networks;
#[path = "video/onnx_file.rs"]
mod onnx_file;
#[path = "video/pac_nerf.rs"]
mod pac_nerf;
#[path = "video/readiness.rs"]
mod readiness;
#[path = "video/refusals.rs"]
mod refusals;
#[path = "video/rig.rs"]
mod rig;
