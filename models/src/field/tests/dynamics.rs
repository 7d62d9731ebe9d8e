//! The dynamic step: from material parameters to pixels and back.

use crate::field::RadianceField;
use crate::identify::{FramePixels, MotionSettings, body_of, dynamic_step};
use crate::particles::{Jitter, Seeding};
use crate::physics::{Collider, Contact, Law, Map, Schedule, World, materials};
use crate::render::Rays;
use gradreel::{DType, Device, Tape, Tensor, Var};

use super::grids::grid_of;
use super::harness::{File, places};
use super::rendering::{params_of, settings_of, sizes_of};

/// The law of a file's material, and the name of each parameter's raw value.
fn law_of(file: &File) -> (Law, Vec<&'static str>) {
    let (name, raw): (&str, &[&str]) = match file.setting("material").as_str().unwrap() {
        "elasticity" => ("neo_hookean", &["log10_E", "nu_raw"]),
        "viscous_fluid" => ("newtonian", &["log10_mu", "log10_kappa"]),
        "von_mises" if file.has("raw.log10_mu") => {
            ("viscoplastic", &["log10_mu", "log10_kappa", "log10_yield_stress", "log10_eta"])
        }
        "von_mises" => ("von_mises", &["log10_E", "nu_raw", "log10_yield_stress"]),
        "drucker_prager" => ("drucker_prager", &["log10_E", "nu_raw", "friction_angle", "cohesion"]),
        other => panic!("no law for {other}"),
    };
    (materials::find(name).unwrap(), raw.to_vec())
}

fn world_of(file: &File) -> World {
    let triple = |value: &serde_json::Value| -> [f64; 3] { std::array::from_fn(|i| value[i].as_f64().unwrap()) };
    let contact = |value: &serde_json::Value| {
        [Contact::Sticky, Contact::Slip, Contact::Separate][usize::try_from(value.as_u64().unwrap()).unwrap()]
    };
    let colliders = file.setting("colliders").as_array().unwrap().iter().map(|c| match c[0].as_str().unwrap() {
        "plane" => Collider::plane(triple(&c[1]), triple(&c[2]), contact(&c[3])),
        _ => Collider::cylinder(triple(&c[1]), triple(&c[2]), c[3].as_f64().unwrap(), contact(&c[4])),
    });
    let gravity = triple(file.setting("gravity"));
    World { colliders: colliders.collect(), gravity, ..World::new(file.number("dx")) }
}

/// The physical value of a raw parameter.
fn value_of(file: &File, name: &str, raw: &Var) -> Var {
    if name.starts_with("log10") {
        return (raw * std::f64::consts::LN_10).exp();
    }
    if name == "nu_raw" {
        let bounds: Vec<f64> = serde_json::from_value(file.setting("nu_bounds").clone()).unwrap();
        let map = Map::Bounded { low: bounds[0], high: bounds[1] };
        let half = (bounds[1] - bounds[0]) / 2.0;
        let value = (raw / half).tanh() * half + (bounds[0] + half);
        let number = map.value(raw.item().unwrap());
        assert!((value.item().unwrap() - number).abs() < 1e-6);
        return value;
    }
    raw.clone()
}

fn frames_of(file: &File) -> Vec<FramePixels> {
    let count = file.setting("frames").as_u64().unwrap() as usize;
    let rays = file.dims("rays_o")[1];
    let part = |name: &str, f: usize| file.points(name)[f * rays..(f + 1) * rays].to_vec();
    let frame = |f: usize| FramePixels {
        rays: Rays { origins: part("rays_o", f), directions: part("rays_d", f) },
        target: Tensor::from_vec(part("target", f).into_flattened(), [rays, 3]),
        weight: Tensor::from_vec(file.get("ray_mask")[f * rays..(f + 1) * rays].to_vec(), [rays]),
    };
    (0..count).map(frame).collect()
}

