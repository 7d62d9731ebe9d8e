//! Rollouts on a GPU against rollouts on the CPU in double precision: every material, every obstacle, mixtures; the same bits
//! every time; what goes wrong.

use gradreel::{DType, Device, ErrorKind, Result, Tensor};
use gradreel_models::physics::{Collider, Contact, Law, Remat, Schedule, World, materials};

use super::device;
use crate::plain_scene::PlainScene;
use crate::scene::{close, close_norm, cube};

const DX: f64 = 0.04;

type Found = (Vec<f64>, Vec<Vec<f64>>);

fn weights(scene: &PlainScene) -> Vec<f64> {
    (0..scene.schedule.frames * scene.values[0].len()).map(|i| (0.3 * i as f64).sin() + 0.2).collect()
}

fn on(device: &Device, dtype: DType, scene: &PlainScene, remat: Remat) -> Result<Found> {
    scene.vjp_on(device, dtype, &weights(scene), remat)
}

/// Compares motion \[m\] and gradients with those of the CPU in double precision.
#[track_caller]
fn agrees(what: &str, scene: &PlainScene, motion: f64, gradient: f64) {
    let Some(device) = device() else { return };
    let found = on(&device, DType::F32, scene, Remat::Every(7)).unwrap_or_else(|error| panic!("{what}: {error}"));
    let wanted = on(&Device::Cpu, DType::F64, scene, Remat::default()).unwrap();
    close(&format!("{what}: motion"), &found.0, &wanted.0, motion);
    for ((name, found), wanted) in scene.names.iter().zip(&found.1).zip(&wanted.1) {
        close_norm(&format!("{what}: {name}"), found, wanted, gradient);
    }
}

fn drop_of(law: &Law, world: World, side: usize) -> PlainScene {
    let values: Vec<f64> = law.parameters().iter().map(|parameter| parameter.start).collect();
    let sound = law.wave_speed_on(&values, 1000.0, DX);
    let schedule = Schedule::stable(&world, 2, 16.0 * 0.4 * DX / (sound + 2.0), sound, 2.0, 0.4);
    let x = cube(side, DX, [0.013, 0.004, -0.021]);
    PlainScene::new(world, schedule, &x, &[0.3, -2.0, 0.1], &[], &[(law.clone(), &values)])
}

#[test]
fn every_material_moves_as_on_the_cpu() {
    for law in materials::all() {
        let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
        agrees(law.name(), &drop_of(&law, world, 4), 5e-7, 2e-3);
    }
}

/// A tank, a ramp, a rod, a moving ball and a turning box: all regions, all contacts.
fn playground(contact: Contact) -> Vec<Collider> {
    vec![
        Collider::cuboid([0.05, 0.08, 0.02], [0.13, 0.09, 0.14], contact).container(),
        Collider::plane([0.0, 0.01, 0.0], [0.3, 1.0, -0.1], contact),
        Collider::cylinder([-0.1, 0.03, 0.05], [0.2, 0.04, 0.05], 0.035, contact),
        Collider::sphere([0.05, 0.02, -0.03], 0.045, contact).moving([0.4, 0.3, 0.0]),
        Collider::cuboid([0.12, 0.05, 0.05], [0.05, 0.03, 0.05], contact)
            .turned([0.0, 0.0, 0.4], [0.12, 0.05, 0.05])
            .spinning([0.0, 3.0, 5.0], [0.12, 0.05, 0.05]),
        Collider::cylinder([0.05, -0.02, 0.02], [0.05, 0.3, 0.02], 0.17, contact).container(),
        Collider::sphere([0.05, 0.1, 0.02], 0.19, contact).container(),
    ]
}

