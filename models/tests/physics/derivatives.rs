//! Forward mode against central differences, and reverse mode against forward mode, through every kind of contact and
//! transfer and for materials of every kind.

use gradreel_models::physics::{Collider, Contact, Law, Remat, Schedule, World, materials};

use crate::plain_scene::PlainScene;
use crate::scene::cube;

const DX: f64 = 0.04;

fn named(name: &str) -> Law {
    materials::find(name).unwrap()
}

/// A direction that changes one input, or all where `only` is none, in proportion to their size.
fn direction(scene: &PlainScene, only: Option<usize>, phase: f64) -> Vec<Vec<f64>> {
    let size = |index: usize, value: f64| if index < 2 { if index == 0 { 0.01 } else { 1.0 } } else { value.abs() };
    let all = scene.values.iter().enumerate().map(|(index, values)| {
        let wave = |(i, &value): (usize, &f64)| size(index, value) * (2.1 * i as f64 + index as f64 + phase).sin();
        match only {
            Some(only) if only != index => vec![0.0; values.len()],
            _ => values.iter().enumerate().map(wave).collect(),
        }
    });
    all.collect()
}

fn moved(scene: &PlainScene, direction: &[Vec<f64>], by: f64) -> Vec<f64> {
    let mut moved = scene.clone();
    for (values, along) in moved.values.iter_mut().zip(direction) {
        values.iter_mut().zip(along).for_each(|(value, along)| *value += by * along);
    }
    moved.motion().unwrap()
}

