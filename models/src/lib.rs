//! The method from video to shape, motion and material, one module per stage in the order of the flow, and the
//! `gradreel` command.
//!
//! ```text
//! video ─┬─► monocular ─┐
//!        │    (scale)   ├─► field ─► particles ─► physics ─► render ─► identify ─► report
//!        └─► views ─────┘   (hull,   (material    (MLS-MPM)  (splat,   (Gauss–     (page,
//!        (imagined sides)   voxels)   points)                 march)    Newton)     files)
//!
//! scenes ─► physics ─► report                      (simulate a scene file, film it)
//! ```
//!
//! Quantities are in SI units; the world's y axis points up. The equations are in `docs/method.md` of the source tree.
//!
//! # Entry points of the library
//!
//! | call | does |
//! |---|---|
//! | [`video::Clip::open`] | reads a folder with calibrated cameras; [`monocular::clip_of_film`] reads a film |
//! | [`identify::Config`] | every setting, with defaults; [`Config::parse`](identify::Config::parse) reads TOML |
//! | [`identify::reconstruct()`] | runs the stages in a run folder, from which it can continue |
//! | [`scenes::Runner`], [`physics::rollout()`] | simulate a scene file, or a body on the tape with derivatives |
//! | [`identify::Tracks::fit`] | velocity and material from particle tracks, without images |
//!
//! A reconstruction takes minutes:
//!
//! ```no_run
//! use std::path::Path;
//!
//! use gradreel_models::identify::{Config, Run, reconstruct};
//! use gradreel_models::runtime::{progress::Progress, run_folder::RunFolder};
//! use gradreel_models::video::{Clip, OpenOptions};
//!
//! let clip = Clip::open(Path::new("examples/clips/bird"), &OpenOptions::default())?;
//! let config = Config::parse("[material]\nname = \"elastic\"")?;
//! let mut run = Run::create(RunFolder::create(Path::new("runs/bird"))?, config, &clip)?;
//! let found = reconstruct(&clip, &mut run, &Progress::new(true))?;
//! for (parameter, value) in found.law.parameters().iter().zip(&found.unknowns.parameters) {
//!     println!("{} = {value} {}", parameter.name, parameter.unit);
//! }
//! println!("velocity {:?} m/s, intervals {:?}", found.unknowns.velocity, run.state.intervals);
//! # Ok::<(), gradreel::Error>(())
//! ```
//!
//! A simulation takes a moment:
//!
//! ```
//! use std::path::Path;
//!
//! use gradreel_models::scenes::{Runner, SceneFile, Setup};
//!
//! let scene = r#"
//!     [time]
//!     duration_s = 0.1
//!     [grid]
//!     spacing_m = 0.05
//!     [ground]
//!     [materials.rubber]
//!     law = "neo_hookean"
//!     density_kg_m3 = 1000.0
//!     young = 1e5     # Pa
//!     poisson = 0.3
//!     [[objects]]
//!     material = "rubber"
//!     shape.sphere = { centre_m = [0.0, 0.3, 0.0], radius_m = 0.1 }
//! "#;
//! let setup = Setup::of(&SceneFile::parse(scene)?, Path::new("."))?;
//! let mut runner = Runner::<f32>::new(&setup)?;
//! let height = |runner: &Runner<'_, f32>| {
//!     let positions = runner.frame().positions;
//!     positions.iter().map(|x| x[1]).sum::<f32>() / positions.len() as f32
//! };
//! let before = height(&runner);
//! runner.advance(|| true)?; // one frame of 1/24 s in free fall: g t²/2 = 8.5 mm
//! assert!((before - height(&runner) - 0.0085).abs() < 0.001);
//! # Ok::<(), gradreel::Error>(())
//! ```
//!
//! A custom material implements [`physics::Material`]; [`physics::check_material`] tests it.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

// a benchmark shares a file with the tests
#[cfg(test)]
extern crate self as gradreel_models;

mod constant;
mod fnv1a;
mod mesh_files;
mod folder;
mod nearest;
mod text;
mod vector;
#[cfg(test)]
#[path = "../../tests/vectors/find.rs"]
mod find;
pub mod layers;
pub mod video;
pub mod views;
#[doc(hidden)] // the benchmarks use parts of it
pub mod field;
pub mod monocular;
pub mod particles;
pub mod physics;
pub mod render;
pub mod identify;
pub mod published;
pub mod scenes;
pub mod runtime;
#[doc(hidden)] // the fuzz tests and benchmarks use parts of it
pub mod report;
mod ablation;
mod coverage;
pub mod depth;
mod phone;
pub mod cli;
