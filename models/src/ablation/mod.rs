//! Ablations: the contribution of parts of the method when views are imagined, measured on clips with known truth.
//!
//! A [`Perturbation`] derives imagined views from real ones: misregistered by a few pixels and colour-shifted,
//! reproducibly for a given seed. Each [`Cell`] is one treatment of a clip: reconstructions from one view or all, with
//! and without the view-adaptive loss, and temporal fits with and without the encoding of time. [`CellResult`] is the
//! outcome, [`markdown`] the table of all, with errors where a [`Truth`] is stored with the clip.

mod cell;
mod chain;
mod encoding;
mod figure5;
mod identification;
mod perturbation;
mod published;
mod summary;
mod table;
mod truth;

pub use cell::{AblationSettings, Cell, CellResult};
pub use figure5::{Placed, Ways, measure};
pub use perturbation::Perturbation;
pub use published::Published;
pub use table::{ClipResults, markdown};
pub use truth::Truth;
