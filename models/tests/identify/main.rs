//! The forward model and the estimates, on scenes made of a known motion.

mod gradient;
mod recovery;
mod scene;
mod tracks;
