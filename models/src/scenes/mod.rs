//! Scenes: files that describe a simulation, and running them without a video.
//!
//! A [`SceneFile`] is read from TOML; [`fill`](fill()) turns each shape, [`Mesh`] or particle file into particles;
//! [`Setup`] validates the scene and plans the substeps; a [`Runner`] steps frame by frame; `View` renders
//! pictures and `Film` a multi-view clip.

mod file;
mod fill;
mod film;
mod mesh;
mod paint;
mod picture;
mod run;
mod setup;
mod surface;
mod totals;

pub use file::{Barrier, Camera, Grid, Ground, Object, Obstacle, Precision, SceneFile, Shape, Substance, Surroundings};
pub use file::{Time, Touch};
pub use fill::{Body, body, fill, positions_of};
pub(crate) use film::list;
pub(crate) use film::{Film, FilmSettings};
pub use mesh::Mesh;
pub(crate) use paint::Paint;
pub(crate) use picture::View;
pub(crate) use run::Snapshot;
pub use run::{Frame, Runner};
pub use setup::Setup;
pub(crate) use surface::{Hit, Surface};
pub(crate) use totals::Totals;
