//! The temporal field against vectors of the published one, and its own switches.

use crate::field::temporal::{RayTargets, TemporalField, TemporalSettings, TemporalWeights};
use crate::field::{DenseGrid, RadianceSizes, opacity_shift};
use crate::layers::Scope;
use crate::render::{PixelLoss, Rays};
use gradreel::optim::Params;
use gradreel::{DType, Key, Tape, Tensor};

use super::harness::{File, Place, channels_first, places};

fn field_of(file: &File) -> TemporalField {
    let number = |name: &str| file.number(name);
    let shift = number("act_shift");
    let settings = TemporalSettings {
        width: number("net_width") as usize,
        channels: number("voxel_dim") as usize,
        time_features: file.dims("time_feature")[1],
        position_levels: number("posbase_pe") as usize,
        time_levels: number("timebase_pe") as usize,
        feature_levels: number("gridbase_pe") as usize,
        view_levels: number("viewbase_pe") as usize,
        opacity: 1.0 / (1.0 + (-shift).exp()),
        step: number("stepsize"),
        near: number("near"),
        far: number("far"),
        threshold: number("fast_color_thres"),
        background: number("bg"),
        ..TemporalSettings::published()
    };
    let spacing = number("voxel_size");
    let grid = DenseGrid {
        low: file.triple("xyz_min"),
        high: file.triple("xyz_max"),
        dims: file.nodes("param.feature"),
        spacing,
    };
    TemporalField { settings, grid, base_spacing: spacing / number("voxel_size_ratio"), mask: None }
}

fn params_of(file: &File, field: &TemporalField, place: &Place) -> Params {
    let mut params = field.initialise(Key::new(1), DType::F32).unwrap();
    let paths: Vec<String> = params.iter().map(|(path, _)| path.to_owned()).collect();
    assert_eq!(paths.len(), file.names().filter(|name| name.starts_with("param.")).count());
    for path in paths {
        let name = path.replace("temporal.", "param.");
        let value = if path == "temporal.feature" { file.grid(&name) } else { file.tensor(&name) };
        params.set(path, place.tensor(&value));
    }
    params
}

#[test]
fn a_moving_field_its_pictures_and_gradients() {
    let file = File::load("temporal_field");
    let field = field_of(&file);
    assert!((opacity_shift(field.settings.opacity) - file.number("act_shift")).abs() < 1e-12);
    for place in places() {
        let params = params_of(&file, &field, &place);
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let net = field.net(&Scope::root(&bound)).unwrap();

        let points = place.constant(&tape, &file.tensor("probe_points"));
        let moments = net.moments(&points, file.get("probe_time")).unwrap();
        let every: Vec<u32> = (0..points.dims()[0] as u32).collect();
        let every = Tensor::from_vec(every, [points.dims()[0]]).to_device(&place.device).unwrap();
        let found = net.at(&points, &moments, &tape.constant(every)).unwrap();
        place.close_var("bent", &found.bent, file.get("probe_deformed"));
        place.close_var("interpolated", &found.interpolated, file.get("probe_voxel_feature"));
        place.close_var("hidden", &found.hidden, file.get("probe_hidden"));
        place.close_var("density", &found.density, file.get("probe_raw_density"));
        let encoded = points.positional_encoding(field.settings.position_levels);
        place.close_var("encoded", &encoded, file.get("probe_embedding"));

        let rays = Rays { origins: file.points("rays_o"), directions: file.points("rays_d") };
        let moments = net.moments(&points, file.get("times")).unwrap();
        place.close_var("time feature", moments.features().unwrap(), file.get("time_feature"));
        let moment_of: Vec<u32> = (0..rays.len() as u32).collect();
        let seen = field.render(&bound, &rays, &moment_of, file.get("times")).unwrap();
        assert_eq!(seen.looked_at as f64, file.number("n_samples"));
        place.close_var("rgb", &seen.pixels.rgb, file.get("rgb"));
        place.close_var("left", &seen.pixels.left, file.get("alphainv_last"));
        place.close_var("depth", &seen.pixels.depth, file.get("depth"));
        let weights = TemporalWeights {
            entropy: file.number("w_entropy"),
            samples: file.number("w_rgbper"),
            offsets: 0.0,
            pixels: PixelLoss::default(),
        };
        let targets = RayTargets {
            colours: file.tensor("target"),
            weight: Tensor::full(1.0, [rays.len()], DType::F64),
            imagined: None,
        };
        let loss = seen.loss(&targets, &weights).unwrap();
        place.close_var("pixels", &loss.pixels, file.get("loss_mse"));
        place.close_var("entropy", &loss.entropy, file.get("loss_entropy"));
        place.close_var("samples", &loss.samples, file.get("loss_rgbper"));
        place.close_var("loss", &loss.total, file.get("loss"));
        for (path, gradient) in bound.gradients(&loss.total.backward().unwrap()).unwrap() {
            let found = if path == "temporal.feature" { channels_first(&gradient) } else { gradient.to_vec().unwrap() };
            place.close_gradient(&path, &found, file.get(&path.replace("temporal.", "grad.")));
        }
    }
}

