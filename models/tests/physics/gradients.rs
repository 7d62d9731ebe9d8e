//! Gradients of a rollout through contact against central differences.

use gradreel::scalar::Mat3;
use gradreel_models::physics::{Given, Law, Material, Parameter, Point, Remat};

use crate::scene_tape::Drop;

/// Compares the gradient along some directions of one input with central differences of the loss.
fn check(drop: &Drop, input: usize, name: &str, step: f64) {
    let (_, motion, gradients) = drop.clone().run(Remat::None, false).unwrap();
    assert!(motion.iter().skip(1).step_by(3).any(|&y| y < 0.05), "the body must touch the ground");
    let gradient = &gradients[input];
    for direction in 0..3 {
        let along: Vec<f64> =
            (0..gradient.len()).map(|i| (2.1 * i as f64 + f64::from(direction) + 0.5).sin()).collect();
        let loss = |by: f64| {
            let mut moved = drop.clone();
            for (value, along) in moved.inputs()[input].iter_mut().zip(&along) {
                *value += by * along;
            }
            moved.run(Remat::None, false).unwrap().0
        };
        // Fourth order: the loss is smooth but not nearly linear.
        let difference = (8.0 * (loss(step) - loss(-step)) - (loss(2.0 * step) - loss(-2.0 * step))) / (12.0 * step);
        let found: f64 = gradient.iter().zip(&along).map(|(g, a)| g * a).sum();
        approx::assert_relative_eq!(found, difference, max_relative = 1e-6);
        println!("{name}: {found:.12e} and {difference:.12e}");
    }
}

#[test]
fn one_value_for_all_particles() {
    let drop = Drop::new(4);
    check(&drop, 0, "positions", 1e-6);
    check(&drop, 1, "velocity", 1e-5);
    check(&drop, 2, "density", 1e-2);
    check(&drop, 3, "young", 2.0);
    check(&drop, 4, "poisson", 1e-5);
}

#[test]
fn one_value_per_particle() {
    let mut drop = Drop::new(4);
    let n = drop.positions.len() / 3;
    let each = |middle: f64, spread: f64| (0..n).map(|p| middle + spread * (1.3 * p as f64).sin()).collect::<Vec<_>>();
    drop.velocity = (0..3 * n).map(|i| [0.3, -2.0, 0.1][i % 3] + 0.1 * (0.7 * i as f64).cos()).collect();
    drop.density = each(1000.0, 200.0);
    drop.young = each(2e5, 5e4);
    drop.poisson = each(0.3, 0.08);
    check(&drop, 1, "velocity", 1e-5);
    check(&drop, 2, "density", 1e-2);
    check(&drop, 3, "young", 2.0);
    check(&drop, 4, "poisson", 1e-5);
}

#[test]
fn single_precision_follows_double_precision() {
    let (loss, _, wanted) = Drop::new(5).run(Remat::None, false).unwrap();
    let (single_loss, _, found) = Drop::new(5).run(Remat::None, true).unwrap();
    approx::assert_relative_eq!(single_loss, loss, max_relative = 1e-5);
    for (index, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
        crate::scene::close_norm(&format!("input {index}"), found, wanted, 1e-3);
    }
}

/// A fluid: forgets shear (return map), resists compression, and is viscous (stress of the velocity gradient).
#[derive(Debug)]
struct Syrup;

impl Material for Syrup {
    fn name(&self) -> &str {
        "syrup"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![Parameter::log10("bulk", "K", "Pa", [1e3, 1e6]), Parameter::log10("viscosity", "η", "Pa s", [1.0, 1e3])]
    }

    fn return_map(&self, point: &Point, _: &Given) -> Option<Mat3> {
        Some(Mat3::eye() * point.f.det().powf(1.0 / 3.0))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        Mat3::eye() * (given["bulk"] * point.f.det().ln()) + (point.c + point.c.t()) * given["viscosity"]
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        (values[0] / density).sqrt()
    }
}

#[test]
fn a_law_of_the_users_own_with_return_map_and_viscosity() {
    let mut drop = Drop::new(4);
    drop.law = Law::of(Syrup);
    (drop.young, drop.poisson) = (vec![2e5], vec![30.0]);
    check(&drop, 0, "positions", 1e-6);
    check(&drop, 1, "velocity", 1e-5);
    check(&drop, 2, "density", 1e-2);
    check(&drop, 3, "bulk", 2.0);
    check(&drop, 4, "viscosity", 1e-3);
}
