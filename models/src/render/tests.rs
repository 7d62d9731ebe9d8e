//! The renderer: closed forms, gradient checks, and agreement with its composition of single ops.

use std::sync::Arc;

use crate::render::{Rays, Splat, Surface, march, render, render_jvp, sharpen, splat};
use gradreel::ops::{NodeGrid, uniform};
use gradreel::{DType, ErrorKind, GradCheck, Tape, Tensor};

fn rays(list: &[([f64; 3], [f64; 3])]) -> Arc<Rays> {
    let unit = |d: [f64; 3]| d.map(|x| x / d.iter().map(|x| x * x).sum::<f64>().sqrt());
    Arc::new(Rays {
        origins: list.iter().map(|(origin, _)| *origin).collect(),
        directions: list.iter().map(|(_, direction)| unit(*direction)).collect(),
    })
}

/// Rays from around into a unit box, none along an axis.
fn some_rays() -> Arc<Rays> {
    rays(&[
        ([-1.0, 0.31, 0.42], [1.0, 0.11, 0.07]),
        ([0.52, 2.0, 0.37], [0.05, -1.0, 0.09]),
        ([0.3, 0.4, -1.5], [0.13, 0.1, 1.0]),
        ([1.8, 1.7, 1.6], [-1.0, -0.9, -0.8]),
        ([-1.0, 3.0, 0.4], [1.0, 0.1, 0.0]), // misses
    ])
}

const NODES: NodeGrid = NodeGrid { origin: [0.0; 3], spacing: 0.2, dims: [6, 6, 6] };

#[test]
fn light_through_a_filled_slab_follows_the_exponential_law() {
    let surface = Surface { step: 0.5, depth: 0.02, ..Surface::default() };
    let grid: Vec<f64> = (0..216).flat_map(|_| [1.0, 0.8, 0.5, 0.1]).collect();
    let tape = Tape::new();
    let grid = tape.constant(Tensor::from_vec(grid, [6, 6, 6, 4]));
    let through = rays(&[([-0.95, 0.51, 0.52], [1.0, 0.0, 0.0]), ([-1.0, 5.0, 0.5], [1.0, 0.0, 0.0])]);
    let pixels = march(&grid, NODES, &through, &surface).unwrap().value().unwrap().to_vec().unwrap();
    // one sample every 0.1 m: ten of them lie within the 1 m of the box
    let coverage = 1.0 - (-10.0f64 * 0.02).exp();
    for (found, wanted) in pixels.iter().zip([0.8 * coverage, 0.5 * coverage, 0.1 * coverage, coverage]) {
        assert!((found - wanted).abs() < 1e-12, "{pixels:?}");
    }
    assert_eq!(&pixels[4..], &[0.0; 4], "a ray that misses sees nothing");
}

#[test]
fn the_fused_march_equals_its_composition_of_ops() {
    let surface = Surface::default();
    let grid = uniform(3, [6, 6, 6, 4], 0.1..1.0);
    let tape = Tape::new();
    let fused = march(&tape.constant(grid.clone()), NODES, &some_rays(), &surface).unwrap();
    let fused = fused.value().unwrap().to_vec().unwrap();
    for (ray, wanted) in fused.chunks(4).enumerate() {
        let (origin, direction) = (some_rays().origins[ray], some_rays().directions[ray]);
        let step = surface.step * NODES.spacing;
        let inside = |x: &[f64; 3]| x.iter().all(|x| (0.0..=1.0).contains(x));
        let points: Vec<[f64; 3]> =
            (0..80).map(|k| [0, 1, 2].map(|a| origin[a] + f64::from(k) * step * direction[a])).filter(inside).collect();
        let at = tape.constant(Tensor::from_vec(points.as_flattened().to_vec(), [points.len(), 3]));
        let samples = tape.constant(grid.clone()).grid_sample_3d(&at, NODES);
        let (mut pixel, mut left) = ([0.0; 4], 1.0);
        for value in samples.value().unwrap().slice::<f64>().chunks(4) {
            let u = ((value[0] - surface.low) / surface.width).clamp(0.0, 1.0);
            let after = left * (-surface.depth * u * u * (3.0 - 2.0 * u)).exp();
            (0..3).for_each(|c| pixel[c] += (left - after) * value[c + 1] / value[0]);
            left = after;
            if left < 1e-4 {
                break;
            }
        }
        pixel[3] = 1.0 - left;
        for (a, b) in pixel.iter().zip(wanted) {
            assert!((a - b).abs() < 1e-12, "ray {ray}: {pixel:?}, fused {wanted:?}");
        }
    }
}

#[test]
fn derivatives_of_the_march_agree_with_central_differences() {
    // translucent, so that no ray ends early and every sample counts
    let surface = Surface { depth: 0.6, ..Surface::default() };
    let grid = uniform(7, [6, 6, 6, 4], 0.2..0.75);
    let check = GradCheck { entries: 864, ..GradCheck::default() };
    let report =
        check.function("march", &[("grid", grid)], |_, v| march(&v[0], NODES, &some_rays(), &surface)).unwrap();
    assert!(report.passed(), "{report}");
}