#[test]
fn every_obstacle_acts_as_on_the_cpu() {
    let law = materials::find("neo_hookean").unwrap();
    for contact in [Contact::Sticky, Contact::Slip, Contact::Separate, Contact::Friction(0.3)] {
        let rough = matches!(contact, Contact::Friction(_));
        let world = World { colliders: playground(contact), ..World::new(DX) };
        let friction: Vec<f64> = if rough { (0..7).map(|k| 0.2 + 0.05 * f64::from(k)).collect() } else { vec![] };
        let schedule = Schedule { frames: 3, frame_dt: 4e-3, substeps: 16 };
        let x = cube(5, DX, [0.0, 0.012, -0.021]);
        let scene = PlainScene::new(world, schedule, &x, &[0.5, -2.0, 0.3], &friction, &[(law.clone(), &[2e5, 0.3])]);
        agrees(&format!("{contact:?}"), &scene, 1e-6, 5e-3);
        if rough {
            let (_, gradients) = scene.vjp(&weights(&scene), Remat::default()).unwrap();
            assert!(gradients[4].iter().filter(|g| g.abs() > 1e-5).count() >= 4, "obstacles that nothing touches");
        }
    }
}

/// Snow, plasticine and rubber in thirds of a block, none sorted; half of the values are given for each particle.
fn pile() -> PlainScene {
    let x = cube(5, DX, [0.013, 0.03, -0.021]);
    let given: [(&str, &[f64]); 3] =
        [("snow", &[1e5, 0.2, 0.025, 0.0075, 10.0]), ("von_mises", &[2e5, 0.3, 2e3]), ("neo_hookean", &[3e5, 0.35])];
    let laws: Vec<(Law, &[f64])> =
        given.iter().map(|(name, values)| (materials::find(name).unwrap(), *values)).collect();
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    let schedule = Schedule { frames: 3, frame_dt: 3e-3, substeps: 20 };
    let mut scene = PlainScene::new(world, schedule, &x, &[0.3, -2.0, 0.1], &[], &laws);
    scene.material_of = Some((0..x.len() as u32).map(|p| p * 7 % 3).collect());
    for (k, values) in scene.values.iter_mut().enumerate().skip(2).step_by(2).filter(|(k, _)| *k != 3) {
        *values = (0..x.len()).map(|p| values[0] * (1.0 + 0.1 * (p as f64 + k as f64).sin())).collect();
    }
    scene.values[1] = (0..x.len()).flat_map(|p| [0.3, -2.0, 0.1 * (p as f64).sin()]).collect();
    scene
}

#[test]
fn mixtures_move_as_on_the_cpu() {
    agrees("pile", &pile(), 1e-6, 5e-3);
}

#[test]
fn the_same_bits_every_time_whatever_is_kept() {
    let Some(device) = device() else { return };
    let bits = |remat: Remat| {
        let (motion, gradients) = on(&device, DType::F32, &pile(), remat).unwrap();
        [motion, gradients.concat()].concat().into_iter().map(f64::to_bits).collect::<Vec<_>>()
    };
    let first = bits(Remat::Every(9));
    for remat in [Remat::Every(9), Remat::None, Remat::Every(1000)] {
        assert!(first == bits(remat), "{remat:?}");
    }
}

#[test]
fn a_grid_that_outgrows_its_room_is_made_larger() {
    // Two bodies that fly apart by some fifteen cells.
    let law = materials::find("neo_hookean").unwrap();
    let halves = [[0.0, 0.0, 0.0], [0.2, 0.1, 0.0]].map(|corner| cube(2, DX, corner)).concat();
    let schedule = Schedule { frames: 3, frame_dt: 6e-3, substeps: 18 };
    let mut scene = PlainScene::new(World::new(DX), schedule, &halves, &[0.0; 3], &[], &[(law, &[1e3, 0.3])]);
    let apart = |p: usize| if p < 8 { [-24.0, -20.0, -20.0] } else { [24.0, 20.0, 20.0] };
    let wobble = |p: usize, axis: usize| 2.0 * (1.3 * (3 * p + axis) as f64).sin();
    scene.values[1] = (0..16).flat_map(|p| [0, 1, 2].map(|axis| apart(p)[axis] + wobble(p, axis))).collect();
    // at these speeds little is left of the digits of the gradient by density
    agrees("apart", &scene, 1e-6, 1e-2);
}

