//! Lookups, opacities, refinement and total variation.

use crate::field::variation::variation_gradient;
use crate::field::{DenseGrid, RadianceField, RadianceSizes, Reach, opacity_shift, with_variation};
use gradreel::optim::Params;
use gradreel::{DType, Device, Tape, Tensor};

use super::harness::{File, channels_first, contract, places, turned};

/// The grid of a file.
pub fn grid_of(file: &File, values: &str, spacing: f64) -> DenseGrid {
    let (low, high) = (file.triple("xyz_min"), file.triple("xyz_max"));
    DenseGrid { low, high, dims: file.nodes(values), spacing }
}

#[test]
fn lookups_and_their_gradients() {
    let file = File::load("grid_query");
    let grid = grid_of(&file, "density", f64::NAN);
    for place in places() {
        let tape = Tape::new();
        let [density, features] = ["density", "features"].map(|name| place.leaf(&tape, &file.grid(name)));
        let points = place.constant(&tape, &file.tensor("points"));
        let density_at = grid.lookup(&density, &points).unwrap();
        let features_at = grid.lookup(&features, &points).unwrap();
        place.close_var("density", &density_at, file.get("density_at"));
        place.close_var("features", &features_at, file.get("features_at"));
        let loss =
            contract(&density_at, &file.tensor("cot_density")) + contract(&features_at, &file.tensor("cot_features"));
        let gradients = loss.backward().unwrap();
        for (name, leaf) in [("g_density", &density), ("g_features", &features)] {
            place.close_gradient(name, &channels_first(gradients.wrt(leaf).unwrap()), file.get(name));
        }
        // opacity over a length of 1, and the gradient of its sum
        let shift = file.number("act_shift");
        let raw = place.leaf(&tape, &file.tensor("density_at"));
        let lengths = file.names().filter_map(|name| name.strip_prefix("alpha_delta_")?.parse::<f64>().ok());
        for length in lengths.collect::<Vec<f64>>() {
            let alpha = raw.density_to_alpha(shift, length);
            place.close_var("alpha", &alpha, file.get(&format!("alpha_delta_{length}")));
            let name = format!("g_raw_from_alpha_delta_{length}");
            if file.has(&name) {
                let loss = contract(&alpha, &file.tensor("cot_density"));
                let found = loss.backward().unwrap().wrt(&raw).unwrap().to_vec().unwrap();
                place.close_gradient("g_raw", &found, file.get(&name));
            }
        }
    }
}

#[test]
fn lookups_move_with_their_points_as_central_differences_say() {
    let file = File::load("grid_query");
    let grid = grid_of(&file, "density", 0.04);
    let inside: Vec<f64> = file.points("points").into_iter().filter(|x| grid.contains(*x)).take(20).flatten().collect();
    let points = Tensor::from_vec(inside.clone(), [inside.len() / 3, 3]);
    let features = file.grid("features");
    let report = gradreel::GradCheck::default()
        .function("lookup", &[("points", points)], |tape, v| grid.lookup(&tape.constant(features.clone()), &v[0]))
        .unwrap();
    assert!(report.passed(), "{report}");
}

#[test]
fn opacity_of_raw_density() {
    let file = File::load("raw2alpha");
    let shift = file.number("act_shift");
    assert!((opacity_shift(file.number("alpha_init")) - shift).abs() < 1e-12);
    for place in places() {
        let lengths = file.names().filter_map(|name| name.strip_prefix("alpha_")?.parse::<f64>().ok());
        let lengths: Vec<f64> = lengths.collect();
        assert!(!lengths.is_empty());
        for length in lengths {
            let tape = Tape::new();
            let raw = place.leaf(&tape, &file.tensor("raw"));
            let alpha = raw.density_to_alpha(shift, length);
            place.close_var("alpha", &alpha, file.get(&format!("alpha_{length}")));
            let gradients = alpha.sum_all().backward().unwrap();
            let found = gradients.wrt(&raw).unwrap().to_vec().unwrap();
            place.close_gradient("gradient", &found, file.get(&format!("grad_exact_{length}")));
        }
    }
}

#[test]
fn refinement_halves_the_spacing_in_a_tighter_box() {
    let file = File::load("grid_scale");
    let kept = file.dims("new_features")[0];
    let grid = grid_of(&file, "density", file.number("old_dx"));
    let features = file.grid("features");
    let mut field = RadianceField {
        grid,
        base_spacing: file.number("old_dx"),
        shift: file.number("act_shift"),
        sizes: RadianceSizes { features: features.dims()[3], ..RadianceSizes::default() },
    };
    let params: Params =
        [("radiance.density".to_owned(), file.grid("density")), ("radiance.features".to_owned(), features)]
            .into_iter()
            .collect();
    let (refined, occupancy) = field.refined(&params, 1e-7).unwrap().unwrap();
    assert_eq!(field.grid.dims, file.nodes("new_density"));
    let place = &places()[0];
    place.close("low", &field.grid.low, file.get("new_xyz_min"));
    place.close("high", &field.grid.high, file.get("new_xyz_max"));
    assert!((field.grid.spacing - file.number("new_dx")).abs() < 1e-12);
    place.close("density", &refined.get("radiance.density").unwrap().to_vec().unwrap(), file.get("new_density"));
    let found = channels_first(refined.get("radiance.features").unwrap());
    place.close("features", &found[..kept * field.grid.len()], file.get("new_features"));
    let found: Vec<f64> = occupancy.occupied.iter().map(|&o| f64::from(u8::from(o))).collect();
    assert_eq!(found, file.get("new_occupancy"));
}

#[test]
fn gradient_of_the_total_variation() {
    let file = File::load("tv");
    let weight = file.number("weight");
    for place in places() {
        let grid = place.tensor(&file.grid("grid"));
        let found = variation_gradient(&grid, weight).unwrap().to_vec().unwrap();
        place.close_gradient("dense", &found, file.get("g_dense"));
        let before = place.tensor(&file.grid("g_before_sparse"));
        let found = with_variation(&before, &grid, weight, Reach::Sparse).unwrap().to_vec().unwrap();
        place.close_gradient("sparse", &found, file.get("g_after_sparse"));
    }
}

#[test]
fn grids_of_a_count_of_nodes_and_bad_boxes() {
    let grid = DenseGrid::of_count([0.0; 3], [1.0, 2.0, 0.5], 64_000).unwrap();
    assert_eq!(grid.dims, [40, 80, 20]);
    assert!((grid.spacing - 0.025).abs() < 1e-12);
    assert_eq!(grid.nodes()[grid.len() - 1], [1.0, 2.0, 0.5]);
    for (high, spacing) in [([1.0, -1.0, 1.0], 0.1), ([1.0; 3], 5.0), ([1.0; 3], 1e-5), ([f64::NAN; 3], 0.1)] {
        assert!(DenseGrid::of_spacing([0.0; 3], high, spacing).is_err(), "{high:?}");
    }
    // what a grid holds at its own nodes is what it holds
    let tape = Tape::new();
    let values = gradreel::ops::uniform(1, [40, 80, 20, 2], -1.0..1.0);
    let again = grid.resampled(&tape.constant(values.clone()), &grid).unwrap();
    let (found, wanted) = (again.value().unwrap().to_vec().unwrap(), values.to_vec().unwrap());
    assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-9));
    assert_eq!(turned(&turned(&wanted, 40), 64_000 * 2 / 40), wanted);
    assert_eq!((values.dtype(), values.device()), (DType::F64, Device::Cpu));
}
