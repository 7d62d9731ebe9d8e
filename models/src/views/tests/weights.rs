//! Weights from files: in place, in their stored type, under the published names, with every difference listed.

use std::path::PathBuf;

use crate::layers::{Scope, SpatialTransformer, TransformerSizes, Weights, listing};
use crate::views::FileWeights;
use gradreel::io::{Archive, Stored, TensorFile};
use gradreel::{DType, Device, Shape, Tape, Tensor};

use super::harness::{close, load};

fn scratch(name: &str) -> PathBuf {
    super::harness::scratch("weights").join(name)
}

/// The spatial transformer of the vectors, its weights in a file of their own.
fn file(name: &str) -> (PathBuf, TransformerSizes) {
    let vectors = load("spatial_transformer");
    let mut file = TensorFile::default();
    for (key, value) in &vectors.tensors {
        if let Some(path) = key.strip_prefix("w.") {
            file.tensors.insert(path.to_owned(), value.clone());
        }
    }
    let path = scratch(name);
    file.write(&path).unwrap();
    let settings: serde_json::Value = serde_json::from_str(&vectors.metadata["hyperparameters"]).unwrap();
    let [channels, heads, context] =
        ["channels", "heads", "context_dim"].map(|name| settings[name].as_u64().unwrap() as usize);
    (path, TransformerSizes { channels, heads, context })
}

fn run(path: &PathBuf, sizes: TransformerSizes, device: &Device) -> Tensor {
    let vectors = load("spatial_transformer");
    let weights = FileWeights::open(path, device).unwrap();
    let net = SpatialTransformer::new(&Scope::root(&weights), sizes).unwrap();
    let tape = Tape::new();
    let input = |name: &str| tape.constant(vectors.get(name).unwrap().to_device(device).unwrap());
    net.forward(&input("in.x"), &input("in.context")).value().unwrap().to_device(&Device::Cpu).unwrap()
}

#[test]
fn a_layer_runs_on_weights_of_any_stored_type() {
    let (path, sizes) = file("plain.safetensors");
    let vectors = load("spatial_transformer");
    let expected = vectors.get("out.y").unwrap();
    let exact = run(&path, sizes, &Device::Cpu);
    close("f32 in place", &exact, expected, 2e-5);
    let archive = Archive::open(&path).unwrap();
    for (stored, tolerance) in [(Stored::F16, 5e-3), (Stored::Bf16, 4e-2), (Stored::F64, 2e-5)] {
        let other = scratch(&format!("{stored}.safetensors"));
        archive.rewrite(&other, |_, _| stored, |_, _| ()).unwrap();
        assert_eq!(Archive::open(&other).unwrap().entry("norm.weight").unwrap().stored, stored);
        close(&format!("{stored}"), &run(&other, sizes, &Device::Cpu), expected, tolerance);
        if let Ok(gpu) = Device::gpu() {
            close(&format!("{stored} on a GPU"), &run(&other, sizes, &gpu), expected, tolerance);
        }
    }
}

#[test]
fn weights_on_the_cpu_are_the_mapped_file() {
    let (path, sizes) = file("mapped.safetensors");
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    let shape = Shape::from([sizes.channels]);
    let tensor = || weights.tensor("norm.weight", &shape).unwrap();
    assert_eq!(tensor().slice::<f32>().as_ptr(), tensor().slice::<f32>().as_ptr());
    // changing a tensor that was made of it leaves the file alone
    let before = std::fs::read(&path).unwrap();
    let tape = Tape::new();
    let leaf = tape.leaf(tensor());
    let gradient = (&leaf + &leaf).sum_all().into_gradients().unwrap();
    assert_eq!(gradient.wrt(&leaf).unwrap().slice::<f32>(), vec![2.0; sizes.channels]);
    assert_eq!(before, std::fs::read(&path).unwrap());
}

