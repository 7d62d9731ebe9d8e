//! Views that nobody filmed, around what a single camera saw.

use crate::field::{Sphere, bounding_sphere, hull};
use crate::monocular::{sight, surround};
use crate::video::{Camera, Clip, Foreground, Frame};
use crate::views::Ring;
use ndarray::{Array2, Array3};

use super::ball::{GRAVITY, RADIUS, camera, clip, coverage, middle};

/// Metres from the cameras of the views to the ball, and their units in a metre.
const DISTANCE: f64 = 0.4;
const UNITS: f64 = 7.0;

/// The ball from a ring of sixteen cameras, the first at this azimuth, in units and coordinates of their own; `seen` may change
/// where a view shows it.
fn views(azimuth: f64, seen: impl Fn(usize, [f64; 3]) -> [f64; 3]) -> Clip {
    let ring = Ring::published(16);
    let (sine, cosine) = azimuth.sin_cos();
    let turn = |[x, y, z]: [f64; 3]| [cosine * x + sine * z, y, cosine * z - sine * x];
    let of = |view: usize| {
        let camera = ring.camera(view, 64);
        let column = |j: usize| turn(camera.c2w.map(|row| row[j]));
        let columns = [0, 1, 2, 3].map(column);
        let at = |scale: f64| {
            let c2w = std::array::from_fn(|i| {
                [columns[0][i], columns[1][i], columns[2][i], scale * DISTANCE / ring.distance * columns[3][i]]
            });
            Camera { c2w, ..camera.clone() }
        };
        let alpha = coverage(&at(1.0), seen(view, [0.0; 3]));
        let frame = Frame { rgb: Array3::ones((64, 64, 3)), weight: Array2::ones((64, 64)), alpha };
        (at(UNITS), vec![frame])
    };
    let (cameras, frames) = (0..16).map(of).unzip();
    Clip {
        name: "views".into(),
        root: "views".into(),
        cameras,
        frames,
        times: vec![0.0],
        frame_numbers: vec![0],
        foreground: vec![Foreground::White; 16],
        imagined: vec![false; 16],
        assumptions: vec![],
        flight: None,
        around: None,
        story: None,
    }
}

fn filmed() -> Clip {
    let mut clip = clip();
    sight(&mut clip, GRAVITY).unwrap();
    assert!(clip.flight.is_some());
    clip
}

/// Whatever their azimuth, unit and origin, the views stand around the ball where it is.
#[test]
fn views_find_their_places() {
    for azimuth in [0.0, 2.0] {
        let mut clip = filmed();
        let alike = surround(&mut clip, &views(azimuth, |_, x| x)).unwrap();
        assert!(alike > 0.93, "{alike}");
        let around = clip.around.as_ref().unwrap();
        assert_eq!(around.views.len(), 16);
        let from = |at: [f64; 3]| [0, 1, 2].map(|axis| at[axis] - middle(0)[axis]);
        let towards = |at: [f64; 3]| from(at)[0].atan2(from(at)[2]);
        let first = &around.views[0].0;
        assert!((towards(first.centre()) - towards(camera().centre())).abs() < 0.03);
        for (view, _) in &around.views {
            let [u, v, depth] = view.project(middle(0)).unwrap();
            // the distance of the ball is known to a few percent, which is a tenth of that of these cameras
            assert!((u - 32.0).abs() < 6.5 && (v - 32.0).abs() < 6.5, "{u} {v}");
            approx::assert_relative_eq!(depth, DISTANCE, max_relative = 0.1);
        }
    }
}

/// The hull of all views is the ball, where a view or two are wrong, too.
#[test]
fn bodies_of_imagined_views() {
    let ball = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    let aside = |view: usize, x: [f64; 3]| if view == 5 { [x[0], x[1] + 0.05, x[2]] } else { x };
    for (name, views, least) in [("right", views(0.0, |_, x| x), 0), ("one is wrong", views(0.0, aside), 1)] {
        let mut clip = filmed();
        surround(&mut clip, &views).unwrap();
        let (dissent, all) = (clip.around.as_ref().unwrap().dissent, clip.all_around().unwrap());
        assert!((least..=least + 1).contains(&dissent), "{name}: {dissent} may be wrong");
        let sphere = bounding_sphere(&clip, 0).unwrap();
        let sphere = Sphere { radius: 1.5 * sphere.radius, ..sphere };
        let voxels = hull(&all, 0, &sphere, 0.01, 0.5, dissent).unwrap().voxels.len();
        let volume = voxels as f64 * 1e-6;
        assert!((0.85..1.3).contains(&(volume / ball)), "{name}: {volume} for {ball}");
    }
}

#[test]
fn what_cannot_be_surrounded() {
    let right = views(0.0, |_, x| x);
    let mut twice = filmed();
    twice.cameras.push(twice.cameras[0].clone());
    twice.frames.push(twice.frames[0].clone());
    let error = surround(&mut twice, &right).unwrap_err().to_string();
    assert!(error.contains("single camera") && error.contains("2 cameras"), "{error}");
    // a rod is no ball
    let mut rod = filmed();
    for frame in &mut rod.frames[0] {
        frame
            .alpha
            .indexed_iter_mut()
            .for_each(|((row, column), a)| *a *= f32::from(u8::from((row + column) % 40 < 2)));
    }
    let error = surround(&mut rod, &right).unwrap_err().to_string();
    assert!(error.contains("do not look like the object") && error.contains("wanted"), "{error}");
    assert!(rod.around.is_none());
}
