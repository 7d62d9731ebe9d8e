//! Shapes hold as much as geometry says.

use std::f64::consts::PI;
use std::path::Path;

use gradreel_models::scenes::{Shape, fill};

const SPACING: f64 = 0.01;

fn volume(shape: &Shape) -> f64 {
    fill(shape, SPACING, 3, Path::new(".")).unwrap().len() as f64 * SPACING.powi(3)
}

#[test]
fn primitives_hold_their_volume() {
    let centre_m = [0.3, -0.2, 0.1];
    for (shape, wanted) in [
        (Shape::Box { centre_m, size_m: [0.2, 0.3, 0.1] }, 0.006),
        (Shape::Sphere { centre_m, radius_m: 0.15 }, 4.0 / 3.0 * PI * 0.15_f64.powi(3)),
        (Shape::Cylinder { centre_m, radius_m: 0.1, height_m: 0.2 }, PI * 0.002),
        (Shape::Cone { centre_m, radius_m: 0.15, height_m: 0.2 }, PI * 0.0225 * 0.2 / 3.0),
        (Shape::Torus { centre_m, ring_radius_m: 0.15, tube_radius_m: 0.05 }, 2.0 * PI * PI * 0.15 * 0.0025),
    ] {
        approx::assert_relative_eq!(volume(&shape), wanted, max_relative = 0.015);
    }
}

#[test]
fn particles_lie_inside_and_apart_and_the_seed_decides_where() {
    let shape = Shape::Sphere { centre_m: [0.0; 3], radius_m: 0.05 };
    let at = |seed: u64| fill(&shape, SPACING, seed, Path::new(".")).unwrap();
    let particles = at(1);
    assert_eq!(particles, at(1));
    assert_ne!(particles, at(2));
    for (p, x) in particles.iter().enumerate() {
        assert!(x.iter().map(|x| x * x).sum::<f64>().sqrt() <= 0.05);
        for y in &particles[..p] {
            let distance = (0..3).map(|axis| (x[axis] - y[axis]).powi(2)).sum::<f64>().sqrt();
            assert!(distance > 0.49 * SPACING, "two particles {distance} m apart");
        }
    }
}

#[test]
fn shapes_that_hold_nothing_or_too_much_are_refused() {
    let refused = |shape: Shape| fill(&shape, SPACING, 0, Path::new(".")).unwrap_err().to_string();
    let centre_m = [0.0; 3];
    assert!(refused(Shape::Sphere { centre_m, radius_m: -1.0 }).contains("radius_m"));
    assert!(refused(Shape::Torus { centre_m, ring_radius_m: 0.02, tube_radius_m: 1e-4 }).contains("holds no particle"));
    assert!(refused(Shape::Box { centre_m, size_m: [1e3; 3] }).contains("too large for this grid"));
    let missing = Shape::Mesh { file: "missing.obj".into(), scale: 1.0, translate_m: [0.0; 3] };
    assert!(refused(missing).contains("missing.obj"));
}
