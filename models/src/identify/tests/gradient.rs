//! The gradient of the image loss against central differences in `f64`, through contact.

use crate::identify::{Config, Free, Substeps, Unknowns};
use crate::particles::Particles;
use gradreel::{DType, Tape, Tensor};

use super::scene::{block, film, problem, quick};

/// A block, and how it is thrown.
fn thrown(edge: usize, spacing: f64) -> (Config, Particles, Unknowns) {
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    (quick(), block(edge, spacing), truth)
}

#[test]
fn image_loss_gradient_through_contact_agrees_with_central_differences() {
    const FRAMES: usize = 5;
    let (config, particles, truth) = thrown(5, 0.04);
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    let problem = problem(&particles, &observed, &config, DType::F64);
    let unknowns = Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![4e4, 0.22], ..Unknowns::default() };

    // the block does touch the ground: without contact the motion would not depend on the material
    let stiffer = Unknowns { parameters: vec![8e4, 0.22], ..unknowns.clone() };
    let (soft, stiff) = (problem.positions(&unknowns).unwrap(), problem.positions(&stiffer).unwrap());
    let apart =
        soft.to_vec().unwrap().iter().zip(stiff.to_vec().unwrap()).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    assert!(apart > 5e-3, "the material moves particles by {apart} m only");

    let x = unknowns.coordinates(&problem.law, Free::Both);
    assert_eq!(x.len(), 5);
    let loss = |x: &[f64]| {
        let at = unknowns.moved(&problem.law, Free::Both, x);
        let mut substeps = Substeps::least(128);
        let found = problem.evaluate(&at, Free::Both, FRAMES, &mut substeps).unwrap();
        assert!(substeps.notes.is_empty(), "{:?}", substeps.notes);
        found
    };
    let (_, gradient) = loss(&x);
    for (i, name) in ["v_x", "v_y", "v_z", "log10 E", "raw ν"].iter().enumerate() {
        let step = 2e-6;
        let at = |sign: f64| {
            let mut moved = x.clone();
            moved[i] += sign * step;
            loss(&moved).0
        };
        let difference = (at(1.0) - at(-1.0)) / (2.0 * step);
        let relative = (gradient[i] - difference).abs() / difference.abs().max(1e-3);
        println!("{name:>8}: tape {:+.9e}  difference {difference:+.9e}  relative {relative:.1e}", gradient[i]);
        assert!(relative < 1e-5, "{name}: tape {} difference {difference}", gradient[i]);
    }
}

/// What a voxel's opacity does to the pictures: as mass and stiffness, through the motion, and to what is seen of it.
#[test]
fn the_gradient_in_opacities_agrees_with_central_differences() {
    const FRAMES: usize = 5;
    let (config, particles, truth) = thrown(5, 0.04);
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    let problem = problem(&particles, &observed, &config, DType::F64);
    let count = particles.len();
    let loss = |opacity: Tensor, moved: bool| {
        let tape = Tape::new();
        let opacity = tape.leaf(opacity);
        let at = truth.constants(&tape, DType::F64).unwrap();
        let massive = if moved { opacity.clone() } else { opacity.detach() };
        let motion = problem.motion_of(&massive, &at, problem.schedule(&truth, FRAMES)).unwrap();
        let colour = tape.constant(particles.colour(DType::F64).unwrap());
        let of = |frame: usize| {
            let pixels = problem.render(&motion.select(0, frame), &opacity, &colour, &observed.rays).unwrap();
            observed.targets[frame].loss(&pixels)
        };
        let loss = (0..FRAMES).map(of).reduce(|sum, loss| &sum + &loss).unwrap();
        let gradient = loss.backward().unwrap().wrt(&opacity).unwrap().to_vec().unwrap();
        (loss.item().unwrap(), gradient)
    };
    // away from what was filmed, where the loss is least
    let at: Vec<f64> = particles.opacity.iter().enumerate().map(|(i, a)| a - 0.02 * (i % 7) as f64).collect();
    let at = |step: f64, along: &[f64]| {
        let moved = at.iter().zip(along).map(|(a, d)| a + step * d).collect();
        Tensor::from_vec(moved, [count, 1])
    };
    for seed in 1..4 {
        let along: Vec<f64> = (0..count).map(|i| ((i * seed + seed) as f64 * 12.9898).sin()).collect();
        let of = |gradient: &[f64]| gradient.iter().zip(&along).map(|(g, d)| g * d).sum::<f64>();
        let taped = of(&loss(at(0.0, &along), true).1);
        let step = 1e-5;
        let difference = (loss(at(step, &along), true).0 - loss(at(-step, &along), true).0) / (2.0 * step);
        assert!((taped - difference).abs() < 1e-5 * difference.abs(), "tape {taped}, difference {difference}");
        let seen = of(&loss(at(0.0, &along), false).1);
        assert!((taped - seen).abs() > 1e-3 * taped.abs(), "the motion counts: {taped} with it, {seen} without");
    }
}

#[test]
fn single_precision_gives_the_same_gradient() {
    const FRAMES: usize = 4;
    let (config, particles, truth) = thrown(4, 0.05);
    let unknowns = Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![4e4, 0.22], ..Unknowns::default() };
    let gradient = |dtype| {
        let observed = film(&particles, &truth, &config, FRAMES, 20, dtype);
        let problem = problem(&particles, &observed, &config, dtype);
        let mut substeps = Substeps::least(96);
        let found = problem.evaluate(&unknowns, Free::Both, FRAMES, &mut substeps).unwrap();
        assert!(substeps.notes.is_empty(), "{:?}", substeps.notes);
        found.1
    };
    let (wide, narrow) = (gradient(DType::F64), gradient(DType::F32));
    let norm = wide.iter().map(|g| g * g).sum::<f64>().sqrt();
    for (a, b) in wide.iter().zip(&narrow) {
        assert!((a - b).abs() < 2e-3 * norm, "f64 {wide:?}, f32 {narrow:?}");
    }
}
