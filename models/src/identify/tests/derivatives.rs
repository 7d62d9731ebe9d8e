//! Least squares over the pixels: derivatives against the tape and against differences.

use crate::identify::model::linearise::Derivatives;
use crate::identify::model::unknowns::Unknown;
use crate::identify::{Config, Free, Ground, GroundContact, Linearised, Observed, Problem, Sight, Substeps, Unknowns};
use crate::particles::Particles;
use gradreel::DType;

use super::scene::{block, camera, film, problem, quick};

const FRAMES: usize = 5;

/// A block of rubber that is thrown down, and the film of it.
fn thrown() -> (Config, Particles, Unknowns, Observed) {
    let config = quick();
    let particles = block(5, 0.04);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    (config, particles, truth, observed)
}

#[test]
fn forward_mode_agrees_with_the_tape_and_with_differences_of_pictures() {
    let (config, particles, truth, observed) = thrown();
    let problem = problem(&particles, &observed, &config, DType::F64);
    contact_height(&problem, &truth, FRAMES);
    let unknowns = Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![4e4, 0.22], ..Unknowns::default() };
    let mut substeps = Substeps::least(128);
    let (loss, gradient) = problem.evaluate(&unknowns, Free::Both, FRAMES, &mut substeps).unwrap();
    let at = problem.linearise(&unknowns, Free::Both, FRAMES, &mut substeps).unwrap();
    assert!((at.loss - loss).abs() < 1e-12 * loss, "{} by forward mode, {loss} on the tape", at.loss);
    for k in 0..5 {
        let relative = (at.gradient[k] - gradient[k]).abs() / gradient[k].abs().max(1e-3);
        assert!(relative < 1e-7, "unknown {k}: {} by forward mode, {} on the tape", at.gradient[k], gradient[k]);
    }
    // Differences over a finite step become derivatives as it becomes small, in proportion to it.
    let mut ahead = |share: f64| {
        let how = Derivatives::Ahead(share);
        let frames = problem.linearise_frames(&unknowns, Free::Both, 0..FRAMES, how, &mut substeps);
        let frames: Vec<Linearised> = frames.unwrap();
        let mean = |of: &dyn Fn(&Linearised) -> f64| frames.iter().map(of).sum::<f64>() / FRAMES as f64;
        let off = |k: usize| (mean(&|frame| frame.curvature[k][k]) / at.curvature[k][k] - 1.0).abs();
        let slope = |k: usize| (mean(&|frame| frame.gradient[k]) / at.gradient[k] - 1.0).abs();
        assert!((mean(&|frame| frame.loss) / at.loss - 1.0).abs() < 1e-12, "the same picture");
        (0..5).map(|k| [off(k), slope(k)]).collect::<Vec<_>>()
    };
    for (k, (far, near)) in ahead(1e-3).into_iter().zip(ahead(1e-4)).enumerate() {
        for (far, near) in far.into_iter().zip(near) {
            assert!(0.0 < near && near < 0.2 * far && near < 1e-2, "unknown {k}: off by {far}, then {near}");
        }
    }
    // At the truth residuals vanish, and the curvature is that of the loss itself.
    let best = problem.linearise(&truth, Free::Both, FRAMES, &mut Substeps::default()).unwrap();
    assert!(best.loss < 1e-20, "{}", best.loss);
    let x = truth.coordinates(&problem.law, Free::Both);
    let slope = |x: &[f64]| {
        let at = truth.moved(&problem.law, Free::Both, x);
        problem.linearise(&at, Free::Both, FRAMES, &mut Substeps::default()).unwrap().gradient
    };
    for (k, step) in [(3, 1e-5), (4, 1e-5), (1, 1e-5)] {
        let moved = |sign: f64| {
            let mut x = x.clone();
            x[k] += sign * step;
            slope(&x)
        };
        let (plus, minus) = (moved(1.0), moved(-1.0));
        for l in 0..5 {
            let difference = (plus[l] - minus[l]) / (2.0 * step);
            let scale = (best.curvature[k][k] * best.curvature[l][l]).sqrt();
            assert!(
                (difference - best.curvature[k][l]).abs() < 2e-2 * scale,
                "curvature {k},{l}: {} by Gauss and Newton, {difference} by differences",
                best.curvature[k][l]
            );
            assert_eq!(best.curvature[k][l], best.curvature[l][k]);
        }
    }
}

/// The derivative along the height at which the ground is felt, against differences, and forward mode against the tape there.
fn contact_height(problem: &Problem<'_>, truth: &Unknowns, frames: usize) {
    let at = |contact: f64| Unknowns { contact, ..truth.clone() };
    let free = Free::NOTHING.with_ground(&problem.law, Ground::Known);
    let loss = |contact| problem.linearise(&at(contact), free, frames, &mut Substeps::default()).unwrap();
    let (here, plus, minus) = (loss(-0.1), loss(-0.1 + 1e-6), loss(-0.1 - 1e-6));
    let difference = (plus.loss - minus.loss) / 2e-6;
    assert!((here.gradient[0] - difference).abs() < 1e-5 * difference.abs(), "{} {difference}", here.gradient[0]);
    let taped = problem.evaluate(&at(-0.1), Free::Velocity, frames, &mut Substeps::default()).unwrap().0;
    assert!((here.loss - taped).abs() < 1e-12 * taped && here.loss > 1e-4, "{} {taped}", here.loss);
}

