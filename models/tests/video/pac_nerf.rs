//! PAC-NeRF's data set: its cameras and plates, and the settings that are shipped for its scenes.

use std::fs;
use std::path::Path;

use gradreel_models::identify::Config;
use gradreel_models::video::{Foreground, Format, inspect};

use super::builder::{Builder, in_square};

/// Eleven cameras with a plate of the background and one of excluded pixels each, in opaque images.
#[test]
fn eleven_cameras_with_plates() {
    let mut builder = Builder::new(24, 16);
    let ground = |x: usize, y: usize| [90 + x as u8, 110 - y as u8, 60, 255];
    for camera in 0..11 {
        for frame in -2..3 {
            builder.list(camera, frame);
        }
        builder.image('r', camera, -2, true, &|x, _| [0, 0, 0, if x < 2 { 255 } else { 0 }]);
        builder.image('r', camera, -1, false, &ground);
        for frame in 0..3 {
            builder.image('r', camera, frame, false, &|x, y| {
                if in_square(x, y) { [200, 30, 20, 255] } else { ground(x, y) }
            });
        }
    }
    let clip = builder.open().unwrap();
    assert_eq!((clip.cameras.len(), clip.frame_numbers.as_slice()), (11, &[0, 1, 2][..]));
    assert!(clip.cameras.iter().map(|camera| camera.id).eq(0..11));
    assert!(clip.foreground.iter().all(|&f| f == Foreground::Plate));
    for frame in clip.frames.iter().flatten() {
        for ((y, x), &weight) in frame.weight.indexed_iter() {
            assert_eq!(weight, if x < 2 { 0.0 } else { 1.0 });
            let alpha = frame.alpha[[y, x]];
            assert!(if in_square(x, y) { alpha > 0.5 } else { alpha < 0.5 }, "alpha {alpha} at {x}, {y}");
        }
    }
    let inventory = inspect(&builder.root).unwrap();
    assert!(inventory.is_complete() && inventory.layout == Format::PacNerf, "{inventory}");
    assert!(inventory.cameras.iter().all(|camera| camera.has_plate && camera.has_excluded));
}

/// Every shipped file is read without complaint, and differs from the defaults only as it says.
#[test]
fn shipped_settings() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/configs/pac_nerf");
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let config = Config::parse(&fs::read_to_string(&path).unwrap()).unwrap_or_else(|e| panic!("{name}: {e}"));
            config.check().unwrap();
            assert!(config.clip.cameras.is_empty() && (12..=18).contains(&config.clip.frames), "{name}");
            assert_eq!((config.world.gravity, config.world.ground), ([0.0, -9.8, 0.0], 0.0), "{name}");
            assert_eq!(config.world.density, 1000.0, "{name}");
            names.push((name, config));
        }
    }
    let find = |name: &str| &names.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("no {name}.toml")).1;
    assert_eq!(names.len(), 16);
    for (scene, frames, dx, key, value) in [
        ("torus", 14, 0.02, "young", 1e5),
        ("bird", 14, 0.02, "young", 1e3),
        ("rope", 18, 0.02, "poisson", 0.4),
        ("rope2", 18, 0.02, "young", 1e5),
        ("playdoh", 12, 0.02, "yield_stress", 1e3),
        ("cat", 12, 0.02, "yield_stress", 100.0),
        ("droplet", 13, 0.02, "bulk", 1e3),
        ("letter", 16, 0.0125, "bulk", 1e6),
        ("cream", 14, 0.015, "plastic_viscosity", 1.0),
        ("toothpaste", 14, 0.002, "plastic_viscosity", 0.1),
        ("trophy", 14, 0.015, "friction_angle", 10.0),
    ] {
        let config = find(scene);
        assert_eq!((config.clip.frames, config.geometry.dx), (frames, dx), "{scene}");
        assert_eq!(config.material.start[key], value, "{scene}");
    }
    assert_eq!(find("trophy").material.held.as_deref().unwrap(), ["young", "poisson", "cohesion"]);
}
