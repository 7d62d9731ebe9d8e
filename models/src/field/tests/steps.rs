//! One evaluation of the static stage.

use crate::field::{RadianceField, StaticSettings, static_step};
use crate::particles::{Jitter, Seeding};
use gradreel::Tape;

use super::grids::grid_of;
use super::harness::{File, channels_first, places};
use super::rendering::{compare_gradients, params_of, rays_of, settings_of, sizes_of};

#[test]
fn a_static_step_and_its_gradients() {
    let file = File::load("static_step");
    let field = RadianceField {
        grid: grid_of(&file, "density", file.number("dx")),
        base_spacing: file.number("dx_base"),
        shift: file.number("act_shift"),
        sizes: sizes_of(&file),
    };
    let threshold = file.number("fast_color_thres");
    let mut settings = StaticSettings {
        entropy: file.number("entropy_weight"),
        volume: file.number("volume_weight"),
        variation: 0.0,
        seeding: Seeding { least_opacity: file.number("mask_thres"), ..Seeding::default() },
        radiance: settings_of(&file),
        ..StaticSettings::default()
    };
    settings.radiance.threshold = threshold;
    let jitter = Jitter::Given(file.points("jitter_unit"));
    for place in places() {
        let params = params_of(&file, &place);
        let occupancy = field.occupancy(&params, threshold).unwrap();
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let (rays, target, mask) = (rays_of(&file), file.tensor("target"), file.tensor("ray_mask"));
        let step = static_step(&field, &bound, &occupancy, &jitter, &rays, &target, &mask, &settings).unwrap();
        place.close_var("positions", &step.particles.positions, file.get("positions"));
        place.close_var("alpha", &step.particles.opacity, file.get("alpha"));
        let first: Vec<f64> = step.observed.first.iter().map(|&i| i as f64).collect();
        assert_eq!(first, file.get("obs_min_index"));
        let values = channels_first(step.observed.values.value().unwrap());
        place.close_grid("grid", &values, file.get("obs_grid"), settings.splat.empty);
        place.close_var("rgb", &step.pixels.rgb, file.get("rgb"));
        place.close_var("left", &step.pixels.left, file.get("alphainv_last"));
        place.close_var("colour", &step.colour, file.get("loss_mse"));
        place.close_var("entropy", &step.entropy, file.get("loss_entropy"));
        place.close_var("volume", &(&step.volume * settings.volume), file.get("loss_volume"));
        let gradients = step.gradients(&bound, &params, &settings).unwrap();
        compare_gradients(&file, &place, &gradients, "g_density_without_tv");
        let varied = StaticSettings { variation: file.number("tv_weight"), ..settings.clone() };
        let gradients = step.gradients(&bound, &params, &varied).unwrap();
        place.close_gradient("density", &channels_first(&gradients["radiance.density"]), file.get("g_density"));
    }
}