#[test]
fn every_difference_is_in_one_message() {
    let (path, sizes) = file("odd.safetensors");
    let mut odd = TensorFile::read(&path).unwrap();
    let norm = odd.tensors.remove("norm.bias").unwrap();
    odd.tensors.insert("norm.offset".into(), norm);
    odd.tensors.insert("proj_in.bias".into(), Tensor::zeros([3], DType::F32));
    odd.tensors.insert("proj_out.bias".into(), Tensor::zeros([sizes.channels], DType::U32));
    odd.tensors.insert("betas".into(), Tensor::zeros([4], DType::F32));
    odd.tensors.insert("model_ema.decay".into(), Tensor::zeros([1], DType::F32));
    odd.write(&path).unwrap();
    let wanted = listing(|scope| SpatialTransformer::new(scope, sizes)).unwrap();
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    let report = weights.check(&wanted);
    assert_eq!(report.missing, ["norm.bias"]);
    assert_eq!(report.unexpected, ["norm.offset"]);
    assert_eq!(report.unused, ["betas", "model_ema.decay"]);
    assert_eq!((report.misshaped.len(), report.unreadable.len()), (1, 1));
    let error = report.into_result().unwrap_err().to_string();
    for part in ["odd.safetensors", "norm.bias", "norm.offset", "proj_in.bias: [3], not", "proj_out.bias: it holds u32"]
    {
        assert!(error.contains(part), "no {part:?} in {error}");
    }
    let error = SpatialTransformer::new(&Scope::root(&weights), sizes).err().unwrap().to_string();
    assert!(error.contains("odd.safetensors") && error.contains("norm.bias"), "{error}");
    let (path, _) = file("even.safetensors");
    assert!(FileWeights::open(path, &Device::Cpu).unwrap().check(&wanted).is_exact());
}

#[test]
fn the_single_view_model_keeps_its_image_encoder_elsewhere() {
    let mut file = TensorFile::default();
    let there = "cond_stage_model.model.visual.ln_post.weight";
    file.tensors.insert(there.into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    let path = scratch("elsewhere.safetensors");
    file.write(&path).unwrap();
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    let here = "clip_image_encoder.model.visual.ln_post.weight".to_owned();
    let shape = Shape::from([2]);
    let found = weights.weight(&here, &shape, crate::layers::Init::Ones).unwrap();
    assert_eq!(found.value().unwrap().slice::<f32>(), [1.0, 2.0]);
    assert!(weights.check(&[(here, shape)]).is_exact());
}

#[test]
fn a_number_beyond_f16_is_refused_by_name_and_leaves_no_file() {
    let mut file = TensorFile::default();
    file.tensors.insert("small".into(), Tensor::from_vec(vec![1.0f32, -2.0], [2]));
    file.tensors.insert("large".into(), Tensor::from_vec(vec![7e4f32, 1.0], [2]));
    file.tensors.insert("infinite".into(), Tensor::from_vec(vec![f32::INFINITY, 1.0], [2]));
    let archive = Archive::from_bytes(file.to_bytes().unwrap()).unwrap();
    let path = scratch("large.safetensors");
    // of an earlier run
    drop(std::fs::remove_file(&path));
    let error = archive.rewrite(&path, |_, _| Stored::F16, |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("large") && error.contains("7e4"), "{error}");
    assert!(!path.exists());
    archive.rewrite(&path, |_, _| Stored::Bf16, |_, _| ()).unwrap();
    assert_eq!(Archive::open(&path).unwrap().load("small").unwrap().slice::<f32>(), [1.0, -2.0]);
}

#[test]
fn the_small_checkpoints_are_rewritten_bit_for_bit() {
    let own = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/vectors");
    let of = |name: &str| crate::find::path(&own, crate::find::VIEWS, name);
    let expected = Archive::open(of("tiny_checkpoint_expected.safetensors")).unwrap();
    for name in ["tiny_lightning.ckpt", "tiny_legacy_format.ckpt"] {
        let path = scratch(&format!("{name}.safetensors"));
        let told = std::cell::Cell::new((0, 0));
        let keep = |_: &str, entry: &gradreel::io::Entry| entry.stored;
        Archive::open(of(name)).unwrap().rewrite(&path, keep, |done, all| told.set((done, all))).unwrap();
        assert!(told.get().0 == told.get().1 && told.get().0 > 0);
        let written = Archive::open(&path).unwrap();
        assert!(written.names().eq(expected.names()));
        for key in expected.names() {
            let (a, b) = (written.entry(key).unwrap(), expected.entry(key).unwrap());
            assert_eq!((a.stored, &a.shape), (b.stored, &b.shape), "{key}");
            let bits = |archive: &Archive| {
                let values = archive.load(key).unwrap().to_vec().unwrap();
                values.into_iter().map(f64::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(bits(&written), bits(&expected), "{key}");
        }
    }
    let path = scratch("forbidden.safetensors");
    let archive = Archive::open(of("tiny_forbidden_call.ckpt")).unwrap();
    let error = archive.rewrite(&path, |_, entry| entry.stored, |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("bad") && error.contains("never made"), "{error}");
}
