//! Clips: cameras, sources of the foreground, matting, and folders that are broken on purpose.

#[path = "video/builder.rs"]
mod builder;
#[path = "video/errors.rs"]
mod errors;
#[path = "video/foregrounds.rs"]
mod foregrounds;
#[path = "video/geometry.rs"]
mod geometry;
#[path = "video/matting.rs"]
mod matting;
