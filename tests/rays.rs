//! Opacity, compositing and segments against an independent voxel radiance field, closed forms, and plain loops.

#[path = "vectors/find.rs"]
mod find;

use std::path::Path;

use gradreel::io::safetensors::TensorFile;
use gradreel::ops::{GridSampling, segment_offsets, uniform};
use gradreel::{DType, ErrorKind, Tape, Tensor, Var};

fn read(name: &str) -> TensorFile {
    let own = Path::new("models/tests/vectors");
    TensorFile::read(find::path(own, find::DYNAMICS, &format!("{name}.safetensors"))).unwrap()
}

fn list(values: &[u32]) -> Tensor {
    Tensor::from_vec(values.to_vec(), [values.len()])
}

#[track_caller]
fn assert_close(what: &str, found: &Tensor, wanted: &Tensor, tolerance: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let (found, wanted) = (found.to_vec().unwrap(), wanted.to_vec().unwrap());
    let size = wanted.iter().map(|b| b * b).sum::<f64>().sqrt();
    let distance = found.iter().zip(&wanted).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    assert!(distance <= tolerance * size, "{what}: off by {distance} of {size}");
}

#[test]
fn opacities_and_their_exact_derivatives() {
    let file = read("raw2alpha");
    let get = |name: String| file.get(&name).unwrap().clone();
    let shift = get("act_shift".to_owned()).to_vec().unwrap()[0];
    for (dtype, tolerance) in [(DType::F64, 1e-14), (DType::F32, 2e-6)] {
        let steps = file.tensors.keys().filter_map(|name| name.strip_prefix("alpha_")?.parse::<f64>().ok());
        for step in steps {
            let tape = Tape::new();
            let raw = tape.leaf(get("raw".to_owned()).cast(dtype).unwrap());
            let alpha = raw.density_to_alpha(shift, step);
            assert_close("alpha", alpha.value().unwrap(), &get(format!("alpha_{step}")), tolerance);
            let slope = alpha.sum_all().backward().unwrap();
            let (found, wanted) = (slope.wrt(&raw).unwrap(), get(format!("grad_exact_{step}")));
            // relative, element by element: the tails are tiny
            for (a, b) in found.to_vec().unwrap().iter().zip(wanted.to_vec().unwrap()) {
                assert!(
                    (a - b).abs() <= 1e-30_f64.max(100.0 * tolerance * b.abs()) || b < 1e-30,
                    "step {step}: {a}, not {b}"
                );
            }
        }
    }
}

/// The points of a stored box's samples in the coordinates of `grid_sample`, `[1, samples, 3]`.
fn sample_points(file: &TensorFile) -> Tensor {
    let number = |name: &str| file.metadata[name].parse::<f64>().unwrap();
    let step = number("stepsize") * number("dx");
    let get = |name: &str| file.get(name).unwrap().to_vec().unwrap();
    let (low, high) = (get("xyz_min"), get("xyz_max"));
    let (origins, directions) = (get("rays_o"), get("rays_d"));
    let mut points = Vec::new();
    for (ray, k) in get("sample_ray_id").iter().zip(get("sample_step_id")) {
        let (o, d) = (&origins[3 * *ray as usize..][..3], &directions[3 * *ray as usize..][..3]);
        let norm = d.iter().map(|d| d * d).sum::<f64>().sqrt();
        let entry = |a: usize| ((low[a] - o[a]) / d[a]).min((high[a] - o[a]) / d[a]);
        let enter = (0..3).map(entry).fold(number("near"), f64::max);
        points.extend([2, 1, 0].map(|a| {
            let x = o[a] + d[a] * enter + d[a] / norm * step * k;
            (x - low[a]) / (high[a] - low[a]) * 2.0 - 1.0
        }));
    }
    let count = points.len() / 3;
    Tensor::from_vec(points, [1, count, 3])
}

/// A direction with its sines and cosines at frequencies that double, `width` numbers.
fn view_embedding(directions: &[f64], width: usize) -> Tensor {
    let levels = (width / 3 - 1) / 2;
    let rows = directions.chunks(3).flat_map(|v| {
        let angles: Vec<f64> = v.iter().flat_map(|v| (0..levels as i32).map(move |k| 2f64.powi(k) * v)).collect();
        [v.to_vec(), angles.iter().map(|a| a.sin()).collect(), angles.iter().map(|a| a.cos()).collect()].concat()
    });
    let values: Vec<f64> = rows.collect();
    let count = values.len() / width;
    Tensor::from_vec(values, [count, width])
}

/// Rows where a number is above a threshold.
fn above(x: &Var, threshold: f64) -> Vec<u32> {
    let values = x.value().unwrap().to_vec().unwrap();
    (0..).zip(values).filter(|(_, x)| *x > threshold).map(|(i, _)| i).collect()
}

