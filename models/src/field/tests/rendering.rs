//! Samples along rays and what they add up to.

use crate::field::{RadianceField, RadianceSizes, entropy};
use crate::render::{RadianceSettings, Rays, Samples, Sampling, render_radiance};
use crate::video::Camera;
use gradreel::optim::Params;
use gradreel::{Tape, Tensor};

use super::grids::grid_of;
use super::harness::{File, Place, channels_first, places};

/// The rays of a file.
pub fn rays_of(file: &File) -> Rays {
    Rays { origins: file.points("rays_o"), directions: file.points("rays_d") }
}

/// The colour network's sizes in a file.
pub fn sizes_of(file: &File) -> RadianceSizes {
    let width = file.dims("mlp_0_weight")[0];
    let features = file.dims("features")[0];
    let view_levels = ((file.dims("mlp_0_weight")[1] - features) / 3 - 1) / 2;
    RadianceSizes { features, width, view_levels }
}

/// Grids and network of a file, at a place.
pub fn params_of(file: &File, place: &Place) -> Params {
    let mut params = Params::new();
    params.set("radiance.density", place.tensor(&file.grid("density")));
    params.set("radiance.features", place.tensor(&file.grid("features")));
    for layer in 0..3 {
        for part in ["weight", "bias"] {
            let value = place.tensor(&file.tensor(&format!("mlp_{layer}_{part}")));
            params.set(format!("radiance.colour.{layer}.{part}"), value);
        }
    }
    params
}

/// How a file renders.
pub fn settings_of(file: &File) -> RadianceSettings {
    RadianceSettings {
        sampling: Sampling { step: file.number("stepsize"), ..Sampling::default() },
        background: file.number("bg"),
        ..RadianceSettings::default()
    }
}

/// Compares gradients by path with those of the file.
pub fn compare_gradients(
    file: &File,
    place: &Place,
    gradients: &std::collections::BTreeMap<String, Tensor>,
    density: &str,
) {
    let grid = |path: &str| channels_first(&gradients[path]);
    place.close_gradient("density", &grid("radiance.density"), file.get(density));
    place.close_gradient("features", &grid("radiance.features"), file.get("g_features"));
    for layer in 0..3 {
        for part in ["weight", "bias"] {
            let found = gradients[&format!("radiance.colour.{layer}.{part}")].to_vec().unwrap();
            let name = format!("g_mlp_{layer}_{part}");
            place.close_gradient(&name, &found, file.get(&name));
        }
    }
}

#[test]
fn rays_through_the_middles_of_pixels() {
    let file = File::load("rays");
    let [cameras, height, width, _] = file.dims("rays_d")[..] else { panic!("cameras, rows, columns, three") };
    let k = file.get("intrinsic").as_chunks::<3>().0;
    let camera = |m: &[f64]| Camera {
        id: 0,
        width,
        height,
        fx: k[0][0],
        fy: k[1][1],
        cx: k[0][2],
        cy: k[1][2],
        c2w: [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| m[4 * row + column])),
    };
    let all: Vec<Camera> = file.get("c2w").chunks(12).map(camera).collect();
    assert_eq!(all.len(), cameras);
    let rays = Rays::of_cameras(&all);
    let pixels = (0..height * width).map(|i| ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
    let pixels: Vec<(f64, f64)> = pixels.collect();
    let through = all.iter().flat_map(|camera| pixels.iter().map(move |&(u, v)| camera.ray(u, v).1));
    let through: Vec<[f64; 3]> = through.collect();
    let place = places()[0].allowing([1e-12, 0.0], [0.0; 2]);
    place.close("origins", rays.origins.as_flattened(), file.get("rays_o"));
    // the file's places on the sensor are in single precision
    let place = place.allowing([2e-8, 0.0], [0.0; 2]);
    place.close("directions", through.as_flattened(), file.get("rays_d"));
    place.close("unit directions", rays.directions.as_flattened(), file.get("viewdirs"));
}

#[test]
fn samples_of_a_box() {
    let file = File::load("render");
    let sampling = Sampling { step: file.number("stepsize"), near: file.number("near"), ..Sampling::default() };
    let samples = Samples::in_box(&rays_of(&file), &grid_of(&file, "density", file.number("dx")), &sampling);
    let rays: Vec<f64> = samples.rays().iter().map(|&r| r.into()).collect();
    assert_eq!(rays, file.get("sample_ray_id"));
    let numbers: Vec<f64> = samples.numbers.iter().map(|&k| k.into()).collect();
    assert_eq!(numbers, file.get("sample_step_id"));
    // the file holds them in single precision
    let place = places()[0].allowing([1e-7, 0.0], [0.0; 2]);
    place.close("points", samples.points.as_flattened(), file.get("sample_points"));
}

#[test]
fn pictures_of_a_field_and_their_gradients() {
    let file = File::load("render");
    let (dx, base) = (file.number("dx"), file.number("dx_base"));
    let field = RadianceField {
        grid: grid_of(&file, "density", dx),
        base_spacing: base,
        shift: file.number("act_shift"),
        sizes: sizes_of(&file),
    };
    let mut settings = settings_of(&file);
    settings.sampling.near = file.number("near");
    settings.threshold = file.number("fast_color_thres");
    let absorption = settings.absorption(dx, base, field.shift);
    assert!((absorption.interval - file.number("delta")).abs() < 1e-12);
    for place in places() {
        let params = params_of(&file, &place);
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let (values, net) = (field.values(&bound).unwrap(), field.colours(&bound).unwrap());
        let rays = rays_of(&file);
        let pixels = render_radiance(&values, &field.grid, &net, &rays, &settings, &absorption).unwrap();
        place.close_var("rgb", &pixels.rgb, file.get("rgb"));
        place.close_var("left", &pixels.left, file.get("alphainv_last"));
        place.close_var("depth", &pixels.depth, file.get("depth"));
        let mask = place.constant(&tape, &file.tensor("ray_mask")).reshape([rays.len(), 1]);
        let target = place.constant(&tape, &file.tensor("target"));
        let squares = (mask * (&pixels.rgb - &target)).square().mean_all();
        place.close_var("loss", &squares, file.get("loss_mse"));
        let entropy = entropy(&pixels.left, 1e-5);
        place.close_var("entropy", &entropy, file.get("loss_entropy"));
        let loss = squares + entropy * file.number("entropy_weight");
        compare_gradients(&file, &place, &bound.gradients(&loss.backward().unwrap()).unwrap(), "g_density");
    }
}
