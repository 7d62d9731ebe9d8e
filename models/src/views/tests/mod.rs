//! Layers and networks of the multi-view diffusion model against an independent implementation: outputs, intermediate
//! values and gradients, in `f64` and `f32` on the CPU and in `f32` on a GPU.

mod cameras;
mod examples;
mod fullsize;
mod harness;
mod keys;
mod layers;
mod mesh_dialects;
mod mesh_files;
mod mesh_folder;
mod meshes;
mod networks;
mod objects;
pub(crate) mod procedural;
mod sampler;
mod sampling;
mod sizes;
mod spatial_aware;
pub(crate) mod tiny;
mod training;
mod volumes;
mod weights;
