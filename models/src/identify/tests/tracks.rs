//! Five materials from the tracks of their particles, each from a start that is far off.

use crate::identify::Tracks;
use crate::physics::{Collider, Law, Rollout, Schedule, World, materials};
use gradreel::Tensor;

const DX: f64 = 0.04;

/// A block that is thrown onto the ground.
fn thrown(name: &str, truth: &[f64], velocity: [f64; 3], frames: usize, substeps: usize) -> Tracks {
    thrown_of(materials::find(name).unwrap(), truth, velocity, frames, substeps)
}

/// A block of a law that is thrown onto the ground.
pub fn thrown_of(law: Law, truth: &[f64], velocity: [f64; 3], frames: usize, substeps: usize) -> Tracks {
    let wobble = |i: usize| 0.1 * (1.7 * i as f64 + 0.3).sin();
    let block: Vec<f64> = (0..3 * 180)
        .map(|i| {
            let (p, axis) = (i / 3, i % 3);
            let index = [p / 36, p / 6 % 6, p % 6][axis] as f64;
            [0.013, 0.11, -0.021][axis] + DX / 2.0 * (index + 0.5 + wobble(i))
        })
        .collect();
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    let rollout = Rollout {
        world: world.clone(),
        laws: vec![law.clone()],
        material_of: None,
        gravity: false,
        friction: false,
        schedule: Schedule { frames, frame_dt: 1.0 / 60.0, substeps },
        remat: None,
    };
    let numbers = |values: &[f64]| Tensor::from_vec(values.to_vec(), [values.len()]);
    let mut inputs = vec![Tensor::from_vec(block, [180, 3]), numbers(&velocity), numbers(&[1000.0])];
    inputs.extend(truth.iter().map(|&value| numbers(&[value])));
    let (positions, _) = rollout.jvp(&inputs, &[]).unwrap();
    Tracks { positions, frame_dt: 1.0 / 60.0, substeps, contact: 3, world, law, density: 1000.0 }
}

/// How far each fitted parameter may be off, in its unconstrained form: decades for most.
fn recover(name: &str, truth: &[f64], start: &[f64], fitted: &[(usize, f64)], substeps: usize) {
    let velocity = [0.5, -1.8, 0.2];
    let tracks = thrown(name, truth, velocity, 12, substeps);
    let which: Vec<usize> = fitted.iter().map(|&(k, _)| k).collect();
    let found = tracks.fit([0.0; 3], start, &which).unwrap();
    println!(
        "{name}: {:?} (true {truth:?}), v {:?}, {:.1e} m, {:.0} rollouts, {:?}",
        found.parameters, found.velocity, found.distance, found.rollouts, found.fit.stop
    );
    for axis in 0..3 {
        let off = (found.velocity[axis] - velocity[axis]).abs();
        assert!(off < 0.005 * 1.87, "{name}: velocity off by {off} m/s");
    }
    for &(k, allowed) in fitted {
        let parameter = tracks.law.parameters()[k];
        let (a, b) = (found.parameters[k], truth[k]);
        let off = if parameter.map == crate::physics::Map::Log10 { (a / b).log10() } else { a - b };
        assert!(off.abs() < allowed, "{name}: {} is {a}, not {b}", parameter.name);
    }
    let most = 15.0 * (3 + fitted.len()) as f64;
    assert!(found.rollouts <= most, "{name}: {:.0} rollouts' worth of work, {most} allowed", found.rollouts);
}

#[test]
fn rubber() {
    recover("neo_hookean", &[2e5, 0.3], &[4e4, 0.1], &[(0, 0.01), (1, 0.01)], 40);
}

#[test]
fn plasticine() {
    recover("von_mises", &[3e5, 0.3, 4e3], &[1e5, 0.2, 1.5e4], &[(0, 0.01), (1, 0.01), (2, 0.01)], 40);
}

#[test]
fn water() {
    recover("newtonian", &[40.0, 8e4], &[5.0, 2e4], &[(0, 0.01), (1, 0.1)], 40);
}

#[test]
fn cream() {
    let fitted = [(0, 0.01), (1, 0.1), (2, 0.01), (3, 0.01)];
    recover("viscoplastic", &[3e4, 8e4, 800.0, 20.0], &[1.5e4, 5e4, 400.0, 10.0], &fitted, 40);
}

#[test]
fn sand() {
    recover("drucker_prager", &[2e5, 0.3, 32.0, 0.0], &[2e5, 0.3, 18.0, 0.0], &[(2, 0.5)], 40);
}

#[test]
fn tracks_that_do_not_fit_are_refused() {
    let mut tracks = thrown("neo_hookean", &[2e5, 0.3], [0.0; 3], 3, 40);
    assert!(tracks.fit([0.0; 3], &[2e5], &[0]).unwrap_err().to_string().contains("cannot be fitted"));
    assert!(tracks.fit([0.0; 3], &[2e5, 0.3], &[2]).unwrap_err().to_string().contains("cannot be fitted"));
    assert!(tracks.fit([0.0; 3], &[-1.0, 0.3], &[0]).unwrap_err().to_string().contains("cannot be fitted"));
    tracks.positions = Tensor::from_vec(vec![0.0; 12], [4, 3]);
    assert!(tracks.fit([0.0; 3], &[2e5, 0.3], &[0]).unwrap_err().to_string().contains("wrong shape"));
}
