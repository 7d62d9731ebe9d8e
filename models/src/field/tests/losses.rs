//! Weights of views, robust losses and penalties.

use crate::identify::RangePenalty;
use crate::physics::materials;
use crate::render::{PixelLoss, ViewWeights, camera_angles, huber, view_angles};
use crate::video::Camera;
use gradreel::{DType, Key, Tape, Tensor};

use super::harness::{File, places};

#[test]
fn views_count_by_their_angle() {
    let file = File::load("view_weights");
    let primary = file.number("primary") as usize;
    let c2w: Vec<_> = file.get("cams_c2w").as_chunks::<12>().0.to_vec();
    let camera = |m: &[f64; 12]| Camera {
        id: 0,
        width: 1,
        height: 1,
        fx: 1.0,
        fy: 1.0,
        cx: 0.5,
        cy: 0.5,
        c2w: [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| m[4 * row + column])),
    };
    let cameras: Vec<Camera> = c2w.iter().map(camera).collect();
    let mut all = vec![("cams", camera_angles(&cameras, file.triple("cams_centre"), primary))];
    let rings = file.names().filter_map(|name| name.strip_suffix("_dirs"));
    all.extend(rings.map(|ring| (ring, view_angles(&file.points(&format!("{ring}_dirs")), primary))));
    assert!(all.len() > 1, "a ring of views");
    let mut place = places().remove(0);
    place.value = 1e-12;
    for (name, angles) in all {
        // the file's arc cosine makes 1.5e-8 of the primary view's rounding; its weight follows from its own angle
        let wanted = file.get(&format!("{name}_angle"));
        assert!(angles[primary] < 1e-12 && wanted[primary] < 1e-7);
        let angles: Vec<f64> = angles.iter().zip(wanted).map(|(a, b)| if *b < 1e-7 { *b } else { *a }).collect();
        place.close("angles", &angles, wanted);
        for alpha in file.setting("alphas").as_array().unwrap() {
            let settings = ViewWeights { alpha: alpha.as_f64().unwrap(), normalised: false, ..ViewWeights::default() };
            place.close("weights", &settings.of_angles(&angles), file.get(&format!("{name}_weight_{alpha}")));
        }
    }
}

#[test]
fn drawn_views_have_the_expectation_of_the_weighted_sum() {
    let angles = [0.0, 0.5, 1.5, 3.0];
    let settings = ViewWeights { alpha: 0.7, ..ViewWeights::default() };
    let weights = settings.of_angles(&angles);
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let losses = [0.3, 1.0, 4.0, 9.0];
    let tape = Tape::new();
    let vars = tape.constant(Tensor::from_vec(losses.to_vec(), [4]));
    let total = settings.total(&vars, &angles).unwrap().item().unwrap();
    let count = 200_000;
    let drawn = settings.draw(&angles, 0, Key::new(3), count);
    let mean = drawn.iter().map(|&i| losses[i]).sum::<f64>() / count as f64;
    assert!((mean - total).abs() < 0.03, "{mean} for {total}");
    // sixteen views: the primary one is drawn a quarter of the time, not its share
    let ring: Vec<f64> = (0..16).map(|i| f64::from(i) * 0.1).collect();
    let drawn = settings.draw(&ring, 0, Key::new(4), count);
    let share = drawn.iter().filter(|i| **i == 0).count() as f64 / count as f64;
    assert!((share - 0.25).abs() < 0.01, "{share}");
    let even = ViewWeights { alpha: 0.0, ..settings }.draw(&ring, 0, Key::new(4), count);
    let share = even.iter().filter(|i| **i == 0).count() as f64 / count as f64;
    assert!((share - 1.0 / 16.0).abs() < 0.01, "{share}");
}

#[test]
fn outliers_of_imagined_views_count_linearly() {
    let tape = Tape::new();
    let r = tape.leaf(Tensor::from_vec(vec![-3.0f64, -0.1, 0.05, 0.1, 0.5], [5]));
    let loss = huber(&r, 0.1);
    let found = loss.value().unwrap().to_vec().unwrap();
    for (found, wanted) in found.iter().zip([0.59, 0.01, 0.0025, 0.01, 0.09]) {
        assert!((found - wanted).abs() < 1e-12, "{found} for {wanted}");
    }
    let slopes = loss.sum_all().backward().unwrap().wrt(&r).unwrap().to_vec().unwrap();
    assert!(slopes.iter().zip([-0.2, -0.2, 0.1, 0.2, 0.2]).all(|(a, b)| (a - b).abs() < 1e-12), "{slopes:?}");
    let squares = r.square().value().unwrap().to_vec().unwrap();
    for (settings, imagined) in [(PixelLoss { robust: false, delta: 0.1 }, true), (PixelLoss::default(), false)] {
        assert_eq!(settings.of(&r, imagined).value().unwrap().to_vec().unwrap(), squares);
    }
}

#[test]
fn penalties_are_smooth_and_small_within_the_range() {
    let penalty = RangePenalty::default();
    for law in materials::all().iter().filter(|law| !law.name().starts_with("learned")) {
        let middle: Vec<f64> = law.parameters().iter().map(|p| p.start).collect();
        for (i, parameter) in law.parameters().iter().enumerate() {
            let [low, high] = penalty.range(law, parameter);
            let at = |value: f64| {
                let mut values = middle.clone();
                values[i] = value;
                let tape = Tape::new();
                let one = |value: &f64| tape.leaf(Tensor::full(*value, [1], DType::F64));
                let leaves: Vec<_> = values.iter().map(one).collect();
                let loss = penalty.on_tape(law, &leaves).unwrap();
                assert!((loss.item().unwrap() - penalty.of(law, &values)).abs() < 1e-12);
                (loss.item().unwrap(), loss.backward().unwrap().wrt(&leaves[i]).unwrap().to_vec().unwrap()[0])
            };
            for border in [low, high] {
                let step = 1e-7 * border;
                let ((below, slope_below), (above, slope_above)) = (at(border - step), at(border + step));
                assert!((below - above).abs() < 1e-9, "{}: {below} {above}", parameter.name);
                assert!((slope_below - slope_above).abs() * border < 1e-6, "{}", parameter.name);
                let inside = at(low + 0.5 * (high - low)).0;
                assert!(inside <= below, "{}", parameter.name);
            }
            assert!(at(high + 10.0 * (high - low)).0 > 1e-2 + at(high).0, "{}", parameter.name);
        }
    }
    let off = RangePenalty { enabled: false, ..penalty };
    let law = materials::find("newtonian").unwrap();
    let tape = Tape::new();
    let leaves = [tape.leaf(Tensor::full(1e9, [1], DType::F64)), tape.leaf(Tensor::full(1e9, [1], DType::F64))];
    assert!(off.on_tape(&law, &leaves).is_none());
}