fn small(settings: TemporalSettings) -> (TemporalField, Params) {
    let sizes = TemporalSettings { width: 8, channels: 3, time_features: 4, ..settings };
    let grid = DenseGrid::of_spacing([-0.5, 0.0, -0.5], [0.5, 1.0, 0.5], 0.2).unwrap();
    let field = TemporalField::new(grid, sizes);
    let mut params = field.initialise(Key::new(3), DType::F64).unwrap();
    for (i, path) in
        ["temporal.feature", "temporal.density", "temporal.deformation_net._time_out.weight"].into_iter().enumerate()
    {
        if let Ok(value) = params.get(path) {
            let shape = value.shape().clone();
            params.set(path, gradreel::ops::uniform(i as u64, shape, -0.5..0.5));
        }
    }
    (field, params)
}

#[test]
fn the_first_frame_is_where_the_grid_is() {
    let (field, params) = small(TemporalSettings::default());
    let points = field.grid.nodes();
    let bent = |time: f64| {
        let mut all = Vec::new();
        field
            .probe(&params, &points, time, |sample| {
                all.extend(sample.bent.value()?.to_vec()?);
                Ok(())
            })
            .unwrap();
        all
    };
    assert_eq!(bent(0.0), points.as_flattened());
    let moved = bent(0.7).iter().zip(points.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved > 1e-2, "{moved}");
    // the still field of the first frame has its densities
    let (still, baked) = field
        .baked(&params, field.grid.clone(), RadianceSizes { features: 5, ..RadianceSizes::default() }, Key::new(1))
        .unwrap();
    let density = field.density_at(&params, &points, 0.0).unwrap();
    assert_eq!(baked.get("radiance.density").unwrap().to_vec().unwrap(), density);
    assert_eq!(baked.get("radiance.features").unwrap().dims()[3], 5);
    assert_eq!(still.shift, opacity_shift(field.settings.opacity));
}

#[test]
fn without_time_all_frames_are_alike() {
    let (field, params) = small(TemporalSettings { time: false, ..TemporalSettings::default() });
    assert!(params.iter().all(|(path, _)| !path.contains("time")));
    let points = field.grid.nodes();
    let at = |time: f64| field.density_at(&params, &points, time).unwrap();
    assert_eq!(at(0.0), at(1.0));
    let (field, params) = small(TemporalSettings::default());
    let at = |time: f64| field.density_at(&params, &points, time).unwrap();
    assert_ne!(at(0.0), at(1.0));
}

#[test]
fn gradients_of_every_switch_agree_with_central_differences() {
    let rays = Rays {
        origins: vec![[-2.0, 0.41, 0.13], [0.1, 2.0, 1.9], [1.7, 0.9, 0.2]],
        directions: vec![[1.0, 0.05, 0.02], [-0.05, -0.8, -1.0], [-1.0, -0.2, -0.1]],
    };
    let targets = RayTargets {
        colours: gradreel::ops::uniform(5, [3, 3], 0.0..1.0),
        weight: Tensor::from_vec(vec![1.0, 0.5, 1.5], [3]),
        imagined: Some(Tensor::from_vec(vec![0.0, 1.0, 0.0], [3])),
    };
    // no thresholds, so that no sample comes or goes within a difference; offsets count their opaque samples
    let sharp = TemporalSettings { threshold: 0.0, stop: 0.0, opacity: 0.1, ..TemporalSettings::default() };
    // the weights in the term of single samples are not differentiated, on purpose
    let weights = TemporalWeights { entropy: 0.1, samples: 0.0, offsets: 0.2, ..TemporalWeights::default() };
    let variants = [
        sharp.clone(),
        TemporalSettings { time: false, ..sharp.clone() },
        TemporalSettings { merged: false, ..sharp.clone() },
        TemporalSettings { explicit_density: false, feature_levels: 1, normalised: false, ..sharp },
    ];
    for settings in variants {
        let (field, params) = small(settings);
        let paths: Vec<String> = params.iter().map(|(path, _)| path.to_owned()).collect();
        let inputs: Vec<(&str, Tensor)> = params.iter().map(|(path, value)| (path, value.clone())).collect();
        let check = gradreel::GradCheck { entries: 6, tolerance: 1e-5, ..gradreel::GradCheck::default() };
        let report = check
            .function("temporal field", &inputs, |_, vars| {
                let net = Given(paths.iter().map(String::as_str).zip(vars).collect());
                let seen = field.render_with(&net, &vars[0], &rays, &[0, 1, 2], &[0.0, 0.4, 1.0])?;
                Ok(seen.loss(&targets, &weights)?.total)
            })
            .unwrap();
        assert!(report.passed(), "{report}");
    }
}

/// Variables by path.
struct Given<'a>(std::collections::BTreeMap<&'a str, &'a gradreel::Var>);

impl crate::layers::Weights for Given<'_> {
    fn weight(&self, path: &str, _: &gradreel::Shape, _: crate::layers::Init) -> gradreel::Result<gradreel::Var> {
        Ok(self.0[path].clone())
    }
}