#[test]
fn sharpening_takes_away_what_both_trilinear_weights_blur() {
    let tape = Tape::new();
    let node_grid = NodeGrid { origin: [-0.5; 3], spacing: 0.1, dims: [11, 12, 10] };
    let one = |values: &[f64; 3]| tape.constant(Tensor::from_vec(values.to_vec(), [1, 3]));
    let mass = tape.constant(Tensor::full(1.0, [1, 1], DType::F64));
    let blurred = mass.grid_scatter_3d(&one(&[0.043, -0.021, 0.012]), node_grid);
    let sharp = sharpen(&blurred, node_grid, 1.0).unwrap().value().unwrap().to_vec().unwrap();
    // moments of the particle as it is looked up with a trilinear weight again: h²/6 wider than on the nodes along each axis
    let moment = |values: &[f64], of: &dyn Fn([f64; 3]) -> f64| -> f64 {
        let node = |i: usize| [i / 120, i / 10 % 12, i % 10].map(|n| n as f64 * 0.1 - 0.5);
        values.iter().enumerate().map(|(i, value)| value * of(node(i))).sum()
    };
    let before = blurred.value().unwrap().to_vec().unwrap();
    for values in [&before, &sharp] {
        assert!((moment(values, &|_| 1.0) - 1.0).abs() < 1e-12, "the mass stays");
        assert!((moment(values, &|x| x[0]) - 0.043).abs() < 1e-12, "and where it is");
    }
    for axis in 0..3 {
        let narrower = moment(&before, &|x| x[axis] * x[axis]) - moment(&sharp, &|x| x[axis] * x[axis]);
        assert!((narrower - 2.0 * 0.01 / 6.0).abs() < 1e-12, "axis {axis}: {narrower}");
    }
    let check = GradCheck { tolerance: 1e-8, ..GradCheck::default() };
    let grid = uniform(7, [3, 4, 2, 5], -1.0..1.0);
    let small = NodeGrid { dims: [3, 4, 2], ..node_grid };
    let report = check.function("sharpen", &[("grid", grid.clone())], |_, v| sharpen(&v[0], small, 0.7)).unwrap();
    assert!(report.passed(), "{report}");
    let error = sharpen(&tape.constant(grid), node_grid, 0.7).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Shape);
}

#[test]
fn derivatives_of_a_picture_agree_with_central_differences() {
    for sharpening in [0.0, 0.4] {
        derivatives_of_a_picture(&Surface { depth: 0.6, sharpening, ..Surface::default() });
    }
}

fn derivatives_of_a_picture(surface: &Surface) {
    let settings = Splat { spacing: 0.2, particle_spacing: 0.17 };
    let inputs = [
        ("positions", uniform(1, [60, 3], 0.25..0.75)),
        ("opacity", uniform(2, [60, 1], 0.3..1.0)),
        ("colour", uniform(3, [60, 3], 0.1..0.9)),
    ];
    // the smallest gradients that count are 1e-3 of the largest, where rounding of the loss is a few parts per million
    let report = GradCheck { tolerance: 1e-5, ..GradCheck::default() }
        .function("render", &inputs, |_, v| render(&v[0], &v[1], &v[2], &some_rays(), &settings, surface))
        .unwrap();
    assert!(report.passed(), "{report}");
}

#[test]
fn a_filled_body_has_occupancy_one_wherever_it_lies() {
    for shift in [0.0, 0.013, 0.05] {
        let positions: Vec<f64> =
            (0..1000usize).flat_map(|i| [i / 100, i / 10 % 10, i % 10].map(|n| 0.1 * n as f64 + shift)).collect();
        let tape = Tape::new();
        let positions = tape.constant(Tensor::from_vec(positions, [1000, 3]));
        let opacity = tape.constant(Tensor::full(1.0, [1000, 1], DType::F64));
        let colour = tape.constant(Tensor::full(0.5, [1000, 3], DType::F64));
        let (grid, node_grid) =
            splat(&positions, &opacity, &colour, &Splat { spacing: 0.2, particle_spacing: 0.1 }).unwrap();
        let middle = tape.constant(Tensor::from_vec(vec![0.47, 0.52, 0.44], [1, 3]));
        let value = grid.grid_sample_3d(&middle, node_grid).value().unwrap().to_vec().unwrap();
        for (found, wanted) in value.iter().zip([1.0, 0.5, 0.5, 0.5]) {
            assert!((found - wanted).abs() < 1e-12, "shift {shift}: {value:?}");
        }
    }
}