#[test]
fn a_rendered_voxel_field_and_all_its_gradients() {
    let file = read("render");
    let get = |name: &str| file.get(name).unwrap().clone();
    let number = |name: &str| file.metadata[name].parse::<f64>().unwrap();
    let (threshold, rays) = (number("fast_color_thres"), get("rays_o").dims()[0]);
    let [channels, x, y, z] = get("features").dims()[..] else { panic!("channels and three axes") };
    let tape = Tape::new();
    let leaf = |name: &str| tape.leaf(get(name));
    let pick = |from: &[u32], which: &[u32]| which.iter().map(|&i| from[i as usize]).collect::<Vec<_>>();
    let points = sample_points(&file);
    let count = points.dims()[1];
    let settings = GridSampling { align_corners: true, ..GridSampling::default() };

    // opacity of all samples; those that are seen, ray by ray
    let density = leaf("density");
    let raw = density.reshape([1, 1, x, y, z]).grid_sample(&tape.constant(points.clone()), settings).reshape([count]);
    let alpha = raw.density_to_alpha(get("act_shift").to_vec().unwrap()[0], number("delta"));
    let seen = above(&alpha, threshold);
    let numbers = |name: &str| get(name).to_vec().unwrap().into_iter().map(|k| k as u32).collect::<Vec<u32>>();
    let ray = pick(&numbers("sample_ray_id"), &seen);
    let step = pick(&numbers("sample_step_id"), &seen);
    let offsets = tape.constant(list(&segment_offsets(&ray, rays).unwrap()));
    let alpha = alpha.index_select(&tape.constant(list(&seen))).unwrap();
    let weight = alpha.ray_weights(&offsets, Some(1e-3)).unwrap();
    let left = alpha.ray_transmittance(&offsets, Some(1e-3)).unwrap();
    assert_close("alphainv_last", left.value().unwrap(), &get("alphainv_last"), 1e-13);

    // colour of those that matter
    let counted = above(&weight, threshold);
    assert!(counted.len() < seen.len(), "some samples must be too faint");
    let (ray, step) = (pick(&ray, &counted), pick(&step, &counted));
    let weight = weight.index_select(&tape.constant(list(&counted))).unwrap().reshape([counted.len(), 1]);
    let offsets = tape.constant(list(&segment_offsets(&ray, rays).unwrap()));
    let rows = tape.constant(list(&pick(&seen, &counted)));
    let at = tape.constant(points.reshape([count, 3])).index_select(&rows).unwrap().reshape([1, counted.len(), 3]);
    let features = leaf("features");
    let width = get("mlp_0_weight").dims()[1] - channels;
    let looked_up = features.reshape([1, channels, x, y, z]).grid_sample(&at, settings);
    let views =
        tape.constant(view_embedding(&get("viewdirs").to_vec().unwrap(), width)).segment_repeat(&offsets).unwrap();
    let mut colour = looked_up.reshape([channels, counted.len()]).permute(&[1, 0]).concat(&[&views], 1);
    let layers: Vec<[(String, Var); 2]> = (0..3)
        .map(|i| ["weight", "bias"].map(|kind| format!("mlp_{i}_{kind}")).map(|name| (name.clone(), leaf(&name))))
        .collect();
    for (i, [(_, weight), (_, bias)]) in layers.iter().enumerate() {
        colour = &colour.matmul(&weight.permute(&[1, 0])) + bias;
        colour = if i < 2 { colour.relu() } else { colour.logistic() };
    }
    let rgb = &(&weight * &colour).segment_sum(&offsets).unwrap() + &(&left.reshape([rays, 1]) * number("bg"));
    assert_close("rgb", rgb.value().unwrap(), &get("rgb"), 1e-12);
    let steps = tape.constant(Tensor::from_vec(step.iter().map(|k| f64::from(*k)).collect(), [counted.len(), 1]));
    let depth = (&weight * &steps).segment_sum(&offsets).unwrap();
    assert_close("depth", depth.value().unwrap(), &get("depth"), 1e-12);

    // losses and gradients
    let mask = tape.constant(get("ray_mask").reshape([rays, 1]));
    let mse = &(&mask * &(&rgb - &tape.constant(get("target")))).square().sum_all() * (1.0 / (3.0 * rays as f64));
    assert_close("loss_mse", mse.value().unwrap(), &get("loss_mse"), 1e-12);
    let limit = |x: f64| tape.constant(Tensor::scalar(x, DType::F64));
    let left = left.maximum(&limit(1e-5)).minimum(&limit(1.0 - 1e-5));
    let right = &(&left * -1.0) + 1.0;
    let entropy = &(&(&left * &left.ln()) + &(&right * &right.ln())).sum_all() * (-1.0 / rays as f64);
    assert_close("loss_entropy", entropy.value().unwrap(), &get("loss_entropy"), 1e-12);
    let slopes = (&mse + &(&entropy * number("entropy_weight"))).backward().unwrap();
    assert_close("g_density", slopes.wrt(&density).unwrap(), &get("g_density"), 1e-9);
    assert_close("g_features", slopes.wrt(&features).unwrap(), &get("g_features"), 1e-10);
    for (name, parameter) in layers.iter().flatten() {
        assert_close(name, slopes.wrt(parameter).unwrap(), &get(&format!("g_{name}")), 1e-10);
    }
}

