//! What falls before it comes near the ground is not simulated.

use crate::identify::{Free, Problem, Unknowns};
use crate::physics::{Body, Schedule, rollout};
use gradreel::{DType, Tape, Tensor};

use super::scene::{block, film, problem, quick};

const FRAMES: usize = 5;

/// The frames in which the block is further above the ground than two cells, of 0.08 m: 0.30 m and 0.24 m; in the third it is at 0.17 m,
/// where the simulation begins.
const FALLING: usize = 2;

fn motion(problem: &Problem<'_>, unknowns: &Unknowns, schedule: Schedule) -> Vec<f64> {
    let tape = Tape::new();
    let bound = unknowns.bind(&tape, &problem.law, Free::Both, DType::F64).unwrap();
    problem.motion(&tape, &bound, schedule).unwrap().value().unwrap().to_vec().unwrap()
}

#[test]
fn a_motion_is_that_of_a_simulation_from_the_first_frame_on() {
    let (config, particles) = (quick(), block(5, 0.04));
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &truth, &config, FRAMES, 4, DType::F64);
    let problem = problem(&particles, &observed, &config, DType::F64);
    let schedule = problem.schedule(&truth, FRAMES);
    let found = motion(&problem, &truth, schedule);

    let tape = Tape::new();
    let early = |axis: usize| truth.velocity[axis] - 0.5 * schedule.dt() * config.world.gravity[axis];
    let opacity = tape.constant(Tensor::from_vec(particles.opacity.clone(), [particles.len()]));
    let constant = |values: Vec<f64>, shape: &[usize]| tape.constant(Tensor::from_vec(values, shape));
    let body = Body {
        positions: constant(particles.positions.concat(), &[particles.len(), 3]),
        velocity: constant(vec![early(0), early(1), early(2)], &[3]),
        density: &opacity * config.world.density,
        parameters: vec![&opacity * truth.parameters[0], constant(vec![truth.parameters[1]], &[1])],
    };
    let whole = rollout(&problem.world, &problem.law, schedule, problem.remat, &body).unwrap();
    let whole = whole.value().unwrap().to_vec().unwrap();
    assert_eq!(found.len(), whole.len());
    let apart = found.iter().zip(&whole).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-12, "{apart} m apart");

    // no rounding of substeps in frames that are not simulated, and some in those that are, or if the body turns
    let frame = |motion: &[f64], frame: usize| motion[frame * 3 * particles.len()..][..3 * particles.len()].to_vec();
    let other = Schedule { substeps: schedule.substeps + 3, ..schedule };
    let finer = motion(&problem, &truth, other);
    for k in 0..=FALLING {
        assert_eq!(frame(&found, k), frame(&finer, k), "frame {k}");
    }
    assert_ne!(frame(&found, FALLING + 1), frame(&finer, FALLING + 1));
    let turning = Unknowns { spin: [0.0, 1e-9, 0.0], ..truth };
    assert_ne!(
        frame(&motion(&problem, &turning, schedule), FALLING),
        frame(&motion(&problem, &turning, other), FALLING)
    );
}
