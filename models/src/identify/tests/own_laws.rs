//! Laws in WGSL that are not shipped, from the tracks of their particles, each from a start that is off by a factor of two.

use gradreel::DType;

use super::scene::{block, film, quick};
use super::tracks::thrown_of;
use crate::identify::{Free, Problem, Substeps, Unknowns};
use crate::physics::{Law, WgslLaw};

/// Fits the parameters, all but those that stay; each is found within 1 %.
fn recover(name: &str, truth: &[f64], start: &[f64], fitted: &[usize]) {
    let law = Law::read(format!("../examples/laws/{name}.wgsl")).unwrap();
    let tracks = thrown_of(law, truth, [0.5, -1.8, 0.2], 12, 60);
    let found = tracks.fit([0.0; 3], start, fitted).unwrap();
    println!("{name}: {:?} (true {truth:?}), {:.1e} m", found.parameters, found.distance);
    for &k in fitted {
        let off = found.parameters[k] / truth[k] - 1.0;
        assert!(off.abs() < 0.01, "{name}: {} is {}", tracks.law.parameters()[k].name, found.parameters[k]);
    }
}

#[test]
fn ogden() {
    recover("ogden", &[8e4, 2e4, 3e5], &[4e4, 4e4, 2e5], &[0, 1, 2]);
}

#[test]
fn maxwell() {
    recover("maxwell", &[4e4, 2e5, 1e5, 0.03], &[6e4, 1.5e5, 5e4, 0.06], &[0, 1, 2, 3]);
}

/// Fibres that are hardly stretched tell next to nothing of themselves: the search ends, and finds what the motion shows.
#[test]
fn fibres_that_are_hardly_stretched() {
    let text = std::fs::read_to_string("../examples/laws/fibres.wgsl").unwrap();
    for direction in ["0.0, 1.0, 0.0", "0.28, 0.96, 0.0"] {
        let text = text.replace("0.96, 0.28, 0.0", direction);
        let law = Law::of(WgslLaw::parse("fibres.wgsl", &text).unwrap());
        let tracks = thrown_of(law, &[1e5, 0.3, 2e5], [0.5, -1.8, 0.2], 12, 60);
        let found = tracks.fit([0.0; 3], &[5e4, 0.2, 1e4], &[0, 1, 2]).unwrap();
        println!("{direction}: {:?}, {:?}", found.parameters, found.fit.stop);
        assert!((found.parameters[0] / 1e5 - 1.0).abs() < 0.01, "{direction}: {:?}", found.parameters);
    }
}

#[test]
fn fibres() {
    recover("fibres", &[1e5, 0.3, 2e5], &[5e4, 0.2, 1e5], &[0, 1, 2]);
}

#[test]
fn layers() {
    recover("layers", &[2e4, 8e4, 2e5, 6e4], &[4e4, 4e4, 1e5, 3e4], &[0, 1, 2, 3]);
}

/// Pictures of a body whose stiffness and fibres vary in space: forward mode against the tape and against differences.
#[test]
fn what_varies_in_space_has_derivatives() {
    const FRAMES: usize = 5;
    let (config, particles) = (quick(), block(5, 0.04));
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    let law = Law::read("../examples/laws/layers.wgsl").unwrap();
    let problem = Problem::new(&particles, &observed, law, &config, DType::F64);
    let unknowns =
        Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![2e4, 5e4, 1e5, 3e4], ..Unknowns::default() };
    let (loss, gradient) = problem.evaluate(&unknowns, Free::Both, FRAMES, &mut Substeps::least(128)).unwrap();
    let forward = problem.linearise(&unknowns, Free::Both, FRAMES, &mut Substeps::least(128)).unwrap();
    assert!((forward.loss - loss).abs() < 1e-12 * loss);
    let x = unknowns.coordinates(&problem.law, Free::Both);
    for k in 3..x.len() {
        let at = |step: f64| {
            let mut x = x.clone();
            x[k] += step;
            let moved = unknowns.moved(&problem.law, Free::Both, &x);
            problem.misfit(&moved, FRAMES, &mut Substeps::least(128)).unwrap()
        };
        let difference = (at(2e-6) - at(-2e-6)) / 4e-6;
        for found in [gradient[k], forward.gradient[k]] {
            assert!((found - difference).abs() < 1e-5 * difference.abs().max(1e-4), "{k}: {found}, {difference}");
        }
        assert!(difference.abs() > 1e-4, "{k}: the pictures do not depend on it");
    }
}
