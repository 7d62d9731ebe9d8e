//! Objects that nobody has seen before: procedural shapes with patterns, filmed by the cameras of the model. They are what the
//! built-in model is trained on. Textured meshes from a folder can take their place ([`MeshFolder`]).
//!
//! A body is a few implicit solids (superquadrics, boxes, rings, cylinders, letters, blobs), joined with fillets, carved,
//! mirrored, twisted, tapered, bent. Everything follows from a key.
//!
//! ```
//! use gradreel::Key;
//! use gradreel_models::views::Ring;
//! use gradreel_models::views::objects::{Sample, SampleSettings};
//!
//! let ring = Ring::published(16);
//! let sample = Sample::draw(Key::new(7), &ring, 32, &SampleSettings::default());
//! assert_eq!(sample.views.len(), 16);
//! let seen = sample.seen(&ring).expect("the object is in the image");
//! assert!(seen.bounds.low.iter().all(|x| *x > 0.0) && seen.bounds.high.iter().all(|x| *x < 1.0));
//! assert!(seen.depth.is_some_and(|depth| (0.6..2.4).contains(&depth)));
//! ```

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

pub use folder::{FolderSettings, MeshFile, MeshFolder};
pub use mesh::TexturedMesh;
pub(crate) use body::Body;
pub(crate) use dice::Dice;
pub(crate) use field::Field;
pub(crate) use made::Made;
pub(crate) use mesh::{Bvh, crossed};
pub use placement::Placement;
pub use sample::{Sample, SampleSettings};

use self::lamp::Lamp;
use self::made::Made;
use self::mesh::Turned;
use crate::vector::{dot, minus};

/// An object. The longest side of its box is 1, the middle of the box is the origin.
pub struct Object {
    form: Form,
    lamp: Lamp,
}

enum Form {
    Made(Box<Made>),
    Mesh(Turned),
}

/// Where a ray meets an object.
struct Met {
    /// Towards the outside, of length 1.
    normal: [f64; 3],
    /// In the light of a lamp straight above the surface.
    colour: [f64; 3],
}

/// What a camera sees: a square image on white.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Pixels along a side.
    pub size: usize,
    /// Red, green and blue one after the other, `3 · size²` in −1..1, in steps of a byte.
    pub colours: Vec<f32>,
    /// The object's share of each pixel.
    pub coverage: Vec<f32>,
}

impl Object {
    /// The procedural object of a key, with so many nodes of its grid along the longest side (48 suit images of 64 pixels).
    pub fn new(key: Key, nodes: usize) -> Self {
        let [shape, paint, light] = key.split();
        Self { form: Form::Made(Box::new(Made::new([shape, paint], nodes))), lamp: Lamp::draw(light) }
    }

    /// A mesh, turned about the vertical by `turn` radians, in the light of a key.
    pub fn of_mesh(mesh: Arc<TexturedMesh>, turn: f64, light: Key) -> Self {
        Self { form: Form::Mesh(Turned::new(mesh, turn)), lamp: Lamp::draw(light) }
    }

    /// Half the sides of its box.
    pub fn half(&self) -> [f64; 3] {
        match &self.form {
            Form::Made(made) => made.half(),
            Form::Mesh(mesh) => mesh.half(),
        }
    }

    /// What the object looks like in its place from a camera of the ring's kind with this pose (world to camera), with
    /// `rays²` rays a pixel.
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
