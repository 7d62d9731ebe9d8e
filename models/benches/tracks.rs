//! Velocity and material from a file of particle tracks: what is found, what is true, and the work it took.
//!
//! `cargo bench -p gradreel-models --bench tracks -- scene.safetensors [another.safetensors …]`; beside each file lies a
//! JSON of the same name with the truth: `material` (`elastic` or `plasticine`), `parameters`, `initial_velocity`, `density`,
//! `dt`, `fps`, `simulation_dx`, `first_contact_frame`.

use std::path::Path;
use std::time::Instant;

use gradreel::io::TensorFile;
use gradreel_models::identify::Tracks;
use gradreel_models::physics::{Collider, World, materials};
use serde_json::Value;

fn main() {
    let files: Vec<String> = std::env::args().skip(1).filter(|argument| argument.ends_with(".safetensors")).collect();
    if files.is_empty() {
        println!("name a file of tracks: cargo bench -p gradreel-models --bench tracks -- scene.safetensors");
    }
    println!("{}", gradreel::isa());
    for file in &files {
        measure(Path::new(file));
    }
}

fn measure(path: &Path) {
    let positions = TensorFile::read(path).expect("a file of tracks").get("x").expect("tracks `x`").clone();
    let text = std::fs::read_to_string(path.with_extension("json")).expect("the truth beside it");
    let truth: Value = serde_json::from_str(&text).expect("JSON");
    let number = |value: &Value| value.as_f64().expect("a number");
    let parameters = &truth["parameters"];
    let (law, names, start): (_, &[&str], &[f64]) = match truth["material"].as_str() {
        Some("elastic") => ("neo_hookean", &["E", "nu"], &[1e5, 0.2]),
        Some("plasticine") => ("von_mises", &["E", "nu", "yield_stress"], &[1e6, 0.2, 5e3]),
        other => panic!("no start for the material {other:?}"),
    };
    let frame_dt = 1.0 / number(&truth["fps"]);
    let tracks = Tracks {
        positions,
        frame_dt,
        substeps: (frame_dt / number(&truth["dt"])).round() as usize,
        contact: truth["first_contact_frame"].as_u64().expect("a frame") as usize,
        world: World { colliders: vec![Collider::ground(0.0)], ..World::new(number(&truth["simulation_dx"])) },
        law: materials::find(law).expect("a shipped law"),
        density: number(&truth["density"]),
    };
    let fitted: Vec<usize> = (0..names.len()).collect();
    let begun = Instant::now();
    let found = tracks.fit([0.0; 3], start, &fitted).expect("a fit");
    let seconds = begun.elapsed().as_secs_f64();
    let again = Instant::now();
    tracks.motion(found.velocity, &found.parameters).expect("a rollout");
    let rollout = again.elapsed().as_secs_f64();
    println!(
        "{}: {} particles, {} frames, {} substeps each",
        path.display(),
        tracks.positions.dims()[1],
        tracks.positions.dims()[0],
        tracks.substeps
    );
    for ((name, &start), &value) in names.iter().zip(start).zip(&found.parameters) {
        let wanted = number(&parameters[*name]);
        println!(
            "  {name:<14} {value:>13.5e}   true {wanted:>10.4e}   log10 off {:>9.1e}   off {:>9.1e}   from {start:e}",
            (value / wanted).log10(),
            value - wanted
        );
    }
    let wanted: Vec<f64> = (0..3).map(|axis| number(&truth["initial_velocity"][axis])).collect();
    let off = found.velocity.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let size = wanted.iter().map(|v| v * v).sum::<f64>().sqrt();
    println!("  velocity       {:.5?}   true {wanted:?}   {:.3} % off", found.velocity, 100.0 * off / size);
    println!(
        "  {:.1} s = {:.0} rollouts of {rollout:.2} s ({:.0} by count) for {} unknowns, distance {:.2e} m, {:?} after {} evaluations",
        seconds,
        seconds / rollout,
        found.rollouts,
        3 + fitted.len(),
        found.distance,
        found.fit.stop,
        found.fit.evaluations
    );
}