#[test]
fn an_opaque_sample_has_finite_derivatives() {
    let tape = Tape::new();
    let alpha = tape.leaf(Tensor::from_vec(vec![0.25f64, 1.0, 0.5, 1.0], [4]));
    let rays = tape.constant(list(&[0, 4]));
    let g = [1.0, 10.0, 100.0, 1000.0];
    let weights = alpha.ray_weights(&rays, None).unwrap();
    assert_eq!(weights.value().unwrap().slice::<f64>(), &[0.25, 0.75, 0.0, 0.0]);
    let seen = (&weights * &tape.constant(Tensor::from_vec(g.to_vec(), [4]))).sum_all();
    // L = a + 10 (1 − a) b + 100 (1 − a)(1 − b) c + 1000 (1 − a)(1 − b)(1 − c) d at a = ¼, b = d = 1, c = ½
    let slopes = seen.backward().unwrap();
    assert_eq!(slopes.wrt(&alpha).unwrap().slice::<f64>(), &[1.0 - 10.0, 0.75 * (10.0 - 50.0 - 500.0), 0.0, 0.0]);
    let left = alpha.ray_transmittance(&rays, None).unwrap();
    assert_eq!(left.value().unwrap().slice::<f64>(), &[0.0]);
    // two opaque samples: neither alone lets anything through
    assert_eq!(left.sum_all().backward().unwrap().wrt(&alpha).unwrap().slice::<f64>(), &[0.0; 4]);
}

#[test]
fn weights_and_what_is_left_make_one() {
    let tape = Tape::new();
    let offsets: Vec<u32> = (0..=1000u32).map(|r| (r * r / 50).min(19_999)).chain([20_000]).collect();
    let rays = tape.constant(list(&offsets));
    let alpha = tape.constant(uniform(1, [20_000], 0.0..0.3));
    for stop in [None, Some(1e-2)] {
        let sums = alpha.ray_weights(&rays, stop).unwrap().segment_sum(&rays).unwrap();
        let all = &sums + &alpha.ray_transmittance(&rays, stop).unwrap();
        assert!(all.value().unwrap().to_vec().unwrap().iter().all(|x| (x - 1.0).abs() < 1e-13));
    }
}

#[test]
fn long_lists_are_added_as_short_ones_are() {
    // numbers that add up without rounding, so that a plain loop says what is right
    for (count, row, rows) in [(200_000usize, 1usize, 777usize), (30_000, 5, 3), (9_000, 16, 9_001), (40_000, 2, 1)] {
        let index: Vec<u32> = (0..count).map(|i| ((i * 7919 + i / 13) % rows) as u32).collect();
        let values: Vec<f32> = (0..count * row).map(|i| (i * 31 % 17) as f32 - 8.0).collect();
        let mut wanted = vec![0.0f32; rows * row];
        for (place, &at) in index.iter().enumerate() {
            (0..row).for_each(|c| wanted[at as usize * row + c] += values[place * row + c]);
        }
        let tape = Tape::new();
        let index = tape.constant(list(&index));
        let x = tape.leaf(Tensor::from_vec(values, [count, row]));
        let sums = x.index_add(&index, rows).unwrap();
        assert_eq!(sums.value().unwrap().slice::<f32>(), wanted, "{count} x {row} into {rows}");
        let back = sums.index_select(&index).unwrap();
        for (place, at) in index.value().unwrap().slice::<u32>().iter().enumerate() {
            let found = &back.value().unwrap().slice::<f32>()[place * row..][..row];
            assert_eq!(found, &wanted[*at as usize * row..][..row]);
        }
    }
}

#[test]
fn offsets_that_do_not_fit_are_named() {
    let tape = Tape::new();
    let x = tape.constant(uniform(1, [4], 0.0..1.0));
    for (offsets, place) in
        [(vec![1, 4], "offsets[0]"), (vec![0, 3, 2, 4], "offsets[2]"), (vec![0, 2, 5], "offsets[2]")]
    {
        let offsets = tape.constant(list(&offsets));
        let errors = [x.ray_weights(&offsets, None), x.ray_transmittance(&offsets, None), x.segment_sum(&offsets)];
        for error in errors.into_iter().map(|result| result.err().unwrap()) {
            assert_eq!(error.kind(), ErrorKind::Input);
            assert!(error.to_string().contains(place), "{error}");
        }
    }
    assert!(segment_offsets(&[0, 2, 1], 3).unwrap_err().to_string().contains("names[2]"));
    assert!(segment_offsets(&[0, 3], 3).unwrap_err().to_string().contains("names[1]"));
}
