//! Shapes hold as much as geometry says.

use std::f64::consts::PI;
use std::path::Path;

use gradreel::Tensor;
use gradreel::io::npy;
use gradreel_models::scenes::{Mesh, Shape, body, fill};

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
    assert!(refused(Shape::Torus { centre_m, ring_radius_m: 0.2, tube_radius_m: 1e-12 }).contains("holds no particle"));
    assert!(refused(Shape::Box { centre_m, size_m: [1e3; 3] }).contains("too large for this grid"));
    let missing = Shape::Mesh { file: "missing.obj".into(), scale: 1.0, translate_m: [0.0; 3] };
    assert!(refused(missing).contains("missing.obj"));
}

/// What the particles of a shape fill together \[m³\].
fn filled(shape: &Shape, spacing: f64) -> f64 {
    let body = body(shape, spacing, 3, Path::new(".")).unwrap();
    assert!(!body.positions.is_empty());
    body.positions.len() as f64 * body.volume
}

#[test]
fn shapes_smaller_than_the_spacing_hold_their_volume_too() {
    let centre_m = [0.3, -0.2, 0.1];
    for (shape, wanted) in [
        (Shape::Sphere { centre_m, radius_m: 0.005 }, 4.0 / 3.0 * PI * 0.005_f64.powi(3)),
        (Shape::Sphere { centre_m, radius_m: 0.031 }, 4.0 / 3.0 * PI * 0.031_f64.powi(3)),
        (Shape::Box { centre_m, size_m: [0.5, 0.001, 0.3] }, 0.00015),
        (Shape::Box { centre_m, size_m: [0.015, 0.025, 0.035] }, 0.015 * 0.025 * 0.035),
        (Shape::Cylinder { centre_m, radius_m: 0.002, height_m: 0.4 }, PI * 4e-6 * 0.4),
        (Shape::Cone { centre_m, radius_m: 0.01, height_m: 0.01 }, PI * 1e-6 / 3.0),
        (Shape::Torus { centre_m, ring_radius_m: 0.1, tube_radius_m: 0.003 }, 2.0 * PI * PI * 0.1 * 9e-6),
    ] {
        approx::assert_relative_eq!(filled(&shape, 0.02), wanted, max_relative = 1e-9);
    }
}

#[test]
fn a_thin_plate_is_full_of_particles_and_none_lies_outside() {
    let shape = Shape::Box { centre_m: [0.0; 3], size_m: [0.4, 0.002, 0.4] };
    let plate = body(&shape, 0.02, 1, Path::new(".")).unwrap();
    assert_eq!((plate.positions.len(), plate.finer), (400, 1));
    assert!(plate.positions.iter().all(|x| x[1].abs() <= 0.001 && x[0].abs() <= 0.2 && x[2].abs() <= 0.2));
}

#[test]
fn a_torus_through_itself_counts_what_it_covers_twice_once() {
    // a tube as wide as it is far from the axis and more: the ball of its outermost circle, but for the dents at the poles
    let (ring, tube) = (0.01_f64, 0.05_f64);
    let found = filled(&Shape::Torus { centre_m: [0.0; 3], ring_radius_m: ring, tube_radius_m: tube }, 0.02);
    // by discs across the axis: the outer circle alone bounds them
    let discs = (0..20_000).map(|k| {
        let y = -tube + (f64::from(k) + 0.5) * tube / 1e4;
        PI * (ring + (tube * tube - y * y).sqrt()).powi(2) * tube / 1e4
    });
    // the hole around the axis near the poles, which the tube does not cover
    let holes = (0..20_000).map(|k| {
        let y = -tube + (f64::from(k) + 0.5) * tube / 1e4;
        PI * (ring - (tube * tube - y * y).sqrt()).max(0.0).powi(2) * tube / 1e4
    });
    let wanted = discs.sum::<f64>() - holes.sum::<f64>();
    approx::assert_relative_eq!(found, wanted, max_relative = 0.02);
}

/// An OBJ of two boxes of these corners.
fn boxes(all: &[[[f64; 3]; 2]]) -> String {
    let mut text = String::new();
    for (at, [low, high]) in all.iter().enumerate() {
        for corner in 0..8 {
            let x = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] });
            text += &format!("v {} {} {}\n", x[0], x[1], x[2]);
        }
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            let corners = face.map(|corner| (8 * at + corner + 1).to_string());
            text += &format!("f {}\n", corners.join(" "));
        }
    }
    text
}

#[test]
fn small_meshes_hold_their_volume_and_parts_that_overlap_count_once() {
    let folder = tempfile::TempDir::new().unwrap();
    let filled = |name: &str, all: &[[[f64; 3]; 2]]| {
        std::fs::write(folder.path().join(name), boxes(all)).unwrap();
        let mesh = Mesh::from_bytes(boxes(all).as_bytes(), "obj").unwrap();
        let shape = Shape::Mesh { file: name.into(), scale: 1.0, translate_m: [0.0; 3] };
        let body = body(&shape, 0.02, 3, folder.path()).unwrap();
        (body.positions.len() as f64 * body.volume, mesh.volume().abs())
    };
    let (small, enclosed) = filled("small.obj", &[[[0.0; 3], [0.004, 0.006, 0.005]]]);
    approx::assert_relative_eq!(enclosed, 1.2e-7, max_relative = 1e-9);
    approx::assert_relative_eq!(small, 1.2e-7, max_relative = 1e-9);
    // two boxes of 0.1 × 0.1 × 0.2 that share half of each
    let (both, twice) = filled("both.obj", &[[[0.0; 3], [0.1, 0.1, 0.2]], [[0.0, 0.0, 0.1], [0.1, 0.1, 0.3]]]);
    approx::assert_relative_eq!(twice, 0.004, max_relative = 1e-9);
    approx::assert_relative_eq!(both, 0.003, max_relative = 0.02);
}

#[test]
fn particles_of_a_file_share_the_cube_in_which_they_are() {
    let folder = tempfile::TempDir::new().unwrap();
    let filled = |name: &str, spacing: f64, count: i32| {
        let numbers: Vec<f64> = (0..count.pow(3))
            .flat_map(|k| [k / count / count, k / count % count, k % count])
            .map(|k| spacing * (f64::from(k) + 0.5))
            .collect();
        let array = Tensor::from_vec(numbers, [count.pow(3) as usize, 3]);
        std::fs::write(folder.path().join(name), npy::to_bytes(&array).unwrap()).unwrap();
        filled_at(&Shape::Particles { file: name.into(), scale: 1.0, translate_m: [0.0; 3] }, folder.path())
    };
    // a block of 0.2 m, at the spacing of the grid and at a quarter of it
    approx::assert_relative_eq!(filled("usual.npy", 0.02, 10), 0.008, max_relative = 1e-9);
    approx::assert_relative_eq!(filled("dense.npy", 0.005, 40), 0.008, max_relative = 1e-9);
}

fn filled_at(shape: &Shape, folder: &Path) -> f64 {
    let body = body(shape, 0.02, 3, folder).unwrap();
    body.positions.len() as f64 * body.volume
}
