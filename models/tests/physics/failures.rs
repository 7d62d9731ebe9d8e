//! Simulations that cannot work, and what the user reads then.

use gradreel::{Error, ErrorKind, Tape, Tensor};
use gradreel_models::physics::{Law, Remat, Rollout, Schedule, materials::NeoHookean};

use crate::scene_tape::Drop;

#[track_caller]
fn refused(drop: Drop, kind: ErrorKind, words: &[&str]) -> Error {
    let error = drop.run(Remat::None, false).expect_err("this rollout cannot work");
    let text = error.to_string();
    assert_eq!(error.kind(), kind, "{text}");
    for word in words {
        assert!(text.contains(word), "'{word}' is missing in:\n{text}");
    }
    error
}

#[test]
fn a_substep_above_the_wave_speed_bound_does_not_start() {
    let mut drop = Drop::new(3);
    drop.young = vec![5e9];
    refused(drop, ErrorKind::Physics, &["substep is too long", "neo_hookean", "m/s", "at least", "instead of 24"]);
}

#[test]
fn a_material_that_no_number_of_substeps_could_follow_is_refused_with_the_number() {
    let mut drop = Drop::new(3);
    drop.young = vec![1e30];
    // never "at least so many instead of so many"
    let error = refused(drop, ErrorKind::Input, &["too stiff for this grid", "substeps per frame", "at most 1048576"]);
    assert!(!error.to_string().contains("instead of"), "{error}");
}

#[test]
fn a_particle_that_crosses_a_cell_is_named() {
    let mut drop = Drop::new(3);
    drop.velocity = vec![0.0, 0.0, 200.0];
    refused(drop, ErrorKind::Physics, &["crosses a cell", "particle 0", "substep 0", "position", "e2 m/s", "0.04 m"]);
}

#[test]
fn an_inverted_particle_is_named() {
    let mut drop = Drop::new(8);
    // Two halves shot at each other, so fast that the second substep turns particles between them inside out.
    let towards_middle = |x: f64| if x > 0.1 { -150.0 } else { 150.0 };
    drop.velocity = drop.positions.chunks(3).flat_map(|x| [towards_middle(x[0]), 0.0, 0.0]).collect();
    drop.young = vec![10.0];
    refused(drop, ErrorKind::Physics, &["unstable", "particle", "substep 1", "det F is -"]);
}

#[test]
fn a_particle_outside_the_bounds_is_named() {
    let mut drop = Drop::new(3);
    drop.world.bounds = Some([[-1.0, 0.0, -1.0], [1.0, 1.0, 0.03]]);
    drop.velocity = vec![0.0, 0.0, 2.0];
    refused(drop, ErrorKind::Physics, &["left the world's bounds", "particle", "substep", "position"]);
}

#[test]
fn particles_too_far_apart_do_not_exhaust_the_memory() {
    let mut drop = Drop::new(3);
    drop.positions[0] = 1e4;
    drop.positions[4] = 1e4;
    refused(drop, ErrorKind::Physics, &["too far apart", "nodes"]);
    let mut drop = Drop::new(3);
    drop.positions[0] = 1e30;
    refused(drop, ErrorKind::Physics, &["too far apart"]);
}

#[test]
fn numbers_that_are_not_finite_are_found() {
    let names = ["positions", "velocity", "density", "young", "poisson"];
    for (index, name) in names.into_iter().enumerate() {
        for value in [f64::NAN, f64::INFINITY] {
            let mut drop = Drop::new(3);
            drop.inputs()[index][0] = value;
            refused(drop, ErrorKind::NonFinite, &[name]);
        }
    }
}

#[test]
fn a_world_or_schedule_without_sense_is_refused() {
    let mut drop = Drop::new(3);
    drop.world.dx = 0.0;
    refused(drop, ErrorKind::Input, &["grid spacing"]);
    let mut drop = Drop::new(3);
    drop.schedule = Schedule { substeps: 0, ..drop.schedule };
    refused(drop, ErrorKind::Input, &["schedule"]);
    let mut drop = Drop::new(3);
    drop.density = vec![-1000.0];
    refused(drop, ErrorKind::Input, &["density"]);
}

#[test]
fn shapes_that_do_not_fit_are_explained() {
    let mut drop = Drop::new(3);
    drop.density = vec![1000.0; 2];
    refused(drop, ErrorKind::Shape, &["density", "[1] or [27]"]);
}

#[test]
fn a_gradient_that_is_not_finite_is_named() {
    let drop = Drop::new(3);
    let error = drop.run_weighted(Remat::None, false, |i| if i == 100 { f64::NAN } else { 1.0 }).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite, "{error}");
    assert!(error.to_string().contains("gradient of positions"), "{error}");
}

#[test]
fn a_rollout_that_kept_nothing_has_no_gradient() {
    let (drop, tape) = (Drop::new(3), Tape::new());
    let leaf = |values: Vec<f64>, shape: &[usize]| tape.leaf(Tensor::from_vec(values, shape));
    let laws = vec![Law::of(NeoHookean)];
    let op = Rollout {
        world: drop.world,
        laws,
        material_of: None,
        gravity: false,
        friction: false,
        schedule: drop.schedule,
        remat: None,
    };
    let positions = leaf(drop.positions, &[27, 3]);
    let others = [drop.density, drop.young, drop.poisson].map(|values| leaf(values, &[1]));
    let velocity = leaf(drop.velocity, &[3]);
    let motion = positions.apply(op, &[&velocity, &others[0], &others[1], &others[2]]).unwrap();
    let error = motion.sum_all().backward().err().unwrap();
    assert_eq!(error.kind(), ErrorKind::NoGradient, "{error}");
}

#[test]
fn nobody_to_simulate_is_no_fault() {
    let drop = Drop { positions: Vec::new(), ..Drop::new(1) };
    let (loss, motion, gradients) = drop.run(Remat::default(), true).unwrap();
    assert_eq!((loss, motion.len()), (0.0, 0));
    assert_eq!(gradients, vec![vec![], vec![0.0; 3], vec![0.0], vec![0.0], vec![0.0]]);
}
