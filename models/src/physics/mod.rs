//! Physics: the differentiable material point method.
//!
//! Particles carry a piece of material each; a grid that is new in every substep lets them exchange momentum. A substep is
//! MLS-MPM: quadratic B-splines, affine velocities (APIC, or a blend with FLIP), no damping. Everything has an exact adjoint:
//! the transfers by hand, the material by differentiating its scalar program.
//!
//! - [`World`]: grid spacing, gravity, [`Collider`]s (planes, boxes, balls, cylinders; solid or containers; at rest or moving;
//!   sticky, slippery or with Coulomb friction), the blend of APIC with FLIP, limits.
//! - [`Material`]: one constitutive law, written for one particle; [`Law`]: the same, traced. [`materials`] lists them, and
//!   [`check_material`] checks them.
//! - [`rollout`]: thousands of substeps as one node of the tape, with a [`Schedule`] and [`Remat`]; [`simulate`]: the same
//!   for several materials at once; [`Rollout::jvp`]: forward mode, several directions at once.
//! - [`State`], [`Simulation`], [`Tangent`]: one substep at a time, forwards, backwards and in forward mode, on plain arrays.
//! - [`GpuSimulation`]: many substeps on a GPU, forwards and backwards; [`rollout`] and [`simulate`] run there by themselves
//!   when their inputs live on one.
//!
//! Units are SI throughout; world y is up; node (0, 0, 0) of the grid is the world's origin. Results do not depend on the
//! number of threads, bit for bit; on a GPU they are the same at every run.
//!
//! Source: Hu et al., *A Moving Least Squares Material Point Method*, 2018; Jiang et al., *The Affine Particle-In-Cell
//! Method*, 2015.

mod check;
mod collider;
mod contact;
mod denormals;
mod failure;
mod flip;
mod forward;
mod gpu;
mod grid;
mod guard;
mod kernel;
mod node_grid;
mod law;
mod material;
pub mod materials;
mod parameters;
mod remat;
mod rollout;
mod row;
mod scene;
mod sound;
mod state;
mod stencil;
mod substep;
mod timestep;
mod totals;
mod trajectory;
mod transfer;
mod values;
mod world;

pub use check::{MaterialCheck, MaterialReport, check_material};
pub use collider::{Collider, Contact, Region, RigidMotion};
pub use forward::Tangent;
pub use gpu::GpuSimulation;
pub(crate) use guard::{Guard, is_thin};
pub use law::Law;
pub use material::{Given, History, Material, Point};
pub(crate) use node_grid::NodeGrid;
pub use node_grid::neighbours;
pub use parameters::{Map, Parameter, lame};
pub(crate) use parameters::{NINETY, width};
pub use remat::Remat;
pub use rollout::{Body, Rollout, rollout};
pub use row::Number;
pub use scene::{Scene, Substance, simulate};
pub use state::State;
pub use substep::{Portion, Simulation};
pub use timestep::{CFL, CFL_LIMIT, Schedule};
pub use values::{ValueGradients, Values};
pub use world::World;
