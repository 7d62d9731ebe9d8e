//! The likelihood's expansion against a walk through it, and what the pictures do not show.

use gradreel::{DType, Tensor};

use super::scene::{block, film, problem, quick, search};
use crate::identify::model::linearise::Derivatives;
use crate::identify::uncertainty::covariance::Expansion;
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Free, Linearised, Observed, Problem, Substeps, Unknowns};

/// Adds an independent error to every value of every pixel.
fn noisy(mut observed: Observed, deviation: f32, seed: u64) -> Observed {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    for target in &mut observed.targets {
        let values = target.rgba.slice::<f32>();
        // the sum of twelve uniform numbers is normal enough
        let values = values.iter().map(|v| v + deviation * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)).collect();
        target.rgba = Tensor::from_vec(values, target.rgba.shape());
    }
    observed
}

const FLOOR: f64 = 1e-7;

/// The expansion of the likelihood at a point.
fn expanded(problem: &Problem<'_>, at: &Unknowns, free: Free, frames: usize) -> Expansion {
    let each = problem.linearise_frames(at, free, 0..frames, Derivatives::Exact, &mut Substeps::default()).unwrap();
    let Linearised { loss, gradient, curvature } = Linearised::mean_log(&each, FLOOR);
    let pictures = frames * problem.observed.views.len();
    Expansion { x: at.coordinates(&problem.law, free), log_loss: loss, gradient, curvature, pictures }
}

#[test]
fn the_width_of_a_posterior_is_that_of_a_walk_through_it() {
    const FRAMES: usize = 7;
    let config = quick();
    let particles = block(5, 0.04);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let free = Free::Magnitudes;
    for seed in 1..=4 {
        let observed = noisy(film(&particles, &truth, &config, FRAMES, 20, DType::F32), 0.05, seed);
        let problem = problem(&particles, &observed, &config, DType::F32);
        let prior = Prior::of(&problem.law, free, &truth, None);
        let start = Unknowns { parameters: vec![5e4, 0.3], ..truth.clone() };
        let best = search(super::scene::problem(&particles, &observed, &config, DType::F32), &[start], free, FRAMES, 8)
            .remove(0);
        let residuals = 100.0;
        // to the bottom, where a search ends near
        let mut bottom = best.unknowns;
        for _ in 0..3 {
            let mean = expanded(&problem, &bottom, free, FRAMES).posterior(&prior, &[], residuals).unwrap().mean;
            bottom = bottom.moved(&problem.law, free, &mean);
        }
        let at = expanded(&problem, &bottom, free, FRAMES);
        let laplace = at.posterior(&prior, &[], residuals).unwrap();
        let deviation = laplace.covariance[0][0].sqrt();
        // one standard deviation away the posterior has fallen by half a unit of its logarithm
        let substeps = problem.schedule(&bottom, FRAMES).substeps;
        let cost = |off: f64| {
            let x = [at.x[0] + off];
            let there = bottom.moved(&problem.law, free, &x);
            let each = problem
                .linearise_frames(&there, Free::NOTHING, 0..FRAMES, Derivatives::Exact, &mut Substeps::least(substeps))
                .unwrap();
            let log_loss = Linearised::mean_log(&each, FLOOR).loss;
            0.5 * residuals * at.pictures as f64 * log_loss + prior.cost(&x).0
        };
        let here = cost(0.0);
        let side = |sign: f64| {
            let (mut near, mut far) = (0.0, 0.3);
            for _ in 0..12 {
                let middle = 0.5 * (near + far);
                if cost(sign * middle) - here > 0.5 { far = middle } else { near = middle }
            }
            near
        };
        let walked = 0.5 * (side(1.0) + side(-1.0));
        assert!((0.7..1.4).contains(&(deviation / walked)), "seed {seed}: {deviation} by Laplace, {walked} by a walk");
        let off = (truth.coordinates(&problem.law, free)[0] - laplace.mean[0]).abs();
        assert!(off < 4.0 * deviation, "seed {seed}: the truth is {} deviations away", off / deviation);
    }
}

#[test]
fn what_does_not_touch_the_ground_keeps_its_prior() {
    let config = quick();
    let particles = block(4, 0.05);
    let truth = Unknowns { velocity: [0.3, 0.5, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = noisy(film(&particles, &truth, &config, 3, 16, DType::F32), 0.02, 3);
    let problem = problem(&particles, &observed, &config, DType::F32);
    let prior = Prior::of(&problem.law, Free::Both, &truth, None);
    let laplace = expanded(&problem, &truth, Free::Both, 3).posterior(&prior, &[], 100.0).unwrap();
    for (k, prior) in prior.deviations().into_iter().enumerate() {
        let share = laplace.covariance[k][k].sqrt() / prior;
        if k < 3 {
            assert!(share < 0.05, "velocity {k}: {share} of the prior's deviation");
        } else {
            assert!(share > 0.95, "parameter {k}: {share} of the prior's deviation");
        }
    }
}
