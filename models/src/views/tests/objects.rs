//! Procedural objects: the same for the same key, whole in every view, where they are said to be, and no two alike.

use crate::views::Ring;
use crate::views::objects::{Object, Placement, Sample, SampleSettings};
use gradreel::Key;

const SIZE: usize = 48;

fn settings() -> SampleSettings {
    SampleSettings { nodes: 32, rays: 1, ..SampleSettings::default() }
}

/// Some samples of a ring of four.
fn samples(count: u64) -> Vec<Sample> {
    let ring = Ring::published(4);
    (0..count).map(|i| Sample::draw(Key::new(3).fold(i), &ring, SIZE, &settings())).collect()
}

#[test]
fn a_sample_follows_from_its_key() {
    let ring = Ring::published(4);
    let draw = |key| Sample::draw(Key::new(key), &ring, SIZE, &settings());
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for key in [1, 2] {
        assert!(draw(key) == alone.install(|| draw(key)));
    }
    assert!(draw(1).views != draw(2).views);
}

/// The corners of the object's box bound its silhouette in each view, and every side of the box is touched: in space by
/// definition, and hence the tightest box over all views is nearly reached.
#[test]
fn objects_are_where_they_are_said_to_be() {
    let ring = Ring::published(4);
    for (number, sample) in samples(12).iter().enumerate() {
        let object = Object::new(Key::new(3).fold(number as u64).split::<3>()[0], settings().nodes);
        let (half, Placement { scale, shift }) = (object.half(), sample.placement);
        assert!((half.into_iter().fold(0.0, f64::max) - 0.5).abs() < 1e-6, "{half:?}");
        assert!(sample.placement.is_seen(half, &ring));
        assert!((0..3).all(|axis| shift[axis].abs() + scale * half[axis] <= 0.5 + 1e-9), "{shift:?}, {scale}");
        let mut filled = 0.0f64;
        for (view, seen) in sample.views.iter().enumerate() {
            let pose = ring.pose(view);
            let corners = (0..8).map(|corner: usize| {
                let place = |axis: usize| if corner >> axis & 1 == 1 { half[axis] } else { -half[axis] };
                ring.project(&pose, [0, 1, 2].map(|axis| shift[axis] + scale * place(axis)), SIZE)
            });
            let [low, high] = corners.fold([[f64::INFINITY; 2], [0.0f64; 2]], |[low, high], at| {
                [[0, 1].map(|axis| low[axis].min(at[axis])), [0, 1].map(|axis| high[axis].max(at[axis]))]
            });
            let covered: Vec<[f64; 2]> = (0..SIZE * SIZE)
                .filter(|i| seen.coverage[*i] > 0.0)
                .map(|i| [(i % SIZE) as f64 + 0.5, (i / SIZE) as f64 + 0.5])
                .collect();
            assert!(covered.len() > 10, "sample {number}, view {view}: {} pixels", covered.len());
            for at in &covered {
                let inside = (0..2).all(|axis| (low[axis] - 0.6..=high[axis] + 0.6).contains(&at[axis]));
                assert!(inside, "sample {number}, view {view}: {at:?} of {low:?} to {high:?}");
            }
            let tall = covered.iter().fold([f64::INFINITY, 0.0f64], |[a, b], at| [a.min(at[1]), b.max(at[1])]);
            filled = filled.max((tall[1] - tall[0]) / (high[1] - low[1]));
        }
        assert!(filled > 0.4, "sample {number} fills {filled} of its box");
    }
}

#[test]
fn pixels_are_white_or_clearly_not() {
    for sample in samples(12) {
        for view in sample.views.iter().chain([&sample.input]) {
            let area = view.size * view.size;
            for i in 0..area {
                let colour = [0, 1, 2].map(|c| view.colours[c * area + i]);
                assert!(colour.iter().all(|c| (-1.0..=1.0).contains(c)));
                match view.coverage[i] {
                    0.0 => assert_eq!(colour, [1.0; 3]),
                    1.0 => assert!(colour.iter().any(|c| *c < 0.7), "{colour:?}"),
                    share => panic!("one ray covers all or nothing, not {share}"),
                }
            }
        }
        assert!(sample.input == sample.views[0], "the input is the first view at the elevation of the ring");
    }
}

#[test]
fn places_and_sizes_fill_their_ranges() {
    let ring = Ring::published(16);
    let half = [0.5, 0.3, 0.4];
    let draw = |i: u64, reach: f64| Placement::draw(Key::new(9).fold(i), half, &ring, [0.25, 0.55], reach);
    let all: Vec<Placement> = (0..300).map(|i| draw(i, 1.0)).collect();
    assert!(all.iter().all(|placement| placement.is_seen(half, &ring)));
    let spread = |of: &dyn Fn(&Placement) -> f64| {
        all.iter().map(of).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let [low, high] = spread(&|placement| placement.scale);
    assert!((0.2..0.3).contains(&low) && (0.5..=0.55).contains(&high), "{low} to {high}");
    for axis in 0..3 {
        let [low, high] = spread(&|placement| placement.shift[axis]);
        assert!(low < -0.2 && high > 0.2, "axis {axis}: {low} to {high}");
    }
    assert!((0..20).all(|i| draw(i, 0.0).shift == [0.0; 3]));
    // nothing as large as the cube is whole in all views
    let large = Placement::draw(Key::new(1), [0.5; 3], &ring, [1.0, 1.0], 1.0);
    assert!(large.scale < 0.9 && large.is_seen([0.5; 3], &ring));
}

#[test]
fn an_input_from_elsewhere_has_its_own_view() {
    let ring = Ring::published(4);
    let above = SampleSettings { elevation_deg: [60.0, 60.0], ..settings() };
    let sample = Sample::draw(Key::new(5), &ring, SIZE, &above);
    assert!((sample.elevation.to_degrees() - 60.0).abs() < 1e-9);
    assert!(sample.input != sample.views[0]);
    assert!(sample.seen(&ring).is_some());
    for wrong in [
        SampleSettings { scale: [0.5, 0.2], ..settings() },
        SampleSettings { reach: 1.5, ..settings() },
        SampleSettings { rays: 0, ..settings() },
    ] {
        assert!(wrong.check().is_err());
    }
    settings().check().unwrap();
}