fn dynamic(name: &str) {
    let file = File::load(name);
    let (law, names) = law_of(&file);
    let field = RadianceField {
        grid: grid_of(&file, "density", file.number("dx")),
        base_spacing: file.number("dx_base"),
        shift: file.number("act_shift"),
        sizes: sizes_of(&file),
    };
    let settings = MotionSettings { radiance: settings_of(&file), ..MotionSettings::default() };
    let frames = frames_of(&file);
    let substeps = file.number("substeps_per_frame") as usize;
    let schedule = Schedule { frames: frames.len(), frame_dt: file.number("dt") * substeps as f64, substeps };
    for place in places() {
        let place = place.allowing([1e-9, 1e-5], [1e-4, 2e-2]);
        let mut params = params_of(&file, &place);
        params.freeze("radiance").unwrap();
        let occupancy = field.occupancy(&params, settings.radiance.threshold).unwrap();
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let jitter = Jitter::Given(file.points("jitter_unit"));
        let seeded = Seeding::default().seed(&occupancy, &field.values(&bound).unwrap(), field.shift, &jitter).unwrap();
        place.close_var("positions", &seeded.positions, file.get("positions"));
        place.close_var("alpha", &seeded.opacity, file.get("alpha"));
        place.close_var("features", &seeded.features, file.get("particle_features"));
        let here = |name: &str| tape.leaf(file.tensor(name).cast(place.dtype).unwrap());
        let velocity = here("velocity");
        let raw: Vec<Var> = names
            .iter()
            .map(|name| match file.has(&format!("raw.{name}")) {
                true => here(&format!("raw.{name}")),
                false => tape.constant(Tensor::full(file.number(name), [1], place.dtype)),
            })
            .collect();
        let values: Vec<Var> = names.iter().zip(&raw).map(|(name, raw)| value_of(&file, name, raw)).collect();
        let body = body_of(&seeded, &velocity, &law, &values, file.number("rho"));
        let net = field.colours(&bound).unwrap();
        let (motion, loss) =
            dynamic_step(&body, &seeded.features, &world_of(&file), &law, schedule, &field, &net, &frames, &settings)
                .unwrap();
        for f in 0..frames.len() {
            let positions = motion.select(0, f);
            place.allowing([1e-9, 0.0], [2e-6, 0.0]).close_var("x", &positions, file.get(&format!("x_frame{f}")));
            let first: Vec<f64> = loss.first_nodes[f].iter().map(|&i| i as f64).collect();
            assert_eq!(first, file.get(&format!("min_index_frame{f}")), "frame {f} on {}", place.name);
            // single samples at a surface may fall on the other side of a threshold in single precision
            let (found, wanted) = (loss.pixels[f].rgb.value().unwrap().to_vec().unwrap(), format!("rgb_frame{f}"));
            if place.dtype == DType::F64 {
                place.close("rgb", &found, file.get(&wanted));
            } else {
                place.allowing([0.0; 2], [0.0, 1e-3]).close_gradient("rgb", &found, file.get(&wanted));
            }
        }
        let per_frame: Vec<f64> = loss.frames.iter().map(|loss| loss.item().unwrap()).collect();
        place.close("losses", &per_frame, file.get("loss_per_frame"));
        place.close_var("loss", &loss.total, file.get("loss"));
        let gradients = loss.total.backward().unwrap();
        let of = |leaf: &Var| gradients.wrt(leaf).unwrap().to_device(&Device::Cpu).unwrap().to_vec().unwrap();
        place.close_gradient("g_velocity", &of(&velocity), file.get("g_velocity"));
        for (name, raw) in names.iter().zip(&raw).filter(|(_, raw)| raw.is_differentiable()) {
            place.close_gradient(name, &of(raw), file.get(&format!("g_raw.{name}")));
        }
    }
}

/// Files that have no test of their own, as others may bring.
#[test]
fn all_other_files() {
    let known = ["dynamic_elastic", "dynamic_newtonian", "dynamic_plasticine"];
    File::others("dynamic_", &known).iter().for_each(|name| dynamic(name));
}

#[test]
fn an_elastic_body_from_parameters_to_pixels() {
    dynamic("dynamic_elastic");
}

#[test]
fn a_fluid_from_parameters_to_pixels() {
    dynamic("dynamic_newtonian");
}

#[test]
fn plasticine_from_parameters_to_pixels() {
    dynamic("dynamic_plasticine");
}
