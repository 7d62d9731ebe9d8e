//! Where a falling object is, of which one camera is known.

use crate::field::bounding_sphere;
use crate::monocular::free_fall::FreeFall;
use crate::monocular::sighting::Sighting;
use crate::monocular::{Down, sight};
use gradreel::Key;

use super::ball::{GRAVITY, RADIUS, RATE, START, VELOCITY, camera, clip, landed};

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_fall_tells_distance_and_velocity() {
    let mut clip = clip();
    sight(&mut clip, GRAVITY).unwrap();
    let flight = clip.flight.expect("it is seen to fall");
    assert!(apart(flight.centre, START) < 0.04, "{:.3?}", flight.centre);
    assert!(apart(flight.velocity, VELOCITY) < 0.1, "{:.3?}", flight.velocity);
    assert_eq!(flight.frames, landed(), "the frames before the floor");
    assert!((0.005..0.15).contains(&flight.deviation), "{}", flight.deviation);
    for axis in 0..3 {
        let (off, deviation) = ((flight.velocity[axis] - VELOCITY[axis]).abs(), flight.velocity_deviation()[axis]);
        // what a body whose shape is not known does along the line of sight is seen least
        let most = if axis == 2 { 0.5 } else { 0.2 };
        assert!(off < 2.5 * deviation && deviation < most, "axis {axis}: {off:.3} of {deviation:.3} m/s");
    }
    assert!(clip.assumptions.iter().any(|line| line.contains("m away")), "{:?}", clip.assumptions);

    // the ball of the field follows it through the air
    let sphere = bounding_sphere(&clip, 2).unwrap();
    assert!(!sphere.assumed_depth && apart(sphere.centre, super::ball::middle(2)) < 0.04, "{:.3?}", sphere.centre);
    assert!((1.0..1.3).contains(&(sphere.radius / RADIUS)), "{}", sphere.radius);
}

#[test]
fn the_scale_is_that_of_gravity() {
    let on_the_moon = GRAVITY.map(|g| g / 6.0);
    let [mut here, mut there] = [clip(), clip()];
    sight(&mut here, GRAVITY).unwrap();
    sight(&mut there, on_the_moon).unwrap();
    let speed = |clip: &crate::video::Clip| apart(clip.flight.unwrap().velocity, [0.0; 3]);
    approx::assert_relative_eq!(speed(&here), 6.0 * speed(&there), max_relative = 1e-6);
}

#[test]
fn no_fall_no_distance() {
    let mut still = clip();
    still.frames[0] = vec![still.frames[0][0].clone(); still.times.len()];
    sight(&mut still, GRAVITY).unwrap();
    assert_eq!(still.flight, None);
    let mut cut = clip();
    // from the second frame on the ball touches the image's edge
    cut.frames[0][1].alpha[[0, 50]] = 1.0;
    sight(&mut cut, GRAVITY).unwrap();
    assert_eq!(cut.flight, None);
    let mut two = clip();
    two.cameras.push(two.cameras[0].clone());
    two.frames.push(two.frames[0].clone());
    sight(&mut two, GRAVITY).unwrap();
    assert_eq!(two.flight, None, "two cameras meet by themselves");
}

/// Sightings that are off by chance: what is found scatters as each fit says, velocity and distance together.
#[test]
fn velocity_and_distance_scatter_as_is_said() {
    let (camera, metres, gravity) = (camera(), 1.3, 9.8);
    let (start, rate, side) = ([0.05, 0.1, -1.0], [0.2, -0.3, 0.1], 40.0f64);
    let seen = |frame: usize, noise: &mut dyn FnMut() -> f64| {
        let time = frame as f64 / RATE;
        let x: [f64; 3] = std::array::from_fn(|axis| {
            let down = if axis == 1 { -0.5 * gravity / metres * time * time } else { 0.0 };
            start[axis] + rate[axis] * time + down
        });
        let pixels = (0.003 * side).max(0.25);
        Sighting {
            time,
            middle: [
                camera.cx - camera.fx * x[0] / x[2] + pixels * noise(),
                camera.cy + camera.fy * x[1] / x[2] + pixels * noise(),
            ],
            size: side.ln() - (-x[2]).ln() + 0.05 * noise(),
        }
    };
    let fit = |noise: &mut dyn FnMut() -> f64| {
        let sightings: Vec<Sighting> = (0..9).map(|frame| seen(frame, noise)).collect();
        FreeFall::fit(&camera, &sightings, &[], Down::Known([0.0, -1.0, 0.0]).into()).unwrap()
    };
    // of the velocity in metres and the logarithm of the distance
    let found = |fall: &FreeFall| {
        let distance = gravity / fall.gravity;
        let [x, y, z] = fall.velocity.map(|rate| distance * rate);
        [x, y, z, distance.ln()]
    };
    let exact = fit(&mut || 0.0);
    let middle = found(&exact);
    let wanted = [0.2 * metres, -0.3 * metres, 0.1 * metres, metres.ln()];
    (0..4).for_each(|i| approx::assert_relative_eq!(middle[i], wanted[i], max_relative = 1e-6));
    let mut chance = Key::new(1).normal(2000 * 9 * 3);
    let mut noise = || chance.next().expect("as many as are asked for");
    let all: Vec<[f64; 4]> = (0..2000).map(|_| found(&fit(&mut noise))).collect();
    let mean: [f64; 4] = std::array::from_fn(|i| all.iter().map(|x| x[i]).sum::<f64>() / all.len() as f64);
    let scatter = |i: usize, j: usize| {
        all.iter().map(|x| (x[i] - mean[i]) * (x[j] - mean[j])).sum::<f64>() / (all.len() - 1) as f64
    };
    let turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let (velocities, with) = (exact.velocity_covariance(&turn, metres), exact.velocity_with_distance(&turn, metres));
    let said = |i: usize, j: usize| match (i, j) {
        (3, 3) => exact.deviation * exact.deviation,
        (i, 3) => with[i],
        (i, j) => velocities[i][j],
    };
    for j in 0..4 {
        for i in 0..=j {
            let scale = (said(i, i) * said(j, j)).sqrt();
            let (found, said) = (scatter(i, j), said(i, j));
            assert!((found - said).abs() < 0.1 * scale, "{i}, {j}: {said:.3e} said, {found:.3e} found, of {scale:.3e}");
        }
    }
    // who is further away falls faster
    assert!(said(1, 3) < -0.8 * (said(1, 1) * said(3, 3)).sqrt(), "{with:?}");
}
