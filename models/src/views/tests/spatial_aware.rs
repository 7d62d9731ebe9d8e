//! The spatial-aware module: its parts against stored numbers, that it changes nothing before it is trained, and that nothing
//! else is trained.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::layers::{Init, Scope, Weights, listing};
use crate::views::spatial_aware::epipolar::{EpipolarAttention, EpipolarLines};
use crate::views::spatial_aware::{combine, gather};
use crate::views::training::Batch;
use crate::views::{
    Denoiser, DenoiserSizes, Detection, FileWeights, ImageBox, ModelSizes, Plan, Ring, SpatialAwareSizes, Training,
    UnetSizes, VolumeSizes,
};
use gradreel::io::TensorFile;
use gradreel::{DType, Device, Result, Shape, Tensor, Var};

use super::harness::{Case, Tolerance, check, close, load, places};
use super::procedural;

fn vector_sizes(case: &Case<'_>) -> SpatialAwareSizes {
    SpatialAwareSizes {
        features: case.size("channels"),
        heads: case.size("heads"),
        samples: case.size("samples"),
        neighbours: serde_json::from_value(case.setting("neighbour_offsets")).unwrap(),
        octaves: case.size("depth_octaves"),
        widths: [16; 4],
        least: case.setting("epsilon").as_f64().unwrap(),
        margin: 0.0,
    }
}

/// The cameras of the vectors.
fn vector_ring(case: &Case<'_>) -> Ring {
    Ring::published(case.dims("in.poses")[0])
}

/// The box of the vectors, which is in pixels of 256.
fn vector_box(case: &Case<'_>) -> Detection {
    let [left, top, right, bottom] = case.numbers("box_xyxy")[..] else { panic!("four sides") };
    ImageBox { low: [left / 256.0, top / 256.0], high: [right / 256.0, bottom / 256.0] }.into()
}

#[test]
fn attention_gathering_and_weights() {
    check("spatial_aware", "", Tolerance { value: 5e-5, gradient: 5e-4 }, |case| {
        let (sizes, ring) = (vector_sizes(case), vector_ring(case));
        let attention = EpipolarAttention::new(&case.scope(), &sizes)?;
        let alone = |name: &str| case.input(name).reshape([&[1][..], case.dims(&format!("in.{name}"))].concat());
        let maps = attention.forward(&ring, &alone("features"))?;
        let volume = alone("base_volume");
        let elevation = case.numbers("input_elevation_rad");
        let combined = combine(&ring, &sizes, &volume, &maps, &elevation, &[Some(vector_box(case))])?;
        let of = |x: &Var| x.reshape(&x.dims()[1..]);
        Ok(vec![
            ("mid.fused_features".into(), of(&maps)),
            ("mid.general_volume".into(), of(&gather(&ring, &maps, case.size("V"))?)),
            ("out.combined".into(), of(&combined)),
        ])
    });
}

/// The weights of a case, with another map after the attention: the identity.
struct Plain<'a>(&'a Case<'a>);

impl Weights for Plain<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        if path != "o" {
            return self.0.weight(path, shape, init);
        }
        let size = shape.dims()[0];
        let identity = (0..size * size).map(|i| f64::from(u8::from(i % (size + 1) == 0))).collect::<Vec<_>>();
        Ok(self.0.tape.constant(Tensor::from_vec(identity, shape)))
    }
}

