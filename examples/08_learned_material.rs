//! A material that nobody wrote down: a small neural network inside a constitutive law, trained through the simulator.
//!
//! The network sees invariants of the deformation and answers with how strongly the body resists shear and compression. Its
//! weights are parameters of the material like Young's modulus would be; the simulation is one node of the tape, so that
//! they are fitted to the tracks of a rubber block (a neo-Hookean one, which the network does not know) dropped on the ground.
//! It is judged by another drop, which it was not fitted to.
//!
//! ```text
//! cargo run --release --example 08_learned_material
//! ```

use gradreel::optim::Lbfgs;
use gradreel::{Result, Tape, Tensor, Var};
use gradreel_models::physics::materials::{Learned, NeoHookean};
use gradreel_models::physics::{Body, Collider, Law, Remat, Schedule, World, rollout};

const SIDE: usize = 4;
const DENSITY: f64 = 1000.0;
/// Frames 200 times a second; substeps for waves of up to 30 m/s.
const SCHEDULE: Schedule = Schedule { frames: 9, frame_dt: 1.0 / 200.0, substeps: 24 };

/// Positions `[frames, particles, 3]` of a block that hits the ground with this velocity.
fn drop(world: &World, law: &Law, parameters: Vec<Var>, tape: &Tape, velocity: [f64; 3]) -> Result<Var> {
    let at = |i: usize| 0.005 + 0.01 * i as f64;
    let block = (0..SIDE.pow(3)).flat_map(|i| [at(i / SIDE / SIDE), 0.02 + at(i / SIDE % SIDE), at(i % SIDE)]);
    let body = Body {
        positions: tape.constant(Tensor::from_vec(block.collect(), [SIDE.pow(3), 3])),
        velocity: tape.constant(Tensor::from_vec(velocity.to_vec(), [3])),
        density: tape.constant(Tensor::from_vec(vec![DENSITY], [1])),
        parameters,
    };
    rollout(world, law, SCHEDULE, Remat::default(), &body)
}

fn main() -> Result<()> {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
    let (truth, network) = (Law::of(NeoHookean), Learned::alone(5, 2e4, 3));
    let count = network.weights();
    let start: Vec<f64> = Law::of(network.clone()).parameters().iter().map(|p| p.start).collect();
    let law = Law::of(network);

    let tracks = |velocity: [f64; 3]| -> Result<Tensor> {
        let tape = Tape::new();
        let parameters = [8e4, 0.35].map(|value| tape.constant(Tensor::from_vec(vec![value], [1]))).to_vec();
        Ok(drop(&world, &truth, parameters, &tape, velocity)?.value()?.clone())
    };
    // Mean squared distance [mm²] to the tracks of a drop, and its gradient in the weights.
    let distance = |weights: &[f64], velocity: [f64; 3]| -> Result<(f64, Vec<f64>)> {
        let tape = Tape::new();
        let leaf = tape.leaf(Tensor::from_vec(weights.to_vec(), [count]));
        let parameters = (0..count).map(|n| leaf.select(0, n).reshape([1])).collect();
        let motion = drop(&world, &law, parameters, &tape, velocity)?;
        let millimetres = (motion - tape.constant(tracks(velocity)?)) * 1e3;
        let loss = millimetres.square().mean_all();
        Ok((loss.item()?, loss.backward()?.wrt(&leaf)?.to_vec()?))
    };

    let (seen, unseen) = ([0.0, -2.0, 0.0], [1.0, -1.5, 0.5]);
    println!("{count} weights");
    let mut evaluation = 0;
    let mut objective = |x: &[f64]| {
        let found = distance(x, seen)?;
        evaluation += 1;
        println!("  evaluation {evaluation:3}   {:10.5} mm²", found.0);
        Ok(found)
    };
    let search = Lbfgs { largest_move: 0.5, tolerance: 1e-4, ..Lbfgs::default() };
    let weights = search.minimise(&start, &mut objective, |_| Ok(()))?;
    for (name, velocity) in [("the drop it was fitted to", seen), ("another drop", unseen)] {
        let (before, after) = (distance(&start, velocity)?.0, distance(&weights, velocity)?.0);
        println!("{name}: {before:.4} mm² before, {after:.4} mm² after");
        assert!(after < 0.1 * before);
    }
    Ok(())
}
