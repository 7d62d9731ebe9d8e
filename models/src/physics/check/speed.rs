//! The speed of sound that a law declares, and the speed of its program and of its rollouts.

use std::time::{Duration, Instant};

use gradreel::scalar::Lanes;
use gradreel::{Error, ErrorKind, Result};

use super::MaterialCheck;
use super::response::DENSITY;
use crate::physics::collider::Collider;
use crate::physics::law::Law;
use crate::physics::substep::Simulation;
use crate::physics::timestep::{CFL, Schedule};
use crate::physics::values::Values;
use crate::physics::world::World;

/// Compares the declared speed of sound with that of the stress at rest: a smaller one makes substeps unstable.
pub(super) fn wave_speed(law: &Law) -> MaterialCheck {
    let values = law.start_values();
    let (declared, real) = (law.wave_speed(&values, DENSITY), law.speed_at_rest(&values, DENSITY));
    let found = if declared > 0.0 { (real / declared - 1.0).max(0.0) } else { f64::INFINITY };
    // a law without elastic stress at rest has no wave
    let found = if real.is_nan() { f64::NAN } else { found };
    let note = format!("declared {declared:.4} m/s, of the stress at rest {real:.4} m/s");
    MaterialCheck { name: "wave speed", found, allowed: 1e-3, note }
}

/// The time \[s\] that stress, return map and history of one particle take in `f32`, the least of several runs on one thread.
pub fn speed(law: &Law) -> f64 {
    const PARTICLES: usize = 8192;
    let program = law.program();
    let noise = |k: usize, p: usize| 0.05 * ((k * 7 + p * 13) as f32 * 0.37).sin();
    let varied: Vec<Vec<f32>> = (0..18)
        .map(|k| (0..PARTICLES).map(|p| noise(k, p) + if k < 9 && k.is_multiple_of(4) { 1.0 } else { 0.0 }).collect())
        .collect();
    let values = law.parameters().iter().map(|p| p.start).chain(law.history().iter().map(|h| h.start));
    let inputs: Vec<Lanes<'_, f32>> = varied
        .iter()
        .map(|lanes| Lanes::Each(&lanes[..]))
        .chain([1e-4].into_iter().chain(values).map(|value| Lanes::Same(value as f32)))
        .collect();
    let mut outputs = vec![vec![0.0_f32; PARTICLES]; program.outputs().len()];
    let mut least = Duration::MAX;
    for _ in 0..8 {
        let start = Instant::now();
        program.run(PARTICLES, &inputs, &mut outputs.iter_mut().map(|lanes| &mut lanes[..]).collect::<Vec<_>>());
        least = least.min(start.elapsed());
    }
    least.as_secs_f64() / PARTICLES as f64
}

/// The time \[s\] that a substep of each of these laws takes, a particle, in `f32` on one thread: of the same block that hits
/// the ground with the same step. The laws take turns; the least time of each counts.
///
/// # Errors
/// What the simulation returns.
pub fn rollout_times(laws: &[&Law]) -> Result<Vec<f64>> {
    const SIDE: usize = 20;
    const DX: f64 = 0.02;
    const STEPS: usize = 24;
    const TURNS: usize = 15;
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    let sound = laws.iter().map(|law| law.wave_speed(&law.start_values(), DENSITY)).fold(0.0, f64::max);
    let dt = Schedule::stable(&world, 2, 0.01, sound, 3.0, 0.5 * CFL).dt();
    let at = |i: usize| [i / SIDE / SIDE, i / SIDE % SIDE, i % SIDE].map(|k| (DX * (0.5 * k as f64 + 0.27)) as f32);
    let positions: Vec<[f32; 3]> = (0..SIDE.pow(3)).map(at).collect();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone.map_err(|e| Error::new(ErrorKind::Io, "no thread can be started").found(e))?;
    let mut least = vec![Duration::MAX; laws.len()];
    for _ in 0..TURNS {
        for (law, least) in laws.iter().zip(&mut least) {
            let values = law.start_values().into_iter().map(|value| Values::Same(value as f32)).collect();
            let density = Values::Same(DENSITY as f32);
            let mut simulation = Simulation::new(&world, law, dt, positions.len(), &density, values)?;
            let mut now = simulation.at_rest(&positions, &vec![[0.3, -2.0, 0.1]; positions.len()])?;
            let mut next = now.zeros_like();
            let start = Instant::now();
            alone.install(|| {
                (0..STEPS).try_for_each(|_| {
                    simulation.substep(&now, &mut next)?;
                    std::mem::swap(&mut now, &mut next);
                    Ok(())
                })
            })?;
            *least = (*least).min(start.elapsed());
        }
    }
    Ok(least.into_iter().map(|time| time.as_secs_f64() / (STEPS * positions.len()) as f64).collect())
}
