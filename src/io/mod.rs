//! Files of tensors.

pub mod safetensors;
