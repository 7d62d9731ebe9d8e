//! Training objects: procedural shapes with patterns, rendered by the model's cameras. The built-in model is
//! trained on them. Textured meshes from a folder can replace them (`MeshFolder`).
//!
//! A body consists of a few implicit solids (superquadrics, boxes, tori, cylinders, letters, blobs), joined with
//! fillets, carved, mirrored, twisted, tapered, bent. It is determined by a key.

mod body;
mod dice;
mod field;
mod folder;
mod lamp;
mod made;
mod mesh;
mod placement;
mod sample;
mod solid;
mod texture;

use std::sync::Arc;

use gradreel::Key;
use rayon::prelude::*;

pub(crate) use body::Body;
pub(crate) use dice::Dice;
pub(crate) use folder::{FolderSettings, MeshFile, MeshFolder};
pub(crate) use made::Made;
pub use mesh::TexturedMesh;
pub(crate) use mesh::{Bvh, crossed};
pub(crate) use placement::Placement;
pub use sample::{Sample, SampleSettings};

use self::lamp::Lamp;
use self::mesh::Turned;
use crate::vector::{dot, minus};

/// An object whose box is centred at the origin and has longest side 1.
pub struct Object {
    form: Form,
    lamp: Lamp,
}

enum Form {
    Made(Box<Made>),
    Mesh(Turned),
}

/// Intersection of a ray with an object.
struct Met {
    /// Outward unit normal.
    normal: [f64; 3],
    /// Colour under a lamp directly above the surface.
    colour: [f64; 3],
}

/// A rendered view: a square image on white.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Pixels along a side.
    pub size: usize,
    /// Red, green and blue planes, `3 · size²` values in −1..1, quantised to 8 bits.
    pub colours: Vec<f32>,
    /// Coverage of each pixel by the object.
    pub coverage: Vec<f32>,
}

impl Object {
    /// The procedural object of a key, with `nodes` grid nodes along its longest side (48 suit images of 64
    /// pixels).
    pub fn new(key: Key, nodes: usize) -> Self {
        let [shape, paint, light] = key.split();
        Self { form: Form::Made(Box::new(Made::new([shape, paint], nodes))), lamp: Lamp::draw(light) }
    }

    /// A mesh rotated about the vertical by `turn` radians, with illumination from a key.
    pub fn of_mesh(mesh: Arc<TexturedMesh>, turn: f64, light: Key) -> Self {
        Self { form: Form::Mesh(Turned::new(mesh, turn)), lamp: Lamp::draw(light) }
    }

    /// Half sides of its box.
    pub fn half(&self) -> [f64; 3] {
        match &self.form {
            Form::Made(made) => made.half(),
            Form::Mesh(mesh) => mesh.half(),
        }
    }

    /// Renders the placed object with a camera of the ring's kind at this pose (world to camera), with `rays²` rays
    /// per pixel.
    pub fn seen(&self, placement: &Placement, pose: &[[f64; 4]; 3], focal: f64, size: usize, rays: usize) -> View {
        let mut pixels = vec![[0.0f32; 4]; size * size];
        let centre: [f64; 3] =
            std::array::from_fn(|axis| -(0..3).map(|row| pose[row][axis] * pose[row][3]).sum::<f64>());
        let origin = minus(centre, placement.shift).map(|x| x / placement.scale);
        pixels.par_chunks_mut(size).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let mut sum = [0.0; 4];
                for part in 0..rays * rays {
                    let share = |at: usize, k: usize| (at as f64 + (k as f64 + 0.5) / rays as f64) / size as f64 - 0.5;
                    let ray = [share(column, part % rays) / focal, share(row, part / rays) / focal, 1.0];
                    let ray: [f64; 3] = std::array::from_fn(|axis| (0..3).map(|row| pose[row][axis] * ray[row]).sum());
                    let norm = dot(ray, ray).sqrt();
                    if let Some(colour) = self.colour(origin, ray.map(|x| x / norm)) {
                        (0..3).for_each(|c| sum[c] += colour[c]);
                        sum[3] += 1.0;
                    }
                }
                *pixel = sum.map(|s| (s / (rays * rays) as f64) as f32);
            }
        });
        let channel = |c: usize| {
            pixels.iter().map(move |pixel| {
                let byte = (255.0 * (pixel[c] + 1.0 - pixel[3])).round().clamp(0.0, 255.0);
                byte / 255.0 * 2.0 - 1.0
            })
        };
        let colours = (0..3).flat_map(channel).collect();
        View { size, colours, coverage: pixels.iter().map(|pixel| pixel[3]).collect() }
    }

    fn colour(&self, origin: [f64; 3], along: [f64; 3]) -> Option<[f64; 3]> {
        let met = match &self.form {
            Form::Made(made) => made.met(origin, along),
            Form::Mesh(mesh) => mesh.met(origin, along),
        }?;
        let light = self.lamp.brightness(met.normal);
        Some(met.colour.map(|c| c * light))
    }
}
