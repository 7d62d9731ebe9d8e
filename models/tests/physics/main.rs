//! The material point method against independent vectors, closed forms, conservation laws and finite differences.

mod conservation;
mod decomposition;
mod failures;
mod gradients;
mod laws;
mod materials;
mod mixtures;
mod repeatability;
mod scene;
mod scene_tape;
mod vectors;
