//! A body that turns as it flies: derivatives, a spin that is found again, and flight as it is simulated.

use crate::identify::{Free, Problem, Substeps, Unknowns};
use gradreel::{DType, ErrorKind, Tape};

use super::scene::{block, film, problem, quick, search};

const FRAMES: usize = 5;

fn truth() -> Unknowns {
    Unknowns { velocity: [0.3, -0.2, 0.1], spin: [2.0, -3.0, 4.0], parameters: vec![6e4, 0.3], ..Unknowns::default() }
}

/// In flight and on the ground, along velocity, spin and material: against differences of the loss, and against the tape.
#[test]
fn derivatives_of_a_spin() {
    let config = quick();
    let particles = block(5, 0.04);
    let observed = film(&particles, &truth(), &config, FRAMES, 20, DType::F64);
    let simulated = problem(&particles, &observed, &config, DType::F64);
    let at = Unknowns { spin: [1.0, -2.5, 3.0], ..truth() };
    for problem in [simulated.flying(), simulated] {
        let free = Free::Both.with_spin(&problem.law, true);
        let mut substeps = Substeps::least(128);
        let here = problem.linearise(&at, free, FRAMES, &mut substeps).unwrap();
        let x = at.coordinates(&problem.law, free);
        assert_eq!(x.len(), 8);
        let loss = |k: usize, step: f64| {
            let mut x = x.clone();
            x[k] += step;
            let there = at.moved(&problem.law, free, &x);
            problem.misfit(&there, FRAMES, &mut substeps.clone()).unwrap()
        };
        for k in 0..8 {
            let difference = (loss(k, 1e-5) - loss(k, -1e-5)) / 2e-5;
            let error = (here.gradient[k] - difference).abs() / difference.abs().max(1e-3);
            assert!(error < 1e-4, "unknown {k} (flying: {}): {} {difference}", problem.flying, here.gradient[k]);
        }
        if problem.flying {
            let error = problem.evaluate(&at, free, FRAMES, &mut substeps).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NoGradient);
            let taped = problem.evaluate(&at, Free::Velocity, FRAMES, &mut substeps).unwrap();
            assert!((taped.0 - here.loss).abs() < 1e-12 * taped.0, "{} {}", taped.0, here.loss);
            continue;
        }
        let (_, gradient) = problem.evaluate(&at, free, FRAMES, &mut substeps).unwrap();
        for k in 0..8 {
            let relative = (here.gradient[k] - gradient[k]).abs() / gradient[k].abs().max(1e-3);
            assert!(relative < 1e-7, "unknown {k}: {} by forward mode, {} on the tape", here.gradient[k], gradient[k]);
        }
    }
}

/// A stiff body in the simulation turns as a rigid one does: as far as its cells can tell, whatever they store of the spin.
#[test]
fn a_simulated_flight_turns_as_a_rigid_body() {
    let config = quick();
    let particles = block(8, 0.02);
    let at = Unknowns { velocity: [0.0, 2.0, 0.0], parameters: vec![3e5, 0.3], ..truth() };
    let observed = film(&particles, &at, &config, FRAMES, 4, DType::F64);
    let simulated = problem(&particles, &observed, &config, DType::F64);
    let schedule = simulated.schedule(&at, FRAMES);
    let motion = |problem: &Problem<'_>| {
        let tape = Tape::new();
        let bound = at.constants(&tape, DType::F64).unwrap();
        problem.motion(&tape, &bound, schedule).unwrap().value().unwrap().to_vec().unwrap()
    };
    let (grid, rigid) = (motion(&simulated), motion(&simulated.flying()));
    let last = 3 * particles.len() * (FRAMES - 1);
    let apart: f64 = grid[last..].iter().zip(&rigid[last..]).map(|(a, b)| (a - b) * (a - b)).sum();
    let start = &rigid[..3 * particles.len()];
    let fallen = 2.0 * (FRAMES - 1) as f64 / 24.0 - 4.9 * ((FRAMES - 1) as f64 / 24.0).powi(2);
    let turned: f64 = rigid[last..]
        .iter()
        .zip(start)
        .enumerate()
        .map(|(i, (a, b))| (a - b - if i % 3 == 1 { fallen } else { 0.0 }).powi(2))
        .sum();
    let share = (apart / turned).sqrt();
    assert!(share < 0.03, "apart by {share} of the way that the turning moved particles");
}

/// From rest, out of the first frames.
#[test]
fn a_spin_is_found_again() {
    let config = quick();
    let particles = block(6, 0.04);
    let truth = truth();
    let observed = film(&particles, &truth, &config, 4, 24, DType::F32);
    let problem = problem(&particles, &observed, &config, DType::F32).flying();
    let start = Unknowns { velocity: [0.0; 3], spin: [0.0; 3], ..truth.clone() };
    let free = Free::Velocity.with_spin(&problem.law, true);
    let found = search(problem, &[start], free, 4, 12).remove(0).unknowns;
    for k in 0..3 {
        assert!((found.spin[k] - truth.spin[k]).abs() < 0.1, "{:?} {:?}", found.spin, truth.spin);
        assert!((found.velocity[k] - truth.velocity[k]).abs() < 0.02, "{:?} {:?}", found.velocity, truth.velocity);
    }
}
