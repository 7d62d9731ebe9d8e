//! A multi-view model as small as its layers allow, with weights of noise, and pictures for it.

use std::fs;
use std::path::Path;

use gradreel::io::TensorFile;
use gradreel::{DType, Key, Tensor};
use gradreel_models::views::ModelSizes;

const SIZES: &str = r#"{
    "image": 16,
    "denoiser": {
        "ring": {"views": 4, "elevation": 0.5, "distance": 1.5, "focal": 1.1, "half": 0.5},
        "unet": {"inputs": 8, "outputs": 4, "base": 32, "multipliers": [1, 1, 1, 1], "heads": 2, "context": 8,
                 "volumes": [8, 8, 16, 16]},
        "volume": {"latent": 4, "features": 4, "time": 16, "spatial": [8, 8, 16, 16], "frustum": [8, 8, 16, 16],
                   "voxels": 8, "depth": 8}
    },
    "autoencoder": {"base": 32, "multipliers": [1, 1], "blocks": 1, "latent": 4},
    "clip": {"resolution": 14, "patch": 7, "width": 16, "layers": 1, "heads": 2, "outputs": 8}
}"#;

/// The file of weights.
pub fn weights() -> TensorFile {
    let mut file = TensorFile::default();
    for (path, shape) in ModelSizes::from_json(SIZES).unwrap().weights().unwrap() {
        let key = path.bytes().fold(Key::new(3), |key, byte| key.fold(u64::from(byte)));
        let [inputs, shift] = match shape.dims() {
            [_] => [100, usize::from(path.ends_with("weight"))],
            dims => [dims[1..].iter().product(), 0],
        };
        let value = |z: f64| (z / (inputs as f64).sqrt()) as f32 + shift as f32;
        let values: Vec<f32> = key.normal(shape.len()).map(value).collect();
        file.tensors.insert(path, Tensor::from_vec(values, shape).cast(DType::F32).unwrap());
    }
    file.metadata.insert(ModelSizes::METADATA.into(), SIZES.into());
    file
}

/// A PNG of a red ball with a highlight, on what `background` says (transparent where alpha is 0).
pub fn ball(path: impl AsRef<Path>, background: [u8; 4]) {
    let side = 40u32;
    let pixel = |i: u32| {
        let (x, y) = (f64::from(i % side) - 19.5, f64::from(i / side) - 18.5);
        match (x * x + y * y, (x + 4.0).abs() + (y + 5.0).abs()) {
            (distance, _) if distance > 150.0 => background,
            (_, highlight) if highlight < 3.0 => [250, 200, 190, 255],
            (distance, _) => [220 - distance as u8, 40, 30, 255],
        }
    };
    let pixels: Vec<u8> = (0..side * side).flat_map(pixel).collect();
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), side, side);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}