#[test]
fn lines_boxes_and_one_neighbour() {
    let file = load("spatial_aware");
    let place = &places()[0];
    let case = Case::new(&file, place);
    let (sizes, ring) = (vector_sizes(&case), vector_ring(&case));
    let [views, channels, width, _] = case.dims("in.features")[..] else { panic!("views, channels, rows, columns") };
    let (cells, samples, voxels) = (width * width, sizes.samples, case.size("V"));
    let first_neighbour = sizes.neighbours[0];
    let numbers = |name: &str| file.get(name).unwrap().to_vec().unwrap();

    // stored as row, column, sample
    let lines = EpipolarLines::new(&ring, [0, first_neighbour.rem_euclid(views as i64) as usize], samples, width);
    let (uv, valid) = (numbers("mid.view0_first_neighbour.uv"), numbers("mid.view0_first_neighbour.valid"));
    for cell in 0..cells {
        for sample in 0..samples {
            let (ours, theirs) = (sample * cells + cell, cell * samples + sample);
            assert_eq!(f64::from(u8::from(lines.valid[ours])), valid[theirs], "cell {cell}, sample {sample}");
            for axis in 0..2 {
                let (a, b) = (lines.places[ours][axis], uv[2 * theirs + axis]);
                assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "cell {cell}, sample {sample}: {a}, not {b}");
            }
        }
    }

    let (elevation, seen) = (case.numbers("input_elevation_rad")[0], vector_box(&case));
    let covered = ring.covered(voxels, elevation, &seen);
    let mask: Vec<f64> = covered.iter().map(|inside| f64::from(u8::from(*inside))).collect();
    assert_eq!(mask, numbers("mid.mask"));
    assert!(mask.contains(&0.0) && mask.contains(&1.0));
    let told = |name: &str| name.strip_prefix("mid.mask_V")?.strip_suffix("_count")?.parse::<usize>().ok();
    for (name, finer) in file.tensors.keys().filter_map(|name| Some((name, told(name)?))) {
        let inside = ring.covered(finer, elevation, &seen).into_iter().filter(|inside| *inside).count();
        assert_eq!(inside as f64, numbers(name)[0], "{name}");
    }
    // of ones and nothing else the weights are left
    let ones = case.tape.constant(Tensor::full(1.0, [1, 1, voxels, voxels, voxels], DType::F64));
    let maps = case.tape.constant(Tensor::zeros([1, views, 1, width, width], DType::F64));
    let phi = |boxes: &[Option<Detection>]| combine(&ring, &sizes, &ones, &maps, &[elevation], boxes).unwrap();
    close("phi", &phi(&[Some(seen)]).reshape([voxels; 3]).value().unwrap().clone(), file.get("mid.phi").unwrap(), 1e-6);
    for without in [&[None][..], &[]] {
        assert!(phi(without).value().unwrap().slice::<f64>().iter().all(|weight| *weight == 1.0));
    }

    let plain = Plain(&case);
    let first = SpatialAwareSizes { neighbours: vec![first_neighbour], ..sizes };
    let attention = EpipolarAttention::new(&Scope::root(&plain), &first).unwrap();
    let features = case.input("features").reshape([1, views, channels, width, width]);
    let found = &attention.forward(&ring, &features).unwrap() - &features;
    let of_view = found.select(1, 0).reshape([channels, width, width]).permute(&[1, 2, 0]);
    close("A", of_view.value().unwrap(), file.get("mid.view0_first_neighbour.A").unwrap(), 5e-5);
}

#[test]
fn a_known_distance_bounds_the_box_in_depth() {
    let (ring, elevation, size) = (Ring::published(16), 0.4, 32);
    let bounds = ImageBox { low: [0.4, 0.45], high: [0.6, 0.55] };
    let covered = |depth| ring.covered(size, elevation, &Detection { bounds, depth });
    let (flat, near, far) = (covered(None), covered(Some(1.3)), covered(Some(1.6)));
    let pose = ring.input_pose(elevation);
    let half = |depth: f64| 0.1 * depth / ring.focal;
    for (i, voxel) in ring.voxels(size).enumerate() {
        let [_, _, depth] = ring.project(&pose, voxel, 1);
        for (lifted, middle) in [(&near, 1.3), (&far, 1.6)] {
            assert_eq!(lifted[i], flat[i] && (depth - middle).abs() <= half(middle), "voxel {i} at {depth}");
        }
    }
    assert!(near.iter().filter(|inside| **inside).count() > 20 && near.iter().zip(&far).all(|(a, b)| !(a & b)));
    let sizes = SpatialAwareSizes::published();
    let tape = gradreel::Tape::new();
    let zeros = |shape: &[usize]| tape.constant(Tensor::zeros(shape, DType::F32));
    for depth in [0.0, -1.0, f64::NAN] {
        let seen = [Some(Detection { bounds, depth: Some(depth) })];
        let (volume, maps) = (zeros(&[1, 1, 8, 8, 8]), zeros(&[1, 16, 1, 8, 8]));
        let error = combine(&ring, &sizes, &volume, &maps, &[elevation], &seen).expect_err("refused");
        assert!(error.to_string().contains("far away"), "{error}");
    }
    // errors of a detector: the distance by its own share, and sides as they are without one
    let seen = Detection { bounds, depth: Some(1.5) };
    let jittered = seen.jittered(0.02, 0.1, gradreel::Key::new(3));
    assert_eq!(jittered.bounds, bounds.jittered(0.02, gradreel::Key::new(3)));
    assert!(jittered.depth != seen.depth && (jittered.depth.unwrap() - 1.5).abs() < 0.6);
    assert_eq!(seen.jittered(0.0, 0.0, gradreel::Key::new(3)), seen);
}