/// The friction of the ground along with the rest: forward mode against the tape, and against differences.
#[test]
fn friction_of_the_ground() {
    let (mut config, particles, truth, _) = thrown();
    config.world.ground_contact = GroundContact::Friction;
    let truth = Unknowns { velocity: [0.9, -1.2, 0.1], friction: 0.3, ..truth };
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    let problem = problem(&particles, &observed, &config, DType::F64);
    let free = Free::Both.with_friction(&problem.law);
    assert_eq!(free.list(&problem.law).last(), Some(&Unknown::Friction));
    assert!(problem.misfit(&truth, FRAMES, &mut Substeps::default()).unwrap() < 1e-20);
    let mut substeps = Substeps::least(128);
    let unknowns = Unknowns { friction: 0.2, parameters: vec![4e4, 0.22], ..truth };
    let (loss, gradient) = problem.evaluate(&unknowns, free, FRAMES, &mut substeps).unwrap();
    let at = problem.linearise(&unknowns, free, FRAMES, &mut substeps).unwrap();
    assert!((at.loss - loss).abs() < 1e-12 * loss && loss > 1e-6, "{} by forward mode, {loss} on the tape", at.loss);
    for k in 0..6 {
        let relative = (at.gradient[k] - gradient[k]).abs() / gradient[k].abs().max(1e-3);
        assert!(relative < 1e-7, "unknown {k}: {} by forward mode, {} on the tape", at.gradient[k], gradient[k]);
    }
    let x = unknowns.coordinates(&problem.law, free);
    let moved = |sign: f64| {
        let mut x = x.clone();
        x[5] += sign * 1e-6;
        let there = unknowns.moved(&problem.law, free, &x);
        problem.evaluate(&there, free, FRAMES, &mut substeps.clone()).unwrap().0
    };
    let difference = (moved(1.0) - moved(-1.0)) / 2e-6;
    assert!((difference - gradient[5]).abs() < 1e-4 * difference.abs(), "{difference} and {}", gradient[5]);
    // a ground without friction has none to find
    let sticky = super::scene::problem(&particles, &observed, &quick(), DType::F64);
    let at = sticky.linearise(&unknowns, free, FRAMES, &mut substeps).unwrap();
    assert_eq!(at.gradient[5], 0.0);
}

/// A body that is sheared in depth, or is more distant, looks the same in the first frame and falls another way; derivatives along that against
/// differences, simulated and in flight, and forward mode against the tape there.
#[test]
fn a_body_is_sheared_along_the_rays_of_its_camera() {
    let (config, particles, truth, seen_by_three) = thrown();
    let middle = particles.centre_of_mass();
    let sight = Sight::at(&camera(1, 2.5, 20), middle).map(|sight| sight.growing(0.3));
    let observed = Observed { sight, ..seen_by_three };
    let problem = problem(&particles, &observed, &config, DType::F64);
    let sheared = |depth: [f64; 4]| Unknowns { depth, ..truth.clone() };
    let positions = |depth| problem.positions(&sheared(depth)).unwrap().slice::<f64>().to_vec();
    let (upright, moved) = (positions([0.0; 4]), positions([0.4, -0.3, 0.1, 0.0]));
    let own = camera(1, 2.5, 20);
    for (x, at) in upright.chunks_exact(3).zip(moved.chunks_exact(3)).take(particles.len()) {
        let of = |x: &[f64]| own.project([x[0], x[1], x[2]]).unwrap();
        let ([u, v, depth], [u2, v2, deeper]) = (of(x), of(at));
        assert!((u - u2).abs() < 1e-9 && (v - v2).abs() < 1e-9, "({u}, {v}) became ({u2}, {v2})");
        // tangents of angles, right and up
        let [mu, mv, _] = own.project(middle).unwrap();
        let wanted = depth * (1.1 + 0.4 * (u - mu) / own.fx + 0.3 * (v - mv) / own.fy);
        assert!((deeper - wanted).abs() < 1e-9, "{deeper}, not {wanted} m away");
    }
    let free = Free::NOTHING.with_depth_shear(&problem.law).with_distance(&problem.law).with_pitch(&problem.law);
    for problem in [&problem, &problem.flying()] {
        let at = |depth| problem.linearise(&sheared(depth), free, FRAMES, &mut Substeps::default()).unwrap();
        let here = at([0.2, -0.1, 0.05, 0.15]);
        for axis in 0..4 {
            let [plus, minus] = [1e-6, -1e-6].map(|step| {
                let mut depth = [0.2, -0.1, 0.05, 0.15];
                depth[axis] += step;
                at(depth).loss
            });
            let difference = (plus - minus) / 2e-6;
            let found = here.gradient[axis];
            assert!((found - difference).abs() < 1e-5 * difference.abs(), "axis {axis}: {found}, {difference}");
        }
        let taped = problem
            .evaluate(&sheared([0.2, -0.1, 0.05, 0.15]), Free::Velocity, FRAMES, &mut Substeps::default())
            .unwrap()
            .0;
        assert!((here.loss - taped).abs() < 1e-12 * taped && here.loss > 1e-4, "{} {taped}", here.loss);
    }
}
