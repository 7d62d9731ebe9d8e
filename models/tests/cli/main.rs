//! The command line as its users meet it: the program itself, its exit codes, its messages and what it leaves behind.

mod bad_clips;
mod bad_settings;
mod bench;
mod bounces;
mod checks;
mod depth;
mod film;
mod fixes;
mod ground_contact;
#[cfg(unix)]
mod interrupted;
#[cfg(unix)]
mod killed;
mod laws;
#[path = "../../src/views/tests/mesh_files.rs"]
#[allow(dead_code)]
mod mesh_files;
mod meshes;
mod model;
mod places;
mod published;
#[path = "../video/onnx_file.rs"]
mod onnx_file;
mod resimulate;
mod resumed;
mod results;
mod scene;
mod synthesized;
mod trained;
mod unread;
mod weights;
