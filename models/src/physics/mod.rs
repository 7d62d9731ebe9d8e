//! Physics: the differentiable material point method.
//!
//! Particles carry the material; a grid, rebuilt in every substep, exchanges momentum between them. A substep is
//! MLS-MPM: quadratic B-splines, affine velocities (APIC, or a blend with FLIP), no damping. All of it has an exact
//! adjoint: the transfers by hand, the material by differentiation of its scalar program.
//!
//! - [`World`]: grid spacing, gravity, [`Collider`]s (planes, boxes, balls, cylinders; solid or containers; at rest or
//!   moving; sticky, slippery or with Coulomb friction), the blend of APIC and FLIP, limits.
//! - [`Material`]: one constitutive law, written for one particle; [`Law`]: the same, traced. [`materials`] lists them,
//!   and [`check_material`] checks them.
//! - [`rollout`]: thousands of substeps as one node of the tape, with a [`Schedule`] and [`Remat`]; [`simulate`]: the
//!   same for several materials; [`Rollout::jvp`]: forward mode along several directions.
//! - [`State`], [`Simulation`]: single substeps, forward, vjp and jvp, on plain arrays.
//! - [`GpuSimulation`]: many substeps on a GPU, forward and vjp; [`rollout`] and [`simulate`] use it when their inputs
//!   are on a GPU.
//!
//! Units are SI throughout; the world's y axis points up; node (0, 0, 0) of the grid is the world's origin. Results are
//! bitwise independent of the number of threads; on a GPU they are reproducible from run to run.
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
mod names;
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
mod wgsl_law;
mod world;

pub use check::{MaterialCheck, MaterialReport, Response, check_material, responses, rollout_times, speed};
pub use collider::{Collider, Contact, Region, RigidMotion};
pub use gpu::GpuSimulation;
pub(crate) use guard::{Guard, is_thin};
pub use law::Law;
pub use material::{Given, History, Material, Point};
pub use names::name;
pub(crate) use node_grid::NodeGrid;
#[doc(hidden)] // the benchmarks use it
pub use node_grid::neighbours;
pub use parameters::{Map, Parameter, lame};
pub(crate) use parameters::{NINETY, width};
pub use remat::Remat;
pub use rollout::{Body, Rollout, rollout};
pub use row::Number;
pub use scene::{Scene, Substance, simulate};
pub use state::State;
pub(crate) use substep::Portion;
pub use substep::Simulation;
pub use timestep::{CFL, Schedule};
pub use values::{ValueGradients, Values};
pub use wgsl_law::WgslLaw;
pub(crate) use wgsl_law::{law_file, name_of};
pub use world::World;