const SEED: &str = "spatial aware";

/// Four views of 8 × 8.
fn tiny(module: bool) -> DenoiserSizes {
    let volumes = [16; 4];
    let unet = UnetSizes { inputs: 8, outputs: 4, base: 32, multipliers: [1; 4], heads: 2, context: 8, volumes };
    let volume = VolumeSizes {
        latent: 4,
        features: 4,
        time: 16,
        spatial: volumes,
        frustum: volumes,
        voxels: 8,
        depth: 8,
        input: true,
    };
    let sizes = SpatialAwareSizes {
        features: 16,
        heads: 2,
        samples: 6,
        neighbours: vec![-1, 1],
        widths: [16; 4],
        ..SpatialAwareSizes::published()
    };
    DenoiserSizes {
        ring: Ring::published(4),
        unet,
        volume,
        spatial_aware: module.then_some(sizes),
        output: Default::default(),
    }
}

fn base(name: &str) -> PathBuf {
    let folder = super::harness::scratch("spatial_aware");
    let mut file = TensorFile::default();
    for (key, shape) in listing(|scope| Denoiser::new(scope, &tiny(false))).unwrap() {
        let value = procedural::weight(SEED, &key, &shape);
        file.tensors.insert(key, value);
    }
    let sizes = ModelSizes { denoiser: tiny(false), ..super::tiny::sizes() };
    file.metadata.insert(ModelSizes::METADATA.into(), sizes.to_json());
    let path = folder.join(name);
    file.write(&path).unwrap();
    path
}

const LEFT: ImageBox = ImageBox { low: [0.1, 0.3], high: [0.4, 0.7] };
const RIGHT: ImageBox = ImageBox { low: [0.6, 0.3], high: [0.9, 0.7] };

fn batch(seen: Option<ImageBox>) -> Batch {
    let input = |name: &str, shape: &[usize]| procedural::input(SEED, name, shape);
    Batch {
        latents: input("latents", &[2, 4, 4, 8, 8]),
        embeddings: input("embeddings", &[2, 1, 8]),
        images: input("images", &[2, 4, 8, 8]),
        elevations: vec![0.3, 0.5],
        boxes: vec![seen.map(Detection::from); 2],
    }
}

fn training(path: &PathBuf, device: &Device, module: bool, plan: Plan) -> Training {
    Training::new(FileWeights::open(path, device).unwrap(), tiny(module), plan).unwrap()
}

fn plan() -> Plan {
    Plan { warmup: 0, recomputed: false, at_once: 2, ..Plan::spatial_aware() }
}

#[test]
fn an_untrained_module_changes_no_bit() {
    let path = base("untrained.safetensors");
    for place in places() {
        if place.device == Device::Cpu && place.is_f64() {
            continue; // trainings are in f32
        }
        let base = training(&path, &place.device, false, Plan { at_once: 2, recomputed: false, ..Plan::published() });
        let with = training(&path, &place.device, true, plan());
        for seen in [Some(LEFT), None] {
            let [a, b] = [&base, &with].map(|training| training.validate(&batch(seen), 3).unwrap());
            assert_eq!(a.to_bits(), b.to_bits(), "{a} and {b}");
        }
    }
}

#[test]
fn the_module_alone_is_trained() {
    let path = base("alone.safetensors");
    let mut module = training(&path, &Device::Cpu, true, plan());
    assert!(module.params().iter().all(|(path, _)| path.starts_with("spatial_aware.")));
    let values = |training: &Training| -> BTreeMap<String, Vec<f32>> {
        training.params().iter().map(|(path, value)| (path.to_owned(), value.slice::<f32>().to_vec())).collect()
    };
    let before = values(&module);
    let untrained = module.validate(&batch(Some(LEFT)), 0).unwrap();
    assert_eq!(untrained, module.validate(&batch(Some(RIGHT)), 0).unwrap());
    module.step(&batch(Some(LEFT))).unwrap();
    // behind the first convolution that is not zero any more, everything has a gradient
    let found = module.gradients(&batch(Some(LEFT))).unwrap();
    assert!(found.by_path.keys().eq(before.keys()));
    for (path, gradient) in &found.by_path {
        assert!(gradient.slice::<f32>().iter().any(|g| *g != 0.0), "{path}");
    }
    module.step(&batch(Some(LEFT))).unwrap();
    let after = values(&module);
    assert!(before.iter().all(|(path, value)| after[path] != *value));
    let [left, right] = [LEFT, RIGHT].map(|seen| module.validate(&batch(Some(seen)), 0).unwrap());
    assert!(left != right && left != untrained, "{left}, {right}, {untrained}");

    // the whole model with its module, and all else as it was
    let exported = path.with_file_name("exported.safetensors");
    module.export(&exported).unwrap();
    let (first, last) = (TensorFile::read(&path).unwrap(), TensorFile::read(&exported).unwrap());
    for (name, tensor) in &first.tensors {
        assert_eq!(tensor.slice::<f32>(), last.tensors[name].slice::<f32>(), "{name}");
    }
    assert_eq!(last.tensors.len(), first.tensors.len() + after.len());
    let weights = FileWeights::open(&exported, &Device::Cpu).unwrap();
    let sizes = weights.sizes().unwrap().denoiser;
    assert_eq!(sizes, tiny(true));
    let again = Training::new(weights, sizes, plan()).unwrap();
    assert_eq!(again.validate(&batch(Some(LEFT)), 0).unwrap(), left);
}

