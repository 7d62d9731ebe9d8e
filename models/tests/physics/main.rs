//! The material point method against independent vectors, closed forms, conservation laws and finite differences.

mod conservation;
mod decomposition;
mod damping;
mod derivatives;
mod failures;
#[path = "../../../tests/vectors/find.rs"]
mod find;
mod flip;
mod gpu;
mod gradients;
mod laws;
mod materials;
mod mixtures;
mod obstacles;
mod own_laws;
mod plain_scene;
mod repeatability;
mod scene;
mod scene_tape;
mod slope;
mod vectors;
