//! A law of one's own in Rust, identified from a film by library calls.
//!
//! The film is that of `examples/clips/bird`, whose body was simulated as neo-Hookean. The law here has other names and
//! another form, but the same moduli at rest: `G = E/2(1+ν)` and `K = E/3(1−2ν)`. Coarse settings, so that it takes seconds.
//!
//! ```text
//! cargo run --release --example 10_own_law
//! ```

use std::path::Path;

use gradreel::{Error, Result, scalar::Mat3};
use gradreel_models::identify::{Config, Run, reconstruct};
use gradreel_models::physics::{Given, Law, Material, Parameter, Point};
use gradreel_models::runtime::{progress::Progress, run_folder::RunFolder};
use gradreel_models::video::{Clip, OpenOptions};

/// Kirchhoff stress `τ = G J^(−2/3) dev(F Fᵀ) + K J (J − 1) I`.
#[derive(Debug)]
struct Gel;

impl Material for Gel {
    fn name(&self) -> &str {
        "gel"
    }

    fn parameters(&self) -> Vec<Parameter> {
        let shear = Parameter::log10("shear", "G", "Pa", [1e3, 1e6]);
        vec![shear, Parameter::log10("bulk", "K", "Pa", [1e4, 1e7]).usually_times("shear", 2.2, 0.3)]
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let j = point.f.det();
        let distortion = (point.f * point.f.t()).dev() * j.powf(-2.0 / 3.0);
        distortion * given["shear"] + Mat3::eye() * (given["bulk"] * j * (j - 1.0))
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        ((values[1] + 4.0 / 3.0 * values[0]) / density).sqrt()
    }

    fn survives_inversion(&self) -> bool {
        false
    }
}

fn main() -> Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/clips/bird");
    let clip = Clip::open(&path, &OpenOptions::default())?;

    let mut config = Config::default().with_law(Law::of(Gel));
    config.geometry.dx = 0.05;
    config.geometry.fit.iterations = 20;
    config.geometry.fit.in_motion = 5;
    config.estimate.points = 4;
    config.estimate.survivors = 1;

    let folder = std::env::temp_dir().join(format!("gradreel-10-{}", std::process::id()));
    let mut run = Run::create(RunFolder::create(&folder)?, config, &clip)?;
    let found = reconstruct(&clip, &mut run, &Progress::new(false))?;
    std::fs::remove_dir_all(&folder).map_err(|e| Error::io(&folder, "remove the run", &e))?;

    let (young, poisson) = (3e5, 0.3); // what was simulated
    let truth = [young / (2.0 * (1.0 + poisson)), young / (3.0 * (1.0 - 2.0 * poisson))];
    for ((parameter, value), truth) in found.law.parameters().iter().zip(&found.unknowns.parameters).zip(truth) {
        let interval = run.state.intervals.iter().find(|interval| interval.name == parameter.name);
        let [low, high] = interval.map_or([f64::NAN; 2], |interval| interval.interval_90);
        println!("  {} {value:.3e} Pa, 90 % {low:.3e} to {high:.3e}, true {truth:.3e}", parameter.symbol);
        // on so coarse a grid, the order of magnitude
        assert!((value / truth).log10().abs() < 0.7);
    }
    Ok(())
}
