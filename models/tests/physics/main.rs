//! x
mod scene;
mod vectors;
