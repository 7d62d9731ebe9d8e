//! Ablations: what the parts of the method are worth when views are imagined, measured on clips whose truth is known.
//!
//! A [`Perturbation`] makes imagined views of real ones: misregistered by a few pixels, colour-shifted, alike for the same seed.
//! Each [`Cell`] is one way to treat a clip: reconstructions from one view, from all, with and without the view-adaptive loss, and fits of the temporal
//! field with and without its encoding of time. [`CellResult`] is what came out, [`markdown`] the table of all, with errors where
//! a [`Truth`] lies beside the clip.

mod cell;
mod encoding;
mod identification;
mod perturbation;
mod published;
mod summary;
mod table;
mod truth;

pub use cell::{AblationSettings, Cell, CellResult};
pub use perturbation::Perturbation;
pub use published::Published;
pub use table::{ClipResults, markdown};
pub use truth::Truth;
