//! The blend of APIC with FLIP: what it keeps and what it changes.

use gradreel_models::physics::{Simulation, State, Values, World, materials};

use crate::scene::cube;

const DX: f64 = 0.04;

/// A free soft cube whose particles all move differently, after some substeps.
fn shaken(flip: f64) -> (State<f64>, State<f64>) {
    let world = World { gravity: [0.0; 3], flip, ..World::new(DX) };
    let law = materials::find("neo_hookean").unwrap();
    let x = cube(6, DX, [0.31, 0.52, -0.17]);
    let v: Vec<_> = (0..x.len()).map(|p| [0, 1, 2].map(|k| (0.37 * p as f64 + 1.3 * k as f64).sin())).collect();
    let parameters = vec![Values::Same(1e4), Values::Same(0.3)];
    let mut simulation = Simulation::new(&world, &law, 2e-4, x.len(), &Values::Same(1000.0), parameters).unwrap();
    let start = simulation.at_rest(&x, &v).unwrap();
    let (mut now, mut next) = (start.clone(), start.zeros_like());
    for _ in 0..50 {
        simulation.substep(&now, &mut next).unwrap();
        std::mem::swap(&mut now, &mut next);
    }
    (start, now)
}

fn momentum(state: &State<f64>) -> [f64; 3] {
    let velocities = state.velocities();
    [0, 1, 2].map(|axis| velocities.iter().map(|v| v[axis]).sum())
}

/// Twice the kinetic energy per mass.
fn energy(state: &State<f64>) -> f64 {
    state.velocities().iter().flatten().map(|v| v * v).sum()
}

#[test]
fn momentum_is_kept_and_less_motion_is_lost_the_more_flip() {
    let mut kept = Vec::new();
    for flip in [0.0, 0.5, 0.95] {
        let (start, end) = shaken(flip);
        for axis in 0..3 {
            approx::assert_abs_diff_eq!(momentum(&start)[axis], momentum(&end)[axis], epsilon = 1e-10);
        }
        kept.push(energy(&end) / energy(&start));
    }
    println!("kinetic energy kept: {kept:?}");
    assert!(kept.is_sorted() && kept[0] < 0.5 && kept[2] > 2.0 * kept[0], "{kept:?}");
}

#[test]
fn a_share_outside_its_range_is_refused() {
    let law = materials::find("neo_hookean").unwrap();
    for flip in [-0.1, 1.1, f64::NAN] {
        let world = World { flip, ..World::new(DX) };
        let parameters = vec![Values::Same(1e4), Values::Same(0.3)];
        let refused = Simulation::new(&world, &law, 2e-4, 1, &Values::Same(1000.0), parameters).unwrap_err();
        assert!(refused.to_string().contains("share of FLIP"), "{refused}");
    }
}
