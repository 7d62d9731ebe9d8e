//! Files of tensors: safetensors, PyTorch checkpoints, and NumPy's arrays.
//!
//! [`Archive`] lists the tensors of a file and reads one when it is asked for; [`TensorFile`] holds a whole file in memory
//! and writes it. [`npy`] reads and writes single arrays.
//!
//! Every reader takes files of strangers: nothing in them is executed, what they claim is checked before it is believed, and
//! a reader allocates at most a fixed multiple of the size of the file.

mod archive;
mod bytes;
pub mod checkpoint;
mod element;
mod foreign;
pub mod npy;
mod npz;
mod rewrite;
pub mod safetensors;
mod source;
mod zip;

pub use archive::{Archive, Entry, Format};
pub(crate) use bytes::Bytes;
pub use element::Stored;
pub use foreign::foreign;
pub use safetensors::TensorFile;
