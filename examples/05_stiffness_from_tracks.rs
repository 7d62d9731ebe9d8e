//! How stiff is it? Young's modulus of a block from the tracks of its particles after a drop on the ground.
//!
//! The whole simulation is one node of the tape, so the mean squared distance to the tracks has a gradient with respect
//! to `log₁₀ E`, and L-BFGS walks down it. The tracks come from a simulation with half the time step and carry noise of
//! ±0.2 mm; the search starts a factor of ten too stiff.
//!
//! ```text
//! cargo run --release --example 05_stiffness_from_tracks
//! ```

use gradreel::optim::Lbfgs;
use gradreel::{Result, Tape, Tensor, Var, ops::uniform};
use gradreel_models::physics::{Body, CFL, Collider, Law, Remat, Schedule, World, materials::NeoHookean, rollout};

const TRUE_YOUNG: f64 = 2e4;
const POISSON: f64 = 0.3;
const DENSITY: f64 = 1000.0;
const FRAMES: usize = 8;
const SIDE: usize = 5;

/// Substeps fit for this stiffness; frames 120 times a second.
fn schedule(world: &World, law: &Law, young: f64) -> Schedule {
    let sound = law.wave_speed(&[young, POISSON], DENSITY);
    Schedule::stable(world, FRAMES, 1.0 / 120.0, sound, 2.0, CFL)
}

/// Positions `[frames, particles, 3]` of a block that hits the ground at 2 m/s.
fn drop(world: &World, law: &Law, schedule: Schedule, young: &Var) -> Result<Var> {
    let tape = young.tape();
    let at = |i: usize| 0.005 + 0.01 * i as f64;
    let block = (0..SIDE.pow(3)).flat_map(|i| [at(i / SIDE / SIDE), 0.02 + at(i / SIDE % SIDE), at(i % SIDE)]);
    let body = Body {
        positions: tape.constant(Tensor::from_vec(block.collect(), [SIDE.pow(3), 3])),
        velocity: tape.constant(Tensor::from_vec(vec![0.0, -2.0, 0.0], [3])),
        density: tape.constant(Tensor::from_vec(vec![DENSITY], [1])),
        parameters: vec![young.clone(), tape.constant(Tensor::from_vec(vec![POISSON], [1]))],
    };
    rollout(world, law, schedule, Remat::default(), &body)
}

fn main() -> Result<()> {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
    let law = Law::of(NeoHookean);

    let tape = Tape::new();
    let young = tape.constant(Tensor::from_vec(vec![TRUE_YOUNG], [1]));
    let exact = drop(&world, &law, schedule(&world, &law, TRUE_YOUNG).halved(), &young)?;
    let noise = tape.constant(uniform(1, exact.shape(), -2e-4..2e-4));
    let tracks = (&exact + &noise).value()?.clone();

    let mut objective = |x: &[f64]| {
        let tape = Tape::new();
        let log_young = tape.leaf(Tensor::from_vec(x.to_vec(), [1]));
        let young = (&log_young * std::f64::consts::LN_10).exp();
        let motion = drop(&world, &law, schedule(&world, &law, young.item()?), &young)?;
        let millimetres = (motion - tape.constant(tracks.clone())) * 1e3;
        let loss = millimetres.square().mean_all();
        let gradient = loss.backward()?.wrt(&log_young)?.to_vec()?;
        println!(
            "  E = {:9.0} Pa   loss {:9.5} mm²   d loss/d log₁₀E {:+.4}",
            young.item()?,
            loss.item()?,
            gradient[0]
        );
        Ok((loss.item()?, gradient))
    };
    let search = Lbfgs { largest_move: 0.4, tolerance: 1e-3, ..Lbfgs::default() };
    let found = search.minimise(&[(10.0 * TRUE_YOUNG).log10()], &mut objective, |_| Ok(()))?;

    let young = 10_f64.powf(found[0]);
    let error = young / TRUE_YOUNG - 1.0;
    println!("found {young:.0} Pa, true {TRUE_YOUNG:.0} Pa: {:+.2} %", 100.0 * error);
    assert!(error.abs() < 0.02);
    Ok(())
}
