//! One update of the static and of the temporal field at published sizes: `cargo bench -p gradreel-models --bench field`.

use std::time::Instant;

use gradreel::optim::{Adam, Params};
use gradreel::{DType, Key, Result, Tape, Tensor};
use gradreel_models::field::temporal::{
    RayBatch, RayTargets, TemporalFit, TemporalFitSettings, TemporalSettings, TemporalWeights,
};
use gradreel_models::field::{DenseGrid, Occupancy, RadianceField, RadianceSizes, StaticSettings, static_step};
use gradreel_models::particles::Jitter;
use gradreel_models::render::Rays;

const RAYS: usize = 8192;
const UPDATES: usize = 5;

/// Rays from around through the middle of a box of about a metre.
fn rays() -> Rays {
    let u: Vec<f64> = Key::new(1).uniform(4 * RAYS).collect();
    let mut rays = Rays::default();
    for u in u.chunks_exact(4) {
        let (azimuth, spread) = (std::f64::consts::TAU * u[0], 0.7);
        let camera = [2.0 * azimuth.sin(), 0.6 + u[3], 2.0 * azimuth.cos()];
        let at = [spread * (u[1] - 0.5), 0.5 + spread * (u[2] - 0.5), spread * (u[1] * u[2] - 0.25)];
        rays.origins.push(camera);
        rays.directions.push([at[0] - camera[0], at[1] - camera[1], at[2] - camera[2]]);
    }
    rays
}

/// Raw densities of a ball.
fn ball(grid: &DenseGrid, inside: f64) -> Tensor {
    let value = |x: &[f64; 3]| {
        let r = (x[0].powi(2) + (x[1] - 0.5).powi(2) + x[2].powi(2)).sqrt();
        if r < 0.25 { inside as f32 } else { -5.0 }
    };
    let [x, y, z] = grid.dims;
    Tensor::from_vec(grid.nodes().iter().map(value).collect::<Vec<f32>>(), [x, y, z, 1])
}

fn report(name: &str, mut update: impl FnMut() -> Result<String>) -> Result<()> {
    let mut note = update()?;
    let mut times = Vec::new();
    for _ in 0..UPDATES {
        let start = Instant::now();
        note = update()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!("{name}: median {:.0} ms, {:.0} to {:.0} ms; {note}", times[UPDATES / 2], times[0], times[UPDATES - 1]);
    Ok(())
}

fn mib(bytes: usize) -> usize {
    bytes >> 20
}

fn still() -> Result<()> {
    let grid = DenseGrid::of_spacing([-0.5, 0.1, -0.5], [0.5, 1.0, 0.5], 0.02)?;
    let mut field = RadianceField::new(grid, 1e-4, RadianceSizes::default());
    field.base_spacing = 0.16;
    let mut params: Params = field.initialise(Key::new(1), DType::F32)?;
    params.set("radiance.density", ball(&field.grid, 20.0));
    let occupancy = field.occupancy(&params, 1e-7)?;
    let settings = StaticSettings::default();
    let (rays, mask) = (rays(), Tensor::full(1.0, [RAYS], DType::F32));
    let target = Tensor::full(0.5, [RAYS, 3], DType::F32);
    let mut adam = Adam::new(1e-3).with_rate("radiance.density", 1e-3);
    let mut number = 0;
    report("static", || {
        number += 1;
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let jitter = Jitter::Drawn(Key::new(number));
        let step = static_step(&field, &bound, &occupancy, &jitter, &rays, &target, &mask, &settings)?;
        let (particles, samples) = (step.particles.positions.dims()[0], step.pixels.weights.len());
        let peak = tape.memory().peak;
        let gradients = step.gradients(&bound, &params, &settings)?;
        drop((step, bound, tape));
        adam.step(&mut params, &gradients)?;
        Ok(format!("{particles} particles, {samples} seen samples, {} MiB on the tape", mib(peak)))
    })
}

fn temporal(name: &str, opaque: Option<f64>, masked: bool) -> Result<()> {
    let sizes = TemporalSettings::default();
    let settings = TemporalFitSettings { refinements: 0, ..TemporalFitSettings::default() };
    let mut fit = TemporalFit::new([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5], &sizes, &settings, DType::F32)?;
    if let Some(inside) = opaque {
        let density = ball(&fit.field.grid, inside);
        fit.params.set("temporal.density", density);
    }
    if masked {
        // what silhouettes leave of a ball that moves a little
        let grid = DenseGrid::of_count([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5], 32 * 32 * 32)?;
        let near = |x: &[f64; 3]| x[0].powi(2) + (x[1] - 0.5).powi(2) + x[2].powi(2) < 0.1;
        let occupied = grid.nodes().iter().map(near).collect();
        fit.field.mask = Some(Occupancy { grid, occupied });
    }
    let times: Vec<f64> = (0..14).map(|f| f64::from(f) / 13.0).collect();
    let batch = RayBatch {
        rays: rays(),
        moment_of: (0..RAYS as u32).map(|r| r % 14).collect(),
        targets: RayTargets {
            colours: Tensor::full(0.5, [RAYS, 3], DType::F32),
            weight: Tensor::full(1.0, [RAYS], DType::F32),
            imagined: None,
        },
    };
    report(name, || {
        let progress = fit.step_on(&batch, &times)?;
        Ok(format!("loss {:.4}", progress.loss))
    })?;
    let tape = Tape::with_profile();
    let bound = fit.params.bind(&tape);
    let begun = Instant::now();
    let seen = fit.field.render(&bound, &batch.rays, &batch.moment_of, &times)?;
    let rendered = begun.elapsed().as_secs_f64() * 1e3;
    let (looked_at, kept) = (seen.looked_at, seen.points.dims()[0]);
    let loss = seen.loss(&batch.targets, &TemporalWeights::default())?.total;
    drop(seen);
    let begun = Instant::now();
    bound.gradients(&loss.into_gradients()?)?;
    let back = begun.elapsed().as_secs_f64() * 1e3;
    let peak = mib(tape.memory().peak);
    println!("  {looked_at} samples, {kept} kept; forward {rendered:.0} ms, back {back:.0} ms, {peak} MiB on the tape");
    let mut rows = tape.profile().by_op();
    rows.sort_by_key(|(.., time)| std::cmp::Reverse(*time));
    for (op, calls, time) in rows.into_iter().take(12) {
        println!("  {op:<28} {calls:>5} {:>8.1} ms", time.as_secs_f64() * 1e3);
    }
    Ok(())
}

fn main() -> Result<()> {
    println!(
        "{RAYS} rays, {}, {} threads",
        gradreel::isa(),
        std::thread::available_parallelism().map_or(1, usize::from)
    );
    still()?;
    temporal("temporal, fog within silhouettes", None, true)?;
    temporal("temporal, a ball within silhouettes", Some(8.0), true)?;
    temporal("temporal, a ball", Some(8.0), false)
}
