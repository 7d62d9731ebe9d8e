//! The substep on a GPU: vectors of an independent simulator, the CPU in double precision, repeatability, what goes wrong.
//!
//! Runs on any adapter, a software one included. Without one the tests say so and pass, unless `CI` is `true`.

mod scenes;
mod vectors;

use std::sync::OnceLock;

use gradreel::backend::gpu::Gpu;
use gradreel::{Device, Result};

/// The one GPU of all tests.
fn gpu() -> Option<Gpu> {
    static OPENED: OnceLock<Result<Gpu>> = OnceLock::new();
    match OPENED.get_or_init(Gpu::open) {
        Ok(gpu) => Some(gpu.clone()),
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => {
            panic!("the GPU tests must run here: {error}")
        }
        Err(error) => {
            eprintln!("skipped, because there is no GPU: {error}");
            None
        }
    }
}

fn device() -> Option<Device> {
    gpu().map(Device::Gpu)
}