#[test]
fn recomputing_and_groups_change_nothing() {
    let path = base("recomputed.safetensors");
    let gradients = |recomputed, at_once| {
        let mut training = training(&path, &Device::Cpu, true, Plan { recomputed, at_once, ..plan() });
        training.step(&batch(Some(LEFT))).unwrap();
        training.gradients(&batch(Some(RIGHT))).unwrap()
    };
    let (kept, recomputed, apart) = (gradients(false, 2), gradients(true, 2), gradients(false, 1));
    assert!(recomputed.memory.peak < kept.memory.peak);
    assert_eq!(kept.loss, recomputed.loss);
    assert!((kept.loss - apart.loss).abs() < 1e-5 * kept.loss);
    for (path, gradient) in &kept.by_path {
        close(path, &recomputed.by_path[path], gradient, 1e-5);
    }
}

#[test]
fn boxes_of_pictures() {
    let side = 8;
    let inside = |i: usize| (2..5).contains(&(i % side)) && (1..7).contains(&(i / side));
    let value = |i: usize| if inside(i % (side * side)) { [0.9f32, -0.5, 0.4][i / (side * side)] } else { 1.0 };
    let picture = |value: &dyn Fn(usize) -> f32| {
        Tensor::from_vec((0..3 * side * side).map(value).collect::<Vec<f32>>(), [1, 3, side, side])
    };
    let found = ImageBox::of_picture(&picture(&value)).unwrap().unwrap();
    assert_eq!((found.low, found.high), ([0.25, 0.125], [0.625, 0.875]));
    assert_eq!(found.centre(), [0.4375, 0.5]);
    assert!(ImageBox::of_picture(&picture(&|_| 0.95)).unwrap().is_none());
    assert!((LEFT.overlap(&LEFT) - 1.0).abs() < 1e-12);
    assert_eq!(LEFT.overlap(&RIGHT), 0.0);
    let half = ImageBox { low: [0.1, 0.3], high: [0.25, 0.7] };
    assert!((LEFT.overlap(&half) - 0.5).abs() < 1e-12);
}

#[test]
fn sizes_that_make_no_module_are_refused() {
    let whole = ModelSizes::small();
    whole.check().unwrap();
    let refused = |change: &dyn Fn(&mut SpatialAwareSizes)| {
        let mut sizes = whole.clone();
        change(sizes.denoiser.spatial_aware.as_mut().unwrap());
        sizes.check().unwrap_err().to_string()
    };
    assert!(refused(&|module| module.features = 16).contains("features"));
    assert!(refused(&|module| module.heads = 5).contains("heads"));
    assert!(refused(&|module| module.samples = 1).contains("samples"));
    assert!(refused(&|module| module.neighbours.clear()).contains("neighbours"));
    assert!(refused(&|module| module.widths[2] = 12).contains("widths"));
    assert!(refused(&|module| module.least = 2.0).contains("least"));
}

#[test]
fn the_small_model_fits_where_it_is_to_go() {
    let sizes = ModelSizes::small();
    let count: usize = sizes.weights().unwrap().iter().map(|(_, shape)| shape.len()).sum();
    // 16 bits each, beside their names
    assert!(2 * count <= 19_800_000, "{count} weights do not fit into 20 MB as f16");
    assert!(count > 5_000_000, "{count}");
    let again = ModelSizes::from_json(&sizes.to_json()).unwrap();
    assert_eq!(again, sizes);
}
