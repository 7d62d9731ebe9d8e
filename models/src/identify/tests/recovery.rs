//! Known unknowns are recovered from rendered frames, and break-downs of the physics are said.

use crate::identify::{Free, Substeps, Unknowns, estimate, first_contact};
use gradreel::{DType, ErrorKind};

use super::scene::{block, film, problem, quick};

#[test]
fn velocity_and_stiffness_are_recovered_from_rendered_frames() {
    const FRAMES: usize = 8;
    let config = quick();
    let particles = block(6, 0.04);
    let truth = Unknowns { velocity: [0.3, -0.8, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &truth, &config, FRAMES, 32, DType::F32);
    let problem = problem(&particles, &observed, &config, DType::F32);
    let start = Unknowns { velocity: [0.0; 3], parameters: vec![1e4, 0.3], ..Unknowns::default() };
    let run = |start: &Unknowns, free, frames| {
        estimate(&problem, start, free, frames, 20, &mut |_| Ok(()), &mut Substeps::default()).unwrap().unknowns
    };
    let flying = run(&start, Free::Velocity, 4);
    assert_eq!(first_contact(&particles, &problem.world, 0.0, &flying, observed.frame_dt, FRAMES), 4);
    for (found, true_value) in flying.velocity.iter().zip(truth.velocity) {
        assert!((found - true_value).abs() < 0.02, "velocity {:?}", flying.velocity);
    }
    let found = run(&flying, Free::Magnitudes, FRAMES);
    let decades = (found.parameters[0] / truth.parameters[0]).log10();
    assert!(decades.abs() < 0.03, "E {:e} Pa", found.parameters[0]);
    assert!((found.parameters[1] - 0.3).abs() < 1e-12, "the ratio was held");
}

#[test]
fn a_step_that_is_too_large_is_halved_and_said() {
    let config = quick();
    let particles = block(4, 0.05);
    let unknowns = Unknowns { velocity: [0.0, -1.0, 0.0], parameters: vec![1e6, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &unknowns, &config, 3, 16, DType::F32);
    let mut problem = problem(&particles, &observed, &config, DType::F32);
    let mut substeps = Substeps::least(1);
    // as if the stage had begun with a much softer material
    problem.cfl = 8.0;
    let (loss, _) = problem.evaluate(&unknowns, Free::Material, 3, &mut substeps).unwrap();
    assert!(loss.is_finite());
    let notes = substeps.notes;
    assert!(!notes.is_empty() && notes[0].contains("substeps a frame") && notes[0].contains("particle"), "{notes:?}");
}

#[test]
fn physics_that_stays_broken_is_an_error_with_numbers() {
    let config = quick();
    let particles = block(4, 0.05);
    let unknowns = Unknowns { velocity: [0.0, -1.0, 0.0], parameters: vec![1e12, 0.3], ..Unknowns::default() };
    let soft = Unknowns { parameters: vec![1e4, 0.3], ..unknowns.clone() };
    let observed = film(&particles, &soft, &config, 3, 16, DType::F32);
    let mut problem = problem(&particles, &observed, &config, DType::F32);
    problem.cfl = 1e6;
    let error = problem.evaluate(&unknowns, Free::Material, 3, &mut Substeps::least(1)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Physics);
    let text = error.to_string();
    assert!(text.contains("particle") && text.contains("found"), "{text}");
}
