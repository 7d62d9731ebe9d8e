//! Report: what a person opens after a run.

pub mod base64;
mod markup;
pub mod page;
pub mod plot;
