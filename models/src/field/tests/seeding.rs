//! Particles of a field, and features on the grid around them.

use crate::field::Occupancy;
use crate::particles::{Jitter, Seeding};
use crate::render::{FeatureSplat, splat_features};
use gradreel::Tape;

use super::grids::grid_of;
use super::harness::{File, channels_first, contract, places};

#[test]
fn particles_of_occupied_nodes_and_their_gradients() {
    let file = File::load("particles");
    let shift = file.number("act_shift");
    let grid = grid_of(&file, "density", file.number("dx"));
    let mut occupancy = Occupancy::full(grid);
    occupancy.update(file.get("density"), shift, file.number("fast_color_thres"));
    let found: Vec<f64> = occupancy.occupied.iter().map(|&o| f64::from(u8::from(o))).collect();
    assert_eq!(found, file.get("occupancy"));
    let [low, high] = occupancy.bounds().unwrap();
    let jitter = Jitter::Given(file.points("jitter_unit"));
    let seeding = Seeding { least_opacity: file.number("mask_thres"), ..Seeding::default() };
    for place in places() {
        place.close("low", &low, file.get("occ_xyz_min"));
        place.close("high", &high, file.get("occ_xyz_max"));
        let tape = Tape::new();
        let [density, features] = ["density", "features"].map(|name| place.leaf(&tape, &file.grid(name)));
        let seeded = seeding.seed(&occupancy, &density.concat(&[&features], 3), shift, &jitter).unwrap();
        place.close_var("positions", &seeded.positions, file.get("positions"));
        place.close_var("alpha", &seeded.opacity, file.get("alpha"));
        place.close_var("features", &seeded.features, file.get("particle_features"));
        let loss = contract(&seeded.opacity, &file.tensor("cot_alpha"))
            + contract(&seeded.features, &file.tensor("cot_features"));
        let gradients = loss.backward().unwrap();
        for (name, leaf) in [("g_density", &density), ("g_features", &features)] {
            place.close_gradient(name, &channels_first(gradients.wrt(leaf).unwrap()), file.get(name));
        }
    }
}

#[test]
fn exact_places_are_half_a_spacing_apart() {
    let file = File::load("particles");
    let grid = grid_of(&file, "density", file.number("dx"));
    let places = Seeding { exact: true, ..Seeding::default() }.places(&Occupancy::full(grid.clone()));
    let [nx, ny, nz] = grid.dims;
    assert_eq!(places.len(), 8 * (nx - 1) * (ny - 1) * (nz - 1));
    assert!((places[1][2] - places[0][2] - grid.spacing / 2.0).abs() < 1e-12);
    let far = places[places.len() - 1];
    assert!((0..3).all(|axis| (grid.high[axis] - far[axis] - grid.spacing / 2.0).abs() < 1e-9), "{far:?}");
}

#[test]
fn features_on_the_grid_of_moving_particles() {
    let file = File::load("splat");
    let settings = FeatureSplat { least_weight: file.number("threshold"), empty: file.number("fill") };
    for place in places() {
        let tape = Tape::new();
        let [x, features] = ["x", "feature"].map(|name| place.leaf(&tape, &file.tensor(name)));
        let found = splat_features(&x, &features, file.number("dx"), &settings).unwrap();
        let first: Vec<f64> = found.first.iter().map(|&i| i as f64).collect();
        assert_eq!(first, file.get("min_index"));
        let last: Vec<f64> = (0..3).map(|a| first[a] + found.grid.dims[a] as f64 - 1.0).collect();
        assert_eq!(last, file.get("max_index"));
        let values = channels_first(found.values.value().unwrap());
        place.close_grid("grid", &values, file.get("grid"), settings.empty);
        place.close("weight", &channels_first(found.weight.value().unwrap()), file.get("weight_sum"));
        let gradients = contract(&found.values, &file.grid("cot_grid")).backward().unwrap();
        let of = |leaf| gradients.wrt(leaf).unwrap().to_vec().unwrap();
        place.close_gradient("g_feature", &of(&features), file.get("g_feature"));
        // nodes that a tail touches dominate
        place.allowing([0.0, 1e-8], [0.0, 1e-2]).close_gradient("g_x", &of(&x), file.get("g_x"));
    }
}