#[track_caller]
fn refused(scene: &PlainScene, kind: ErrorKind, words: &[&str]) {
    let Some(device) = device() else { return };
    let error = on(&device, DType::F32, scene, Remat::default()).expect_err("this rollout cannot work");
    let text = error.to_string();
    assert_eq!(error.kind(), kind, "{text}");
    words.iter().for_each(|word| assert!(text.contains(word), "'{word}' is missing in:\n{text}"));
}

fn rubber() -> PlainScene {
    let law = materials::find("neo_hookean").unwrap();
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
    let schedule = Schedule { frames: 4, frame_dt: 6e-3, substeps: 24 };
    PlainScene::new(
        world,
        schedule,
        &cube(3, DX, [0.013, 0.047, -0.021]),
        &[0.3, -2.0, 0.1],
        &[],
        &[(law, &[2e5, 0.3])],
    )
}

/// The same words as on the CPU; see failures.rs.
#[test]
fn what_goes_wrong_is_named() {
    let mut fast = rubber();
    fast.values[1] = vec![0.0, 0.0, 200.0];
    refused(&fast, ErrorKind::Physics, &["crosses a cell", "particle 0", "substep 0", "position", "e2 m/s", "0.04 m"]);

    let mut narrow = rubber();
    narrow.world.bounds = Some([[-1.0, 0.0, -1.0], [1.0, 1.0, 0.03]]);
    narrow.values[1] = vec![0.0, 0.0, 2.0];
    refused(&narrow, ErrorKind::Physics, &["left the world's bounds", "particle", "substep", "position"]);

    let mut shot = rubber();
    shot.values[0] = cube(8, DX, [0.013, 0.047, -0.021]).into_flattened();
    let towards_middle = |x: f64| if x > 0.1 { -150.0 } else { 150.0 };
    shot.values[1] = shot.values[0].chunks(3).flat_map(|x| [towards_middle(x[0]), 0.0, 0.0]).collect();
    shot.values[4] = vec![10.0];
    refused(&shot, ErrorKind::Physics, &["unstable", "particle", "substep 1", "det F is -"]);

    let mut apart = rubber();
    apart.world.node_limit = 2000;
    apart.values[1] = (0..27).flat_map(|p| if p < 9 { [-100.0, 0.0, 0.0] } else { [100.0, 90.0, 90.0] }).collect();
    apart.values[4] = vec![10.0];
    refused(&apart, ErrorKind::Physics, &["too far apart", "nodes", "World::node_limit"]);

    let mut flip = rubber();
    flip.world.flip = 0.5;
    refused(&flip, ErrorKind::Unsupported, &["FLIP", "to_device(&Device::Cpu)"]);
}

#[test]
fn forward_mode_says_that_it_stays_on_the_cpu() {
    let Some(device) = device() else { return };
    let scene = rubber();
    let there = |(index, values): (usize, &Vec<f64>)| {
        scene.tensor(index, values).cast(DType::F32).unwrap().to_device(&device).unwrap()
    };
    let inputs: Vec<Tensor> = scene.values.iter().enumerate().map(there).collect();
    let error = scene.rollout().jvp(&inputs, &[]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("to_device(&Device::Cpu)"), "{error}");
}

#[test]
fn nobody_to_simulate_is_no_fault() {
    let Some(device) = device() else { return };
    let empty = PlainScene { values: [vec![vec![]], rubber().values[1..].to_vec()].concat(), ..rubber() };
    let (motion, gradients) = on(&device, DType::F32, &empty, Remat::default()).unwrap();
    assert_eq!(motion.len(), 0);
    assert!(gradients.iter().flatten().all(|g| *g == 0.0));
}
