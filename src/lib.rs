//! gradreel: automatic differentiation from the pixels of a video to the material of the filmed object. This crate is the core:
//! tensors, a tape, ops, scalar programs and optimisers. It knows nothing of videos or materials; `gradreel-models` does.
//!
//! ```text
//!  Tensor ──leaf──► Var ──op──► Var ──op──► Var (a scalar loss)        Tape: the record of all ops
//!                    │                       │
//!                    │ ◄──── backward ───────┘                          Gradients: one tensor for each leaf
//!
//!  a function of scalars ──trace──► scalar program ──► SIMD loop on the CPU
//!                                        │        ├──► WGSL kernel on a GPU
//!                                        │        └──► Jacobian products (programs again)
//!                                        └─ pointwise ops, material laws
//! ```
//!
//! # The five ideas
//!
//! - **Tape.** A [`Tape`] lives for one evaluation. [`Tape::leaf`] marks what is differentiated, [`Tape::constant`] what is not. Every
//!   op computes at once and appends a node. [`Var::backward`] returns [`Gradients`]; gradients are made of ops, so that gradients of
//!   gradients work. Nothing is global, and there is nothing to reset. [`Tape::remat`] trades time for memory.
//! - **Op.** An [`Op`] has a shape rule, a forward pass for each backend, and a derivative written in ops. [`Op::reads`] lists what the
//!   derivative looks at; the tape frees everything else. [`ops::registry`] lists the ops of the crate; being listed tests an op.
//! - **Scalar program.** [`scalar`] traces an ordinary function of scalars. The program runs over lanes with SIMD, prints as WGSL, and
//!   has derivative programs. [`Var::map`] makes an op of such a function.
//! - **Device.** A [`Tensor`] lives on a [`Device`]: the CPU, or a GPU through Vulkan, Metal or Direct3D 12. Ops run where their operands
//!   live. An op without a kernel says so at the call; nothing is moved silently.
//! - **Gradient check.** [`gradcheck`] compares derivatives with central differences in `f64`, [`devicecheck`] a GPU with the CPU. Both
//!   print a table.
//!
//! # Example
//!
//! ```
//! use gradreel::{Tape, Tensor, gradcheck};
//!
//! // loss = mean (a x − y)²
//! let tape = Tape::new();
//! let x = tape.constant(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
//! let y = tape.constant(Tensor::from_vec(vec![2.0, 4.0, 6.0], [3]));
//! let a = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
//! let loss = (&x * &a - &y).square().mean_all();
//! let gradients = loss.backward()?;
//! assert!((gradients.wrt(&a)?.item()? + 28.0 / 3.0).abs() < 1e-12); // 2 mean (a x − y) x at a = 1
//!
//! // a pointwise function of one's own, and the check of its derivative
//! let point = Tensor::from_vec(vec![-1.0, 0.5, 2.0], [3]);
//! let report = gradcheck("swish", &[("x", point)], |_: &Tape, v| Ok(v[0].map("swish", |x| x * x.logistic())))?;
//! assert!(report.passed(), "{report}");
//! # Ok::<(), gradreel::Error>(())
//! ```
//!
//! # Errors and panics
//!
//! A wrong shape is the caller's mistake and panics at the caller's line. Data, files, devices and physics return [`Error`], which says
//! what failed, where, what was found, what was wanted, and how to fix it. A fault within an operator (a lost GPU, a non-finite value in
//! anomaly mode) stays on the tape, and the next [`Var::value`], [`Var::item`] or [`Var::backward`] returns it.
//!
//! # Modules
//!
//! [`tensor`] · [`tape`] · [`ops`] · [`scalar`] · [`backend`] · [`optim`] (Adam, L-BFGS, Levenberg–Marquardt) · [`io`] (safetensors, npy,
//! PyTorch checkpoints)

pub mod backend;
mod error;
pub mod io;
pub mod ops;
pub mod optim;
mod random;
pub mod scalar;
pub mod tape;
pub mod tensor;

pub use error::{Error, ErrorKind, Result};
pub use random::Key;
pub use tape::devicecheck::{DeviceReport, DeviceRow, devicecheck};
pub use tape::gradcheck::{GradCheck, GradReport, gradcheck};
pub use tape::{Backward, Forward, Gradients, Memory, Op, Operands, Profile, ProfileRow, Reads, Tape, Var};
pub use tensor::{DType, Device, Element, Shape, Spec, Tensor};

/// The name of the instruction set that the CPU kernels of this process run with: `scalar`, `avx2`, `avx512` or `neon`.
///
/// It is the widest that the processor has, or the one that the environment variable `GRADREEL_ISA` names; see
/// [`scalar::Path`]. Libraries that the crate calls for small dense systems choose for themselves.
///
/// ```
/// println!("kernels run on {}", gradreel::isa());
/// ```
///
/// # Panics
/// When `GRADREEL_ISA` names one that this processor cannot run; [`scalar::Path::of_environment`] returns that as an error.
pub fn isa() -> &'static str {
    scalar::Path::best().name()
}

/// The programs of the README and of the guides run as tests.
#[cfg(doctest)]
mod documents {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/guide/new-law.md")]
    struct NewLaw;
    #[doc = include_str!("../docs/guide/new-op.md")]
    struct NewOp;
    #[doc = include_str!("../docs/guide/networks.md")]
    struct Networks;
    #[doc = include_str!("../docs/guide/training.md")]
    struct Training;
}
