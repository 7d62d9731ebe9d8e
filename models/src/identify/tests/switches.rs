//! The switches of the loss: reverse and forward mode agree with all of them on, each acts, and none does where all views are
//! real.

use crate::identify::{Config, Free, Observed, Problem, Substeps, Unknowns};
use crate::particles::Particles;
use crate::video::{Clip, Foreground, Frame};
use gradreel::DType;
use ndarray::{Array2, Array3};

use super::scene::{block, camera, film, problem, quick};

const FRAMES: usize = 4;
const SIZE: usize = 20;

/// What was filmed, as a clip whose cameras but the first may be imagined. Those see another colour, a pixel aside.
fn clip_of(observed: &Observed, imagined: bool) -> Clip {
    let picture = |view: usize, frame: usize| {
        let pixels = observed.targets[frame].rgba.to_vec().unwrap();
        let at = |row: usize, column: usize, c: usize| {
            let column = if view > 0 { column.saturating_sub(1) } else { column };
            let value = pixels[4 * (view * SIZE * SIZE + row * SIZE + column) + c];
            if view > 0 && c < 2 { 0.7 * value } else { value }
        };
        Frame {
            rgb: Array3::from_shape_fn((SIZE, SIZE, 3), |(row, column, c)| {
                (at(row, column, c) + 1.0 - at(row, column, 3)) as f32
            }),
            alpha: Array2::from_shape_fn((SIZE, SIZE), |(row, column)| at(row, column, 3) as f32),
            weight: Array2::from_shape_fn((SIZE, SIZE), |(row, _)| f32::from(u8::from(row > 2))),
        }
    };
    let cameras: Vec<_> = (0..3).map(|i| camera(i, 0.4 + 2.1 * i as f64, SIZE)).collect();
    Clip {
        name: "block".into(),
        root: "block".into(),
        times: (0..FRAMES).map(|f| f as f64 / 24.0).collect(),
        frame_numbers: (0..FRAMES as i64).collect(),
        frames: (0..3).map(|view| (0..FRAMES).map(|frame| picture(view, frame)).collect()).collect(),
        foreground: vec![Foreground::ImageAlpha; 3],
        imagined: vec![false, imagined, imagined],
        cameras,
        assumptions: Vec::new(),
        flight: None,
        around: None,
        story: None,
    }
}

fn settings(loss: &str) -> Config {
    let mut config = Config::parse(loss).unwrap();
    config.world = quick().world;
    config
}

const ALL: &str = "[loss]\ntrajectory = 0.3\n[loss.views]\nalpha = 0.8\n[loss.pixels]\ndelta = 0.05\n\
                   [loss.ranges]\ninside = 0.02\noutside = 0.1\n[loss.ranges.ranges]\n'neo_hookean.young' = [1e5, 1e6]\n";

struct Scene {
    particles: Particles,
    imagined: Clip,
    real: Clip,
    at: Unknowns,
}

fn scene() -> Scene {
    let particles = block(5, 0.04);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let filmed = film(&particles, &truth, &quick(), FRAMES, SIZE, DType::F64);
    let at = Unknowns { velocity: [0.15, -1.7, 0.25], parameters: vec![4e4, 0.22], ..Unknowns::default() };
    Scene { imagined: clip_of(&filmed, true), real: clip_of(&filmed, false), particles, at }
}

/// Loss and gradient on the tape.
fn taped(problem: &Problem<'_>, at: &Unknowns) -> (f64, Vec<f64>) {
    let mut substeps = Substeps::least(96);
    let found = problem.evaluate(at, Free::Both, FRAMES, &mut substeps).unwrap();
    assert!(substeps.notes.is_empty(), "{:?}", substeps.notes);
    found
}

#[test]
fn both_modes_agree_with_all_switches_on() {
    let Scene { particles, imagined, at, .. } = scene();
    let config = settings(ALL);
    let observed = Observed::of(&imagined, &config, DType::F64).unwrap();
    assert!(observed.targets[0].robust.is_some() && observed.targets[0].trajectory.is_some());
    let problem = problem(&particles, &observed, &config, DType::F64);
    assert!(problem.ranges.is_some());
    let (loss, gradient) = taped(&problem, &at);
    let forward = problem.linearise(&at, Free::Both, FRAMES, &mut Substeps::least(96)).unwrap();
    assert!((forward.loss - loss).abs() < 1e-12 * loss, "{} by forward mode, {loss} on the tape", forward.loss);
    assert_eq!(problem.misfit(&at, FRAMES, &mut Substeps::least(96)).unwrap(), forward.loss);
    let x = at.coordinates(&problem.law, Free::Both);
    for k in 0..x.len() {
        let moved = |sign: f64| {
            let mut x = x.clone();
            x[k] += sign * 2e-6;
            taped(&problem, &at.moved(&problem.law, Free::Both, &x)).0
        };
        let difference = (moved(1.0) - moved(-1.0)) / 4e-6;
        let scale = gradient[k].abs().max(1e-3);
        assert!((gradient[k] - difference).abs() < 1e-5 * scale, "{k}: tape {}, difference {difference}", gradient[k]);
        assert!(
            (gradient[k] - forward.gradient[k]).abs() < 1e-8 * scale,
            "{k}: {} {}",
            gradient[k],
            forward.gradient[k]
        );
        assert!(forward.curvature[k][k] > 0.0);
    }
}

#[test]
fn each_switch_acts() {
    let Scene { particles, imagined, at, .. } = scene();
    let with = |loss: &str| {
        let config = settings(loss);
        let observed = Observed::of(&imagined, &config, DType::F64).unwrap();
        taped(&problem(&particles, &observed, &config, DType::F64), &at)
    };
    let (all, gradient) = with(ALL);
    for (on, off) in [
        ("trajectory = 0.3", "trajectory = 0.0"),
        ("alpha = 0.8", "alpha = 0.0"),
        ("delta = 0.05", "robust = false"),
        ("inside = 0.02", "enabled = false"),
    ] {
        assert!(ALL.contains(on));
        let (without, others) = with(&ALL.replace(on, off));
        assert!((without - all).abs() > 1e-3 * all, "{off}: {without} for {all}");
        assert!(gradient.iter().zip(&others).any(|(a, b)| (a - b).abs() > 1e-3 * a.abs()), "{off}: {others:?}");
    }
}

#[test]
fn where_all_views_are_real_nothing_is_changed() {
    let Scene { particles, real, at, .. } = scene();
    let with = |loss: &str| {
        let config = settings(loss);
        let observed = Observed::of(&real, &config, DType::F64).unwrap();
        taped(&problem(&particles, &observed, &config, DType::F64), &at)
    };
    let plain = "[loss.views]\nalpha = 0.0\n[loss.pixels]\nrobust = false\n[loss.ranges]\nenabled = false\n";
    assert_eq!(with(plain), with(""));
    assert_eq!(with(plain), with(&ALL.replace("trajectory = 0.3", "trajectory = 0.0")));
    assert_ne!(with(plain), with(&ALL.replace("trajectory = 0.3", "ranges_for_real = true")));
}