fn norm(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Checks each input by itself, several at once in forward mode; `steps` scales the differences, relative to the values.
#[track_caller]
fn check(what: &str, scene: &PlainScene, step: f64, tolerance: f64) {
    let directions: Vec<_> = (0..scene.values.len()).map(|input| direction(scene, Some(input), 0.5)).collect();
    let (motion, changes) = scene.jvp(&directions).unwrap();
    let weights: Vec<f64> = (0..motion.len()).map(|i| (0.3 * i as f64).sin() + 0.2).collect();
    let (same, gradients) = scene.vjp(&weights, Remat::Every(7)).unwrap();
    assert_eq!(motion, same, "{what}: both modes simulate alike");
    for (input, (direction, change)) in directions.iter().zip(&changes).enumerate() {
        let name = scene.names[input];
        let at = |by: f64| moved(scene, direction, by * step);
        let (near, far) = ([at(1.0), at(-1.0)], [at(2.0), at(-2.0)]);
        let difference = |i: usize| (8.0 * (near[0][i] - near[1][i]) - (far[0][i] - far[1][i])) / (12.0 * step);
        let error = norm((0..change.len()).map(|i| change[i] - difference(i))) / norm(change.iter().copied());
        let along: f64 = change.iter().zip(&weights).map(|(d, w)| d * w).sum();
        let reverse: f64 = gradients[input].iter().zip(&direction[input]).map(|(g, d)| g * d).sum();
        println!("{what}, {name}: forward mode off by {error:.1e}, reverse {reverse:.12e} and {along:.12e}");
        assert!(norm(change.iter().copied()) > 0.0, "{what}: {name} has no effect");
        assert!(error < tolerance, "{what}, {name}: forward mode differs from differences by {error:.2e}");
        let scale = norm(change.iter().copied()) * norm(weights.iter().copied());
        assert!((along - reverse).abs() < 1e-9 * scale, "{what}, {name}: {reverse:.12e} is not {along:.12e}");
    }
}

fn schedule() -> Schedule {
    Schedule { frames: 4, frame_dt: 6e-3, substeps: 24 }
}

fn falling(world: World, friction: &[f64], materials: &[(Law, &[f64])]) -> PlainScene {
    let positions = cube(4, DX, [0.013, 0.047, -0.021]);
    PlainScene::new(world, schedule(), &positions, &[0.9, -2.0, 0.1], friction, materials)
}

#[test]
fn sticky_ground() {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    check("ground", &falling(world, &[], &[(named("neo_hookean"), &[2e5, 0.3])]), 1e-5, 1e-6);
}

#[test]
fn friction_of_the_ground_and_of_a_moving_ball() {
    let ball = Collider::sphere([0.16, 0.09, 0.0], 0.05, Contact::Friction(0.1)).moving([-0.5, 0.2, 0.0]);
    let colliders = vec![Collider::plane([0.0; 3], [0.1, 1.0, 0.05], Contact::Friction(0.4)), ball];
    let world = World { colliders, ..World::new(DX) };
    check("friction", &falling(world.clone(), &[0.4, 0.1], &[(named("neo_hookean"), &[2e5, 0.3])]), 1e-6, 1e-5);
    // One coefficient for both; reverse mode adds up what it does to each.
    check("shared friction", &falling(world, &[0.3], &[(named("neo_hookean"), &[2e5, 0.3])]), 1e-6, 1e-5);
}

#[test]
fn containers_and_turning_blades() {
    let blade = Collider::cuboid([0.0, 0.0, 0.0], [0.3, 0.04, 0.2], Contact::Slip);
    let colliders = vec![
        Collider::cuboid([0.1, 0.2, 0.0], [0.15, 0.2, 0.15], Contact::Separate).container(),
        blade.spinning([0.0, 0.0, 3.0], [0.0; 3]),
    ];
    let world = World { colliders, ..World::new(DX) };
    check("containers", &falling(world, &[], &[(named("fixed_corotated"), &[2e5, 0.3])]), 1e-6, 1e-5);
}

#[test]
fn the_blend_with_flip() {
    for (flip, friction) in [(0.6, [0.3]), (1.0, [0.2])] {
        let colliders = vec![Collider::plane([0.0; 3], [0.1, 1.0, 0.05], Contact::Friction(0.3))];
        let world = World { colliders, flip, ..World::new(DX) };
        check("flip", &falling(world, &friction, &[(named("neo_hookean"), &[2e5, 0.3])]), 1e-6, 1e-5);
    }
}

#[test]
fn materials_that_yield_flow_and_remember() {
    let ground = || World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    for (name, values) in [
        ("von_mises", &[2e5, 0.3, 2e3][..]),
        ("viscoplastic", &[5e4, 1e5, 5e2, 20.0]),
        ("kelvin_voigt", &[2e5, 0.3, 1e-3]),
        ("newtonian", &[20.0, 1e5]),
        ("drucker_prager", &[2e5, 0.3, 30.0, 1e-4]),
        ("snow", &[2e5, 0.2, 0.025, 0.0075, 10.0]),
    ] {
        check(name, &falling(ground(), &[], &[(named(name), values)]), 1e-7, 1e-3);
    }
}

#[test]
fn two_materials_and_values_per_particle() {
    let world = World { colliders: vec![Collider::ground(0.0)], flip: 0.3, ..World::new(DX) };
    let mut scene = falling(world, &[], &[(named("von_mises"), &[2e5, 0.3, 2e3]), (named("neo_hookean"), &[1e5, 0.2])]);
    let n = scene.values[0].len() / 3;
    scene.material_of = Some((0..n).map(|p| u32::from(scene.values[0][3 * p + 1] > 0.08)).collect());
    scene.values[1] = (0..3 * n).map(|i| [0.3, -2.0, 0.1][i % 3] + 0.1 * (0.7 * i as f64).cos()).collect();
    scene.values[2] = (0..n).map(|p| 1000.0 + 200.0 * (1.3 * p as f64).sin()).collect();
    scene.values[4] = (0..n).map(|p| 2e5 + 5e4 * (1.3 * p as f64).sin()).collect();
    check("two materials", &scene, 1e-7, 1e-4);
}

#[test]
fn tangents_that_do_not_fit_are_refused() {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    let scene = falling(world, &[], &[(named("neo_hookean"), &[2e5, 0.3])]);
    let mut short = direction(&scene, None, 0.0);
    short.pop();
    assert!(scene.jvp(&[short]).unwrap_err().to_string().contains("another number of tangents"));
    let mut wide = direction(&scene, None, 0.0);
    wide[2] = vec![1.0; 2];
    assert!(scene.jvp(&[wide]).unwrap_err().to_string().contains("does not fit"));
    let mut nan = direction(&scene, None, 0.0);
    nan[4] = vec![f64::NAN];
    assert!(scene.jvp(&[nan]).unwrap_err().to_string().contains("tangent of young"));
    // Friction that nothing has.
    let mut rough = scene.clone();
    rough.names.insert(4, "friction");
    rough.values.insert(4, vec![0.3]);
    assert!(rough.motion().unwrap_err().to_string().contains("nothing has friction"));
}
