//! Cameras against independent rays, round trips, and shrinking.

use gradreel_models::video::Camera;
use safetensors::SafeTensors;

fn numbers(file: &SafeTensors<'_>, key: &str) -> Vec<f64> {
    let tensor = file.tensor(key).unwrap();
    match tensor.dtype() {
        safetensors::Dtype::F64 => {
            tensor.data().chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
        }
        safetensors::Dtype::F32 => {
            tensor.data().chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect()
        }
        other => panic!("{key} has dtype {other:?}"),
    }
}

/// Four cameras of 32 × 24 pixels with the rays of all their pixel centres.
fn reference() -> (Vec<Camera>, Vec<f64>, Vec<f64>) {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/rays.safetensors")).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (c2w, k) = (numbers(&file, "c2w"), numbers(&file, "intrinsic"));
    let cameras = c2w.chunks_exact(12).enumerate().map(|(id, m)| Camera {
        id: id as i64,
        width: 32,
        height: 24,
        fx: k[0],
        fy: k[4],
        cx: k[2],
        cy: k[5],
        c2w: [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| m[4 * row + column])),
    });
    (cameras.collect(), numbers(&file, "rays_o"), numbers(&file, "rays_d"))
}

/// The reference directions were computed from intrinsics in single precision.
#[test]
fn rays_match_the_reference() {
    let (cameras, origins, directions) = reference();
    let mut rays = origins.chunks_exact(3).zip(directions.chunks_exact(3));
    for camera in &cameras {
        for y in 0..24 {
            for x in 0..32 {
                let (origin, direction) = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let (o, d) = rays.next().unwrap();
                for k in 0..3 {
                    assert!((origin[k] - o[k]).abs() < 1e-12 && (direction[k] - d[k]).abs() < 1e-8);
                }
            }
        }
    }
    assert!(rays.next().is_none());
}

#[test]
fn projecting_a_ray_returns_its_pixel() {
    for camera in reference().0 {
        for (u, v, depth) in [(0.5, 0.5, 1.0), (31.5, 23.5, 0.3), (7.25, 19.0, 12.0), (-4.0, 40.0, 2.0)] {
            let (o, d) = camera.ray(u, v);
            let [pu, pv, pd] = camera.project([0, 1, 2].map(|k| o[k] + depth * d[k])).unwrap();
            assert!((pu - u).abs() < 1e-9 && (pv - v).abs() < 1e-9 && (pd - depth).abs() < 1e-9);
            assert_eq!(camera.project([0, 1, 2].map(|k| o[k] - depth * d[k])), None);
        }
        assert_eq!(camera.project(camera.centre()), None);
    }
}

#[test]
fn shrinking_keeps_the_projection() {
    for camera in reference().0 {
        for factor in [2, 3, 5] {
            let small = camera.scaled(factor);
            assert_eq!((small.width, small.height), (32 / factor, 24 / factor));
            let by = factor as f64;
            let (o, d) = camera.ray(11.0, 6.0);
            assert_eq!(small.ray(11.0 / by, 6.0 / by).0, o);
            let p = [0, 1, 2].map(|k| o[k] + 1.7 * d[k]);
            let [u, v, depth] = small.project(p).unwrap();
            assert!((u * by - 11.0).abs() < 1e-9 && (v * by - 6.0).abs() < 1e-9 && (depth - 1.7).abs() < 1e-9);
        }
    }
}
