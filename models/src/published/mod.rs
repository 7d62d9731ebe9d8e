//! The method as published, from a film of one camera to a material, in one chain of stages.
//!
//! ```text
//! film ─► boxes ─► views of every frame ─► temporal field ─► particles ─► velocity ─► material
//!        (mask,    (diffusion, with the    (deformation,     (its first   (its       (gradients through
//!         file)     spatial-aware module)   all pictures)     frame)       motion)     simulation and renderer)
//! ```
//!
//! 1. `boxes`: where the object is in every picture; `path` lifts the boxes into space;
//! 2. `views`: sixteen views of every frame from the same noise, by cameras that stand still (`rig`); a module that knows
//!    boxes puts the object where the film has it, or else the views of a centred object are moved there (`placed`);
//! 3. `field`: one temporal field for all pictures of all frames, with the view-adaptive loss;
//! 4. `particles`: its first frame on the particles of the simulation, drawn as they will be drawn;
//! 5. `velocity`: the field's motion before contact, followed by gradients through the pictures of the flight;
//! 6. `material`: gradients through the simulation and the renderer, L-BFGS, penalties beyond plausible ranges.
//!
//! [`Stage`] names the stages in state, progress and report. [`Chain`] runs them in the folder of a
//! [`Run`](crate::identify::Run), from which it goes on bit for bit. The result is a
//! [`Reconstruction`](crate::identify::Reconstruction) with a point for an estimate; its intervals follow from the curvature of the
//! loss (`interval`).

mod box_file;
pub(crate) mod boxes;
mod chain;
mod config;
mod cost;
mod descent;
mod field;
mod interval;
mod material;
mod particles;
mod path;
pub(crate) mod pictures;
mod placed;
pub(crate) mod report;
mod rig;
mod stage;
mod state;
mod surrounded;
mod velocity;
mod views;
#[cfg(test)]
mod tests;

pub use chain::{Chain, Origin};
pub use config::PublishedConfig;
pub(crate) use path::Path;
pub(crate) use rig::Rig;
pub use stage::Stage;
pub(crate) use state::STATE;
pub use state::{Placing, State};
pub(crate) use views::ViewMaker;
