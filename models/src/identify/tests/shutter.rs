//! The shutter: what a blurred and a rolled picture are, and their derivatives.

use std::sync::Arc;

use gradreel::{DType, Tape, Tensor};

use super::scene::{block, camera, film, problem, quick};
use crate::identify::model::shutter::Rows;
use crate::identify::{Config, Free, Observed, Problem, Substeps, Unknowns};
use crate::particles::Particles;
use crate::render::{Rays, Target};
use crate::video::Shutter;

const SIZE: usize = 40;
const FRAMES: usize = 4;

/// A block that one camera films while it moves evenly upwards.
fn rising() -> (Config, Particles, Unknowns, Observed) {
    let mut config = quick();
    config.world.gravity = [0.0; 3];
    let particles = block(6, 0.04);
    let truth = Unknowns { velocity: [0.0, 1.5, 0.0], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let three = film(&particles, &truth, &config, FRAMES, SIZE, DType::F64);
    let own = camera(0, 0.4, SIZE);
    let first = |tensor: &Tensor| Tensor::from_vec(tensor.slice::<f64>()[..4 * SIZE * SIZE].to_vec(), [SIZE * SIZE, 4]);
    let alone = |target: &Target| Target { rgba: first(&target.rgba), weight: first(&target.weight), ..target.clone() };
    let observed = Observed {
        targets: three.targets.iter().map(alone).collect(),
        rays: Arc::new(Rays::of_cameras(std::slice::from_ref(&own))),
        views: vec![SIZE * SIZE],
        imagined: vec![false],
        rows: Some(Rows::new(own, SIZE as f64)),
        ..three
    };
    (config, particles, truth, observed)
}

/// Coverage of a frame's picture, row by row.
fn coverage(problem: &Problem<'_>, unknowns: &Unknowns, frame: usize) -> Vec<f64> {
    let tape = Tape::new();
    let motion = tape.constant(problem.positions(unknowns).unwrap());
    let [opacity, colour] = [problem.particles.opacity(DType::F64), problem.particles.colour(DType::F64)]
        .map(|tensor| tape.constant(tensor.unwrap()));
    let places = problem.around(frame, FRAMES, &|frame| motion.select(0, frame));
    let picture = problem.picture(&places, [&opacity, &colour], &problem.observed.rays).unwrap();
    picture.value().unwrap().slice::<f64>().chunks_exact(4).map(|pixel| pixel[3]).collect()
}

/// The particles of a body that has moved on for some time \[s\].
fn moved_on(particles: &Particles, unknowns: &Unknowns, time: f64) -> Particles {
    let moved = |x: &[f64; 3]| std::array::from_fn(|k| x[k] + unknowns.velocity[k] * time);
    Particles { positions: particles.positions.iter().map(moved).collect(), ..particles.clone() }
}

#[test]
fn an_exposed_picture_is_the_mean_over_the_exposure() {
    let (config, particles, truth, observed) = rising();
    let sharp = problem(&particles, &observed, &config, DType::F64).flying();
    let exposure = 0.8 * observed.frame_dt;
    let blurred = Problem { shutter: Shutter { exposure, row_time: 0.0 }, ..sharp.clone() };
    for frame in 0..FRAMES {
        let mut mean = vec![0.0; SIZE * SIZE];
        for part in [-0.375, -0.125, 0.125, 0.375] {
            let there = moved_on(&particles, &truth, part * exposure);
            let picture = coverage(&Problem { particles: &there, ..sharp.clone() }, &truth, frame);
            mean.iter_mut().zip(picture).for_each(|(mean, value)| *mean += 0.25 * value);
        }
        let found = coverage(&blurred, &truth, frame);
        assert!(found.iter().zip(&mean).all(|(a, b)| (a - b).abs() < 1e-9), "frame {frame}");
        let sharp = coverage(&sharp, &truth, frame);
        assert!(found.iter().zip(&sharp).any(|(a, b)| (a - b).abs() > 0.1), "frame {frame} is not blurred");
    }
    // what rests is not blurred
    let still = Unknowns { velocity: [0.0; 3], ..truth };
    let [sharp, blurred] = [&sharp, &blurred].map(|problem| coverage(problem, &still, 1));
    assert!(sharp.iter().zip(&blurred).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn each_particle_is_where_it_was_when_its_row_was_read() {
    let (config, particles, truth, observed) = rising();
    let whole = problem(&particles, &observed, &config, DType::F64).flying();
    let row_time = 0.9 * observed.frame_dt / SIZE as f64;
    let rolled = Problem { shutter: Shutter { exposure: 0.0, row_time }, ..whole.clone() };
    let own = camera(0, 0.4, SIZE);
    let tape = Tape::new();
    let motion = tape.constant(whole.positions(&truth).unwrap());
    for frame in 0..FRAMES {
        let places = rolled.around(frame, FRAMES, &|frame| motion.select(0, frame));
        let [before, now, after] = &places[..] else { panic!("an open shutter looks at the frames beside") };
        let seen = rolled.instants().on_tape([before, now, after]).unwrap();
        assert_eq!(seen.len(), 1);
        let [at, seen] = [now, &seen[0]].map(|x| x.value().unwrap().to_vec().unwrap());
        for (x, seen) in at.chunks_exact(3).zip(seen.chunks_exact(3)) {
            let [_, row, _] = own.project([x[0], x[1], x[2]]).unwrap();
            let late = (row - 0.5 * SIZE as f64) * row_time;
            let wanted: [f64; 3] = std::array::from_fn(|k| x[k] + truth.velocity[k] * late);
            let apart = (0..3).map(|k| (seen[k] - wanted[k]).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-12, "{seen:?}, not {wanted:?}");
        }
    }
}

#[test]
fn derivatives_through_an_open_shutter_agree_with_differences() {
    let (mut config, particles, truth, observed) = rising();
    config.world.gravity = [0.0, -9.8, 0.0];
    let dt = observed.frame_dt;
    let shutter = Shutter { exposure: 0.6 * dt, row_time: -0.7 * dt / SIZE as f64 };
    let simulated = Problem { shutter, ..problem(&particles, &observed, &config, DType::F64) };
    let at = Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![4e4, 0.22], ..truth };
    // what flies shows nothing of the material
    for (problem, free) in [(&simulated, Free::Both), (&simulated.flying(), Free::Velocity)] {
        let substeps = Substeps::least(96);
        let (loss, gradient) = problem.evaluate(&at, free, FRAMES, &mut substeps.clone()).unwrap();
        let forward = problem.linearise(&at, free, FRAMES, &mut substeps.clone()).unwrap();
        assert!((forward.loss - loss).abs() < 1e-12 * loss && loss > 1e-5, "{} and {loss}", forward.loss);
        let x = at.coordinates(&problem.law, free);
        for k in 0..x.len() {
            let moved = |sign: f64| {
                let mut x = x.clone();
                x[k] += sign * 1e-6;
                let there = at.moved(&problem.law, free, &x);
                problem.evaluate(&there, free, FRAMES, &mut substeps.clone()).unwrap().0
            };
            let difference = (moved(1.0) - moved(-1.0)) / 2e-6;
            for found in [gradient[k], forward.gradient[k]] {
                let off = (found - difference).abs() / difference.abs().max(1e-3);
                assert!(off < 1e-5, "unknown {k}: {found}, {difference} by differences");
            }
        }
    }
}

#[test]
fn a_closed_shutter_changes_nothing() {
    let (config, particles, truth, observed) = rising();
    let problem = problem(&particles, &observed, &config, DType::F64).flying();
    assert!(!problem.shutter.is_open());
    let tape = Tape::new();
    let at: Tensor = problem.positions(&truth).unwrap();
    let motion = tape.constant(at);
    assert_eq!(problem.around(1, FRAMES, &|frame| motion.select(0, frame)).len(), 1);
}
