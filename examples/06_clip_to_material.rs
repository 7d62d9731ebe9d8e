//! From the pixels of a clip to shape, velocity and material, by library calls.
//!
//! The same stages as `gradreel reconstruct examples/clips/bird`, on a coarse grid and with few iterations so that it
//! takes seconds: velocity comes out well, stiffness only to its order of magnitude. Delete the settings for the real thing.
//!
//! ```text
//! cargo run --release --example 06_clip_to_material
//! ```

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use gradreel_models::identify::{Config, Run, reconstruct};
use gradreel_models::runtime::progress::Progress;
use gradreel_models::runtime::run_folder::RunFolder;
use gradreel_models::video::{Clip, OpenOptions};

fn main() -> Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/clips/bird");
    let clip = Clip::open(&path, &OpenOptions::default())?;
    println!("{}: {} cameras, {} frames", clip.name, clip.cameras.len(), clip.frame_count());

    let mut config = Config::default();
    config.geometry.dx = 0.05;
    config.geometry.fit.iterations = 20;
    config.geometry.fit.in_motion = 5;
    config.estimate.points = 4;
    config.estimate.survivors = 1;
    config.estimate.steps = 2;

    // A run lives in a folder, from which it could go on after an interruption.
    let folder = std::env::temp_dir().join(format!("gradreel-06-{}", std::process::id()));
    let mut run = Run::create(RunFolder::create(&folder)?, config, &clip)?;
    let found = reconstruct(&clip, &mut run, &Progress::new(false))?;
    for (stage, seconds) in run.state.finished.iter().zip(&run.state.seconds) {
        println!("  {seconds:5.1} s  {stage}");
    }
    std::fs::remove_dir_all(&folder).map_err(|e| Error::io(&folder, "remove the run", &e))?;

    // What was simulated when the clip was made; a reconstruction never reads it.
    let text = std::fs::read_to_string(path.join("truth.json")).map_err(|e| Error::io(&path, "read the truth", &e))?;
    let truth: serde_json::Value =
        serde_json::from_str(&text).map_err(|e| Error::new(ErrorKind::Input, "truth.json").found(e))?;
    println!("  {:<10} {:>12} {:>12}", "", "found", "true");
    for (parameter, value) in found.law.parameters().iter().zip(&found.unknowns.parameters) {
        let truth = &truth["parameters"][parameter.name]["value"];
        println!("  {:<10} {value:>12.3} {truth:>12} {}", parameter.symbol, parameter.unit);
    }
    let mut apart = 0.0_f64;
    let mut speed = 0.0_f64;
    for (axis, value) in found.unknowns.velocity.iter().enumerate() {
        let truth = truth["initial_velocity"]["value"][axis].as_f64().unwrap_or(f64::NAN);
        println!("  {:<10} {value:>12.3} {truth:>12} m/s", ["v_x", "v_y", "v_z"][axis]);
        apart += (value - truth).powi(2);
        speed += truth.powi(2);
    }
    let error = (apart / speed).sqrt();
    println!("  velocity off by {:.1} % of the speed", 100.0 * error);
    assert!(error < 0.1);
    Ok(())
}
