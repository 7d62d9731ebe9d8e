//! Files of tensors: what was written elsewhere is read bit for bit, and what is hostile is refused.

mod build;
mod checkpoint;
mod hostile;
mod mutations;
mod npy;
mod pickles;
mod refused;
mod safetensors;