#[test]
fn particles_without_a_place_are_errors() {
    let tape = Tape::new();
    let settings = Splat { spacing: 0.2, particle_spacing: 0.1 };
    let one = |value: f64, columns: usize| tape.constant(Tensor::full(value, [2, columns], DType::F64));
    let nan = splat(&one(f64::NAN, 3), &one(1.0, 1), &one(0.5, 3), &settings).err().unwrap();
    assert_eq!(nan.kind(), ErrorKind::NonFinite);
    let apart = tape.constant(Tensor::from_vec(vec![0.0, 0.0, 0.0, 1e6, 1e6, 1e6], [2, 3]));
    let far = splat(&apart, &one(1.0, 1), &one(0.5, 3), &settings).err().unwrap();
    assert_eq!(far.kind(), ErrorKind::Physics);
}

#[test]
fn forward_mode_agrees_with_central_differences_and_with_the_tape() {
    // translucent, so that no ray ends early and every sample counts
    let surface = Surface { depth: 0.3, low: 0.05, ..Surface::default() };
    forward_mode(&surface);
    forward_mode(&Surface { sharpening: 0.3, ..surface });
}

fn forward_mode(surface: &Surface) {
    let particles = 40;
    let settings = Splat { spacing: 0.2, particle_spacing: 0.15 };
    let at = uniform(1, [particles, 3], 0.1..0.9);
    let (opacity, colour) = (uniform(2, [particles, 1], 0.5..1.0), uniform(3, [particles, 3], 0.1..0.9));
    let directions = [uniform(4, [particles, 3], -1.0..1.0), uniform(5, [particles, 3], -1.0..1.0)];
    let jvp = |at: &Tensor, directions: &[Tensor]| {
        let (pixels, changes) =
            render_jvp(at, directions, &opacity, &colour, &some_rays(), &settings, surface).unwrap();
        (pixels.to_vec().unwrap(), changes.to_vec().unwrap())
    };
    let (pixels, changes) = jvp(&at, &directions);
    let tape = Tape::new();
    let [x, o, c] = [&at, &opacity, &colour].map(|tensor| tape.constant(tensor.clone()));
    let rendered = render(&x, &o, &c, &some_rays(), &settings, surface).unwrap();
    assert_eq!(pixels, rendered.value().unwrap().to_vec().unwrap(), "the same picture");
    let mut largest = 0.0f64;
    for (k, direction) in directions.iter().enumerate() {
        let moved = |step: f64| {
            let x = at.to_vec().unwrap().iter().zip(direction.to_vec().unwrap()).map(|(x, d)| x + step * d).collect();
            jvp(&Tensor::from_vec(x, [particles, 3]), &[]).0
        };
        let (plus, minus) = (moved(1e-6), moved(-1e-6));
        for i in 0..pixels.len() {
            let difference = (plus[i] - minus[i]) / 2e-6;
            let exact = changes[(i / 4 * 2 + k) * 4 + i % 4];
            assert!((exact - difference).abs() < 1e-6, "value {i}, direction {k}: {exact}, difference {difference}");
            largest = largest.max(exact.abs());
        }
    }
    assert!(largest > 0.1, "the pixels do change: {largest}");
    let odd = uniform(4, [particles - 1, 3], -1.0..1.0);
    let error = render_jvp(&at, &[odd], &opacity, &colour, &some_rays(), &settings, surface).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Shape);
}

#[test]
fn the_weight_of_a_view_falls_with_its_angle() {
    use crate::render::ViewWeights;

    let settings = ViewWeights { alpha: 1.0, ..ViewWeights::default() };
    let weights = settings.of_directions(&[[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]], 0);
    assert!((weights[1] / weights[0] - (-std::f64::consts::FRAC_PI_2).exp()).abs() < 1e-12);
    // switched off, every view counts alike
    let off = ViewWeights { alpha: 0.0, ..settings };
    assert_eq!(off.of_directions(&[[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]], 0), [0.5, 0.5]);
}

#[test]
fn a_particle_that_comes_closer_covers_more() -> gradreel::Result<()> {
    use crate::render::{Rays, Splat, Surface, render_jvp};
    use gradreel::Tensor;
    use std::sync::Arc;

    // One particle before a ray that looks along z, moved towards it from the side.
    let rays = Arc::new(Rays { origins: vec![[0.0, 0.0, -1.0]], directions: vec![[0.0, 0.0, 1.0]] });
    let particle = Tensor::from_vec(vec![0.04, 0.02, 0.01], [1, 3]);
    let closer = Tensor::from_vec(vec![-1.0, 0.0, 0.0], [1, 3]);
    let (opacity, colour) = (Tensor::from_vec(vec![1.0], [1, 1]), Tensor::from_vec(vec![0.5; 3], [1, 3]));
    let settings = Splat { spacing: 0.1, particle_spacing: 0.1 };
    let surface = Surface { depth: 0.5, low: 0.1, ..Surface::default() };
    let (pixels, changes) = render_jvp(&particle, &[closer], &opacity, &colour, &rays, &settings, &surface)?;
    assert!(pixels.to_vec()?[3] > 0.1, "it is seen");
    assert!(changes.to_vec()?[3] > 0.1, "and covers more when it is closer");
    Ok(())
}
