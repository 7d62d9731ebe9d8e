//! The forward model and the searches, on scenes made of a known motion.

mod derivatives;
mod free_fall;
mod gradient;
mod likelihood;
mod materials;
mod own_laws;
mod recovery;
mod scene;
mod shutter;
mod spin;
mod switches;
mod tracks;
