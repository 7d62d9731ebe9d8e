//! The forward model and the estimates, on scenes made of a known motion.

mod free_fall;
mod gauss_newton;
mod gradient;
mod interval;
mod own_laws;
mod recovery;
mod scene;
mod spin;
mod switches;
mod tracks;
