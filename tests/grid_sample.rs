//! Sampling of grids against PyTorch and an independent voxel field; threads, and points that are not finite.

#[path = "vectors/find.rs"]
mod find;

use std::path::Path;

use gradreel::io::safetensors::TensorFile;
use gradreel::ops::{GridSampling, Interpolation, NodeGrid, Padding, uniform};
use gradreel::{DType, Tape, Tensor, Var};

#[track_caller]
fn assert_close(what: &str, found: &Tensor, wanted: &Tensor, tolerance: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (i, (a, b)) in found.to_vec().unwrap().iter().zip(wanted.to_vec().unwrap()).enumerate() {
        assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{what}[{i}]: {a}, not {b}");
    }
}

#[test]
fn values_and_gradients_are_those_of_pytorch() {
    let file = TensorFile::read("tests/vectors/grid_sample.safetensors").unwrap();
    for (dtype, tolerance) in [(DType::F64, 1e-13), (DType::F32, 1e-5)] {
        let get = |name: &str| file.get(name).unwrap().cast(dtype).unwrap();
        for rank in ["2d", "3d"] {
            for (interpolation, how) in [(Interpolation::Linear, "linear"), (Interpolation::Nearest, "nearest")] {
                for (padding, outside) in [(Padding::Zeros, "zeros"), (Padding::Border, "border")] {
                    for (align_corners, ends) in [(true, "aligned"), (false, "cells")] {
                        let name = format!("{rank}.{how}.{outside}.{ends}");
                        let tape = Tape::new();
                        let values = tape.leaf(get(&format!("{rank}.values")));
                        let points = tape.leaf(get(&format!("{rank}.points")));
                        let settings = GridSampling { interpolation, padding, align_corners };
                        let y = values.grid_sample(&points, settings);
                        assert_close(&name, y.value().unwrap(), &get(&format!("{name}.y")), tolerance);
                        let cotangent = tape.constant(get(&format!("{rank}.cotangent")));
                        let slopes = (&y * &cotangent).sum_all().backward().unwrap();
                        let wanted = get(&format!("{name}.g_values"));
                        assert_close(&name, slopes.wrt(&values).unwrap(), &wanted, 10.0 * tolerance);
                        let found = slopes.wrt(&points).unwrap();
                        if interpolation == Interpolation::Nearest {
                            assert!(found.to_vec().unwrap().iter().all(|g| *g == 0.0), "{name}");
                        } else {
                            assert_close(&name, found, &get(&format!("{name}.g_points")), 10.0 * tolerance);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_voxel_field_is_looked_up_the_same_way_through_either_layout() {
    let file = find::path(Path::new("models/tests/vectors"), find::DYNAMICS, "grid_query.safetensors");
    let file = TensorFile::read(file).unwrap();
    let get = |name: &str| file.get(name).unwrap().clone();
    let (low, high) = (get("xyz_min").to_vec().unwrap(), get("xyz_max").to_vec().unwrap());
    let points = get("points").to_vec().unwrap();
    let (tape, count) = (Tape::new(), points.len() / 3);
    let [channels, x, y, z] = get("features").dims()[..] else { panic!("channels and three axes") };

    // channels first: −1 … 1 over the box, and the last axis is that of the first component
    let unit: Vec<f64> =
        points.chunks(3).flat_map(|p| [2, 1, 0].map(|a| (p[a] - low[a]) / (high[a] - low[a]) * 2.0 - 1.0)).collect();
    let at = tape.constant(Tensor::from_vec(unit, [1, count, 3]));
    let features = tape.leaf(get("features"));
    let settings = GridSampling { align_corners: true, ..GridSampling::default() };
    let found = features.reshape([1, channels, x, y, z]).grid_sample(&at, settings);
    let found = found.reshape([channels, count]).permute(&[1, 0]);
    assert_close("features", found.value().unwrap(), &get("features_at"), 1e-11);
    let slopes = (&found * &tape.constant(get("cot_features"))).sum_all().backward().unwrap();
    assert_close("g_features", slopes.wrt(&features).unwrap(), &get("g_features"), 1e-11);

    // channels last: a grid in the box's own coordinates
    let origin = [low[0], low[1], low[2]];
    let node_grid = NodeGrid { origin, spacing: (high[0] - low[0]) / (x as f64 - 1.0), dims: [x, y, z] };
    let at = tape.constant(get("points"));
    let density = tape.leaf(get("density"));
    let found = density.reshape([x, y, z, 1]).grid_sample_3d(&at, node_grid).reshape([count]);
    assert_close("density", found.value().unwrap(), &get("density_at"), 1e-11);
    let slopes = (&found * &tape.constant(get("cot_density"))).sum_all().backward().unwrap();
    assert_close("g_density", slopes.wrt(&density).unwrap(), &get("g_density"), 1e-11);
    let step = |name: &String| name.strip_prefix("alpha_delta_")?.parse::<f64>().ok();
    for (name, step) in file.tensors.keys().filter_map(|name| Some((name, step(name)?))) {
        let alpha = found.density_to_alpha(get("act_shift").to_vec().unwrap()[0], step);
        assert_close(name, alpha.value().unwrap(), &get(name), 1e-11);
    }
}

#[test]
fn nothing_depends_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tape = Tape::new();
            let values = tape.leaf(uniform(1, [2, 5, 7, 6, 9], -1.0..1.0).cast(DType::F32).unwrap());
            let points = tape.leaf(uniform(2, [2, 20_000, 3], -1.2..1.2).cast(DType::F32).unwrap());
            let y = values.grid_sample(&points, GridSampling::default());
            let slopes = y.square().sum_all().backward().unwrap();
            [y.value().unwrap(), slopes.wrt(&values).unwrap(), slopes.wrt(&points).unwrap()]
                .map(|x| x.slice::<f32>().iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        })
    };
    let one = run(1);
    for threads in [2, 3, 8] {
        assert!(run(threads) == one, "{threads} threads");
    }
}

#[test]
fn many_points_in_few_cells_add_up() {
    // a scatter of ones: the sum over nodes is the number of points inside, whatever way the points are cut
    for (sizes, count) in [([1, 1, 40], 5000), ([40, 1, 1], 5000), ([2, 3, 4], 70_000)] {
        let node_grid = NodeGrid { origin: [0.0; 3], spacing: 1.0, dims: sizes };
        let points: Vec<f64> = uniform(1, [count, 3], 0.0..1.0)
            .to_vec()
            .unwrap()
            .chunks(3)
            .flat_map(|p| [0, 1, 2].map(|a| p[a] * (sizes[a] as f64 - 1.0)))
            .collect();
        let tape = Tape::new();
        let ones = tape.constant(Tensor::full(1.0, [count, 17], DType::F64));
        let sums = ones.grid_scatter_3d(&tape.constant(Tensor::from_vec(points, [count, 3])), node_grid);
        let total = sums.sum(&[0, 1, 2]).value().unwrap().to_vec().unwrap();
        assert!(total.iter().all(|t| (t / count as f64 - 1.0).abs() < 1e-12), "{sizes:?}: {total:?}");
    }
}

#[test]
fn points_that_are_not_finite_are_nan_and_touch_no_others() {
    for padding in [Padding::Zeros, Padding::Border] {
        for interpolation in [Interpolation::Linear, Interpolation::Nearest] {
            let settings = GridSampling { interpolation, padding, align_corners: false };
            let tape = Tape::new();
            let (nan, inf) = (f64::NAN, f64::INFINITY);
            let list = vec![0.1, 0.2, nan, 0.2, 0.1, inf, -inf, 5.0, 7.0, nan, 1e300, -1e300];
            let values = tape.leaf(uniform(1, [1, 3, 4, 5], -1.0..1.0));
            let points = tape.leaf(Tensor::from_vec(list, [1, 6, 2]));
            let y: Var = values.grid_sample(&points, settings);
            for (i, v) in y.value().unwrap().to_vec().unwrap().iter().enumerate() {
                assert_eq!(v.is_nan(), (1..5).contains(&(i % 6)), "{settings:?}: sample {i} is {v}");
            }
            let slopes = y.sum_all().backward().unwrap();
            for (i, g) in slopes.wrt(&points).unwrap().to_vec().unwrap().iter().enumerate() {
                assert_eq!(g.is_nan(), (1..5).contains(&(i / 2)), "{settings:?}: slope {i} is {g}");
            }
            assert!(slopes.wrt(&values).unwrap().to_vec().unwrap()[0].is_nan(), "{settings:?}: hidden");
        }
    }
}

#[test]
#[should_panic(expected = "[batch, …, 3]")]
fn points_of_another_rank_are_refused() {
    let tape = Tape::new();
    let values = tape.leaf(uniform(1, [1, 3, 4, 5, 6], -1.0..1.0));
    let _ = values.grid_sample(&tape.constant(uniform(1, [1, 7, 2], -1.0..1.0)), GridSampling::default());
}
