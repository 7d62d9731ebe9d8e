//! The denoiser, the autoencoder and the CLIP tower.

use crate::views::{Autoencoder, AutoencoderSizes, Bicubic, ClipSizes, ClipTower, Unet, UnetSizes};

use super::harness::{Tolerance, check};

#[test]
fn denoiser() {
    let tolerance = Tolerance { value: 5e-5, gradient: 1e-3 };
    check("unet_small", "model.diffusion_model.", tolerance, |case| {
        let sizes = UnetSizes {
            inputs: case.dims("in.x")[1],
            outputs: case.dims("out.eps")[1],
            base: case.size("mc"),
            multipliers: case.sizes("mult"),
            heads: case.size("heads"),
            context: case.size("ctx"),
            volumes: case.sizes("vdims"),
        };
        let net = Unet::new(&case.scope().at("model.diffusion_model"), &sizes)?;
        let width = case.input("x").dims()[3];
        let volumes = [1, 2, 4, 8].map(|factor| case.input(&format!("volume_{}", width / factor)));
        let mut results = Vec::new();
        let noise = net.forward_watched(
            &case.input("x"),
            &case.numbers("t"),
            &case.input("context"),
            Some(&volumes),
            &mut |name, value| results.push((format!("mid.{name}"), value.clone())),
        )?;
        results.push(("out.eps".into(), noise));
        Ok(results)
    });
}

#[test]
fn autoencoder() {
    check("autoencoder", "", Tolerance { value: 2e-5, gradient: 2e-4 }, |case| {
        let multipliers: Vec<usize> = serde_json::from_value(case.setting("ch_mult")).unwrap();
        let sizes = AutoencoderSizes {
            base: case.size("ch"),
            multipliers,
            blocks: case.size("num_res_blocks"),
            latent: case.size("z_channels"),
        };
        let net = Autoencoder::new(&case.scope(), &sizes)?;
        let moments = net.moments(&case.input("image"));
        let posterior = net.encode(&case.input("image"));
        let latent = &case.input("scaled_latent_to_decode") / Autoencoder::SCALE;
        Ok(vec![
            ("out.moments".into(), moments),
            ("out.mean".into(), posterior.mean.clone()),
            ("out.logvar".into(), posterior.log_variance.clone()),
            ("out.std".into(), posterior.deviation()),
            ("out.decoded".into(), net.decode(&latent)),
        ])
    });
}

#[test]
fn clip_vision_tower() {
    check("clip_vision", "", Tolerance { value: 5e-5, gradient: 5e-4 }, |case| {
        let sizes = ClipSizes {
            resolution: case.size("input_resolution"),
            patch: case.size("patch"),
            width: case.size("width"),
            layers: case.size("layers"),
            heads: case.size("heads"),
            outputs: case.size("output_dim"),
        };
        let tower = ClipTower::new(&case.scope(), sizes)?;
        let side = sizes.resolution;
        let resized = Bicubic::Aligned.resize(&case.input("image"), side, side)?;
        let normalised = ClipTower::normalise(&resized)?;
        let embedding = tower.forward(&normalised);
        Ok(vec![
            ("mid.resized".into(), resized),
            ("mid.normalized".into(), normalised),
            ("out.embedding".into(), embedding),
        ])
    });
}
