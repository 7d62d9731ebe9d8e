//! Viscous damping beside elasticity against what is known of a damped wave and of a damped bounce.

use std::f64::consts::PI;

use gradreel_models::physics::{Collider, Contact, Schedule, World, materials};

use crate::plain_scene::PlainScene;

const DX: f64 = 0.02;
const DENSITY: f64 = 1000.0;

/// A bar of square cross section in free space, with particles half a cell apart.
fn bar(length: usize, width: usize) -> Vec<[f64; 3]> {
    let place = |k: usize| DX * (0.5 * k as f64 + 0.25);
    let all = (0..length).flat_map(|i| (0..width * width).map(move |j| [i, j / width, j % width]));
    all.map(|index| index.map(place)).collect()
}

/// Amplitude of the first longitudinal wave of a free bar, `u = a(t) cos(π x/L)`, in each frame.
fn ringing(young: f64, time: f64, frames: usize, frame_dt: f64) -> Vec<f64> {
    let (length, width) = (24, 4);
    let positions = bar(length, width);
    let size = 0.5 * DX * length as f64;
    let shape = |x: f64| (PI * x / size).cos();
    let velocity: Vec<f64> = positions.iter().flat_map(|x| [0.05 * shape(x[0]), 0.0, 0.0]).collect();
    let law = materials::find("kelvin_voigt").unwrap();
    // without Poisson's ratio the bar does not move sideways
    let values = [young, 0.0, time];
    let world = World { gravity: [0.0; 3], ..World::new(DX) };
    let sound = law.wave_speed_on(&values, DENSITY, DX);
    let schedule = Schedule::stable(&world, frames, frame_dt, sound, 0.1, 0.1);
    let scene = PlainScene::new(world, schedule, &positions, &velocity, &[], &[(law, &values)]);
    let motion = scene.motion().unwrap();
    let n = positions.len();
    let amplitude = |frame: usize| {
        let moved = |p: usize| motion[3 * (frame * n + p)] - positions[p][0];
        (0..n).map(|p| moved(p) * shape(positions[p][0])).sum::<f64>() * 2.0 / n as f64
    };
    (0..frames).map(amplitude).collect()
}

/// The damped wave `ü + t ω² u̇ + ω² u = 0`: its amplitude falls by `exp(−t ω² T/2)` in a period `T`.
#[test]
fn a_wave_decays_as_it_should() {
    let young = 1e5;
    let omega = PI / 0.24 * (young / DENSITY).sqrt();
    let period = 2.0 * PI / omega;
    let (per_period, periods) = (40, 2);
    let frames = per_period * periods + 1;
    let free = ringing(young, 1e-9, frames, period / per_period as f64);
    // maxima of the first quarter and of those two periods later
    let most = |amplitudes: &[f64]| amplitudes.iter().fold(0.0f64, |most, a| most.max(a.abs()));
    let last = frames - per_period / 2..frames;
    assert!((most(&free[..per_period / 2]) * omega / 0.05 - 1.0).abs() < 0.1, "it rings as a bar does");
    for damping in [0.02, 0.06] {
        let time = 2.0 * damping / omega;
        let damped = ringing(young, time, frames, period / per_period as f64);
        let ratio = |all: &[f64]| most(&all[last.clone()]) / most(&all[..per_period / 2]);
        // what the grid takes is the same in both; between half a period and a half period two periods later are 1.5 to 2
        let found = -(ratio(&damped) / ratio(&free)).ln() / (time * omega * omega / 2.0);
        let wanted = period * (periods as f64 - 0.5);
        assert!(
            (found / wanted - 1.0).abs() < 0.1,
            "decays over {found} s for {wanted} s, at {damping} of the critical"
        );
    }
}

/// Restitution of a block on ground that lets it go: the less, the more it is damped, and never that of more energy.
#[test]
fn a_block_bounces_the_less_the_more_it_is_damped() {
    let law = materials::find("kelvin_voigt").unwrap();
    let (young, side) = (1e5, 8);
    let sound = f64::sqrt(young / DENSITY);
    let height = 0.5 * DX * side as f64;
    // a wave runs up and down while the block is on the ground
    let contact = 2.0 * height / sound;
    let omega = PI / contact;
    let rebound = |damping: f64| {
        let positions: Vec<[f64; 3]> = bar(side, side).iter().map(|[x, y, z]| [*x, y + 0.7 * DX, *z]).collect();
        let values = [young, 0.0, 2.0 * damping / omega];
        let ground = Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Separate);
        let world = World { colliders: vec![ground], gravity: [0.0; 3], ..World::new(DX) };
        let speed = law.wave_speed_on(&values, DENSITY, DX);
        let frame_dt = 2.0 * contact;
        let schedule = Schedule::stable(&world, 3, frame_dt, speed, 1.0, 0.3);
        let scene = PlainScene::new(world, schedule, &positions, &[0.0, -0.5, 0.0], &[], &[(law.clone(), &values)]);
        let motion = scene.motion().unwrap();
        let n = positions.len();
        let middle = |frame: usize| (0..n).map(|p| motion[3 * (frame * n + p) + 1]).sum::<f64>() / n as f64;
        (middle(2) - middle(1)) / frame_dt / 0.5
    };
    let found = [1e-9, 0.05, 0.1, 0.25, 0.5].map(rebound);
    assert!(found[0] < 1.0 && found[4] > 0.0, "{found:?}");
    assert!(found.windows(2).all(|pair| pair[1] < pair[0]), "{found:?}");
}
