//! Fuzzing of every reader that a stranger's file reaches, on a stable toolchain and within bounds.
//!
//! Each target mutates small valid files by a seeded generator and reads what comes out. A panic, a file that takes more than
//! a second or more than 256 MiB fails the test and leaves the file in `target/tmp/`. Environment:
//!
//! - `GRADREEL_FUZZ_SECONDS`: the time of each target (2 without it);
//! - `GRADREEL_FUZZ_MUTATIONS`: so many files a target instead, whatever time they take;
//! - `GRADREEL_FUZZ_SEED`: begins elsewhere.
//!
//! ```text
//! GRADREEL_FUZZ_SECONDS=600 GRADREEL_FUZZ_SEED=7 cargo test --release --test fuzz -- --nocapture
//! GRADREEL_FUZZ_MUTATIONS=50000 cargo test --release --test fuzz -- --nocapture
//! ```

mod allocation;
mod bombs;
#[path = "../files/build.rs"]
#[allow(dead_code)]
mod build;
#[path = "../../models/tests/video/builder.rs"]
#[allow(dead_code)]
mod builder;
mod clips;
mod harness;
#[path = "../../models/src/views/tests/mesh_files.rs"]
#[allow(dead_code)]
mod mesh_files;
mod meshes;
mod mutate;
#[path = "../../models/tests/video/onnx_file.rs"]
#[allow(dead_code)]
mod onnx_file;
mod pictures;
#[path = "../../models/tests/video/rig.rs"]
#[allow(dead_code)]
mod rig;
mod settings;
mod tensors;
