//! Sizes of a model as text, and which of them make a model.

use crate::layers::listing;
use crate::views::{Ensemble, Model, ModelSizes};
use gradreel::{Device, Tape};
use serde_json::{Value, json};

use super::procedural::Source;
use super::tiny;

#[test]
fn sizes_survive_their_text() {
    for sizes in [tiny::sizes(), ModelSizes::published()] {
        let again = ModelSizes::from_json(&sizes.to_json()).unwrap();
        assert_eq!(again.weights().unwrap(), sizes.weights().unwrap());
        assert_eq!(again.latent_width(), sizes.latent_width());
    }
    assert_eq!(ModelSizes::published().latent_width(), 32);
    assert_eq!(tiny::sizes().latent_width(), 8);
    let listed = listing(|scope| Model::new(scope, &tiny::sizes())).unwrap();
    assert_eq!(tiny::sizes().weights().unwrap(), listed);
    let source = Source { seed: "tiny", tape: Tape::new() };
    assert!(Ensemble::new(&source, &tiny::sizes().denoiser, &Device::Cpu, 1).is_ok());
}

#[test]
fn sizes_of_which_no_model_can_be_made_are_refused() {
    let with = |place: &str, value: Value| {
        let mut all: Value = serde_json::from_str(&tiny::sizes().to_json()).unwrap();
        *all.pointer_mut(place).unwrap_or_else(|| panic!("no {place}")) = value;
        ModelSizes::from_json(&all.to_string())
    };
    assert!(with("/image", json!(16)).is_ok());
    for (place, value, part) in [
        ("/image", json!(0), "image"),
        ("/image", json!(17), "image"),
        ("/image", json!(24), "latent width"),
        ("/image", json!(1u64 << 40), "image"),
        ("/denoiser/ring/views", json!(0), "views"),
        ("/denoiser/ring/distance", json!(0.2), "ring"),
        ("/denoiser/ring/focal", json!(-1.0), "ring"),
        ("/denoiser/unet/base", json!(40), "base"),
        ("/denoiser/unet/heads", json!(3), "heads"),
        ("/denoiser/unet/inputs", json!(4), "inputs"),
        ("/denoiser/unet/volumes", json!([8, 8, 8, 8]), "volumes"),
        ("/denoiser/unet/multipliers", json!([1, 1, 0, 1]), "multipliers"),
        ("/denoiser/volume/voxels", json!(12), "voxels"),
        ("/denoiser/volume/spatial", json!([8, 8, 12, 16]), "spatial"),
        ("/autoencoder/multipliers", json!([]), "multipliers"),
        ("/autoencoder/latent", json!(3), "latent"),
        ("/clip/patch", json!(20), "clip"),
        ("/clip/outputs", json!(9), "clip"),
        ("/clip/heads", json!(-1), "heads"),
    ] {
        let error = with(place, value.clone()).unwrap_err().to_string();
        assert!(error.contains(part), "{place} {value}: no {part:?} in {error}");
    }
    assert!(ModelSizes::from_json("{}").unwrap_err().to_string().contains("image"));
    assert!(ModelSizes::from_json("").is_err());
}
