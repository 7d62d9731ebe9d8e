//! How far a block slides down a slope with Coulomb friction, `g (sin a − μ cos a) t²/2`, by the coefficient of friction.

use gradreel_models::physics::{Collider, Contact, Remat, Schedule, World, materials};

use crate::plain_scene::PlainScene;

const DX: f64 = 0.02;
const GRAVITY: f64 = 9.8;
const DENSITY: f64 = 1000.0;

/// A stiff block that lies on the ground, with gravity turned by the angle of the slope instead of the ground.
fn block(angle: f64, friction: f64) -> PlainScene {
    let side = 8;
    let place = |k: usize| DX * (0.5 * k as f64 + 0.25);
    let positions: Vec<[f64; 3]> =
        (0..side * side * side).map(|i| [i / side / side, i / side % side, i % side].map(place)).collect();
    let law = materials::find("kelvin_voigt").unwrap();
    // damped, so that it does not hop on its corners
    let values = [4e5, 0.2, 5e-4];
    let ground = Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Friction(friction));
    let gravity = [GRAVITY * angle.sin(), -GRAVITY * angle.cos(), 0.0];
    let world = World { colliders: vec![ground], gravity, ..World::new(DX) };
    let speed = law.wave_speed_on(&values, DENSITY, DX);
    let schedule = Schedule::stable(&world, 3, 0.1, speed, 1.0, 0.4);
    PlainScene::new(world, schedule, &positions, &[0.0; 3], &[friction], &[(law, &values)])
}

/// How far it slides falls by `g cos a t²/2` for each unit of friction, forward and reverse.
#[test]
fn its_derivative_by_friction_is_known() {
    let angle = 30f64.to_radians();
    let scene = block(angle, 0.25);
    let at = scene.names.iter().position(|name| *name == "friction").unwrap();
    let mut direction: Vec<Vec<f64>> = scene.values.iter().map(|values| vec![0.0; values.len()]).collect();
    direction[at] = vec![1.0];
    let (motion, changes) = scene.jvp(&[direction]).unwrap();
    let n = scene.values[0].len() / 3;
    let last = &changes[0][2 * 3 * n..];
    let found = last.iter().step_by(3).sum::<f64>() / n as f64;
    let wanted = -0.5 * GRAVITY * angle.cos() * 0.04;
    assert!((found / wanted - 1.0).abs() < 0.06, "{found} m for {wanted}");
    let weights: Vec<f64> =
        (0..motion.len()).map(|i| if i >= 2 * 3 * n && i % 3 == 0 { 1.0 / n as f64 } else { 0.0 }).collect();
    let (_, gradients) = scene.vjp(&weights, Remat::default()).unwrap();
    assert!((gradients[at][0] - found).abs() < 1e-8, "{} by reverse mode, {found} by forward mode", gradients[at][0]);
}
