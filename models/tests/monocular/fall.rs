//! Where a falling object is, of which one camera is known.

use gradreel_models::field::bounding_sphere;
use gradreel_models::monocular::sight;

use crate::ball::{GRAVITY, RADIUS, START, VELOCITY, clip, landed};

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
    assert!(!sphere.assumed_depth && apart(sphere.centre, crate::ball::middle(2)) < 0.04, "{:.3?}", sphere.centre);
    assert!((1.0..1.3).contains(&(sphere.radius / RADIUS)), "{}", sphere.radius);
}

#[test]
fn the_scale_is_that_of_gravity() {
    let on_the_moon = GRAVITY.map(|g| g / 6.0);
    let [mut here, mut there] = [clip(), clip()];
    sight(&mut here, GRAVITY).unwrap();
    sight(&mut there, on_the_moon).unwrap();
    let speed = |clip: &gradreel_models::video::Clip| apart(clip.flight.unwrap().velocity, [0.0; 3]);
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
