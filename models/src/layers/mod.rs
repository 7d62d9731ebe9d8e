//! Layers of the networks, built from a scoped view of the parameters.
//!
//! A layer is built by `new(&scope, sizes)`, which looks up its weights by name, and applied by `forward`. Names within
//! a scope are those of the published checkpoints, so that loading one needs no translation. A weight may be stored in
//! another float type than the layer computes in; it is cast on use. Images are `[batch, channels, height, width]`,
//! volumes `[batch, channels, depth, height, width]`, tokens `[batch, token, channel]`.
//!
//! ```
//! use gradreel::{DType, Key, Tape, Tensor};
//! use gradreel_models::layers::{Linear, Scope, initialise};
//!
//! let build = |scope: &Scope<'_>| Linear::new(&scope.at("head"), 3, 2);
//! let params = initialise(Key::new(1), DType::F32, build)?;
//! assert_eq!(params.get("head.weight")?.dims(), &[2, 3]);
//!
//! let tape = Tape::new();
//! let bound = params.bind(&tape);
//! let head = build(&Scope::root(&bound))?;
//! let y = head.forward(&tape.constant(Tensor::zeros([5, 3], DType::F32)));
//! assert_eq!(y.dims(), &[5, 2]);
//! # Ok::<(), gradreel::Error>(())
//! ```

mod scope;
mod linear;
mod convolution;
mod normalisation;
mod attention;
mod time_embedding;
mod residual;
mod resampling;
mod transformer;
mod depth_attention;
mod segment;
mod perceptron;

pub use attention::{Attention, AttentionSizes};
pub(crate) use attention::{merge_heads, split_heads};
pub use convolution::{Convolution, Kernel};
pub use depth_attention::{DepthAttention, DepthAttentionSizes};
pub use linear::Linear;
pub use normalisation::{GroupNorm, LayerNorm};
pub use perceptron::Perceptron;
pub use resampling::{Downsample, Upsample};
pub use residual::ResidualBlock;
pub(crate) use residual::per_channel;
pub use scope::{Init, Scope, Weights, initialise, listing};
pub use segment::Segment;
pub use time_embedding::TimeEmbedding;
pub use transformer::{SpatialTransformer, TransformerSizes};
