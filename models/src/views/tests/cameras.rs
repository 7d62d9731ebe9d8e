//! The ring of cameras, the places where views are sampled, and the preparation of the input picture.

use std::collections::BTreeMap;

use crate::layers::listing;
use crate::views::{Bicubic, Denoiser, Ring, prepare};
use gradreel::{Shape, Tape, Tensor};

use super::harness::{Case, close, load, places, setting, size};
use super::procedural::weight;
use super::sampling;

#[test]
fn poses_and_projections() {
    let file = load("cameras");
    let views = file.get("poses").unwrap().dims()[0];
    let ring = Ring::published(views);
    let poses: Vec<f64> = (0..views).flat_map(|view| ring.pose(view).concat()).collect();
    // one sits 4e-8 off at azimuths that are multiples of 90 degrees
    close("poses", &Tensor::from_vec(poses, [views, 3, 4]), file.get("poses").unwrap(), 2e-7);
    let azimuths: Vec<f64> = (0..views).map(|view| ring.azimuth(view)).collect();
    close("azimuths", &Tensor::from_vec(azimuths, [views]), file.get("azimuth_buffer").unwrap(), 1e-6);

    let elevations = file.get("in.elevation_input_rad").unwrap().to_vec().unwrap();
    let told: Vec<f64> = elevations.iter().flat_map(|e| (0..views).flat_map(|view| ring.viewpoint(view, *e))).collect();
    let told = Tensor::from_vec(told, [elevations.len(), views, 4]);
    close("viewpoints", &told, file.get("out.viewpoint_embedding").unwrap(), 1e-6);

    let (side, width) = (size(&file, "V"), size(&file, "warp_size"));
    let voxels: Vec<[f64; 3]> = ring.voxels(side).collect();
    let planes: Vec<f64> = (0..3).flat_map(|axis| voxels.iter().map(move |v| v[axis])).collect();
    close("voxels", &Tensor::from_vec(planes, [1, 3, side, side, side]), file.get("voxel_xyz").unwrap(), 1e-6);
    let places: Vec<f64> = (0..views)
        .flat_map(|view| {
            let pose = ring.pose(view);
            let half = (width as f64 - 1.0) / 2.0;
            let to = |point: &[f64; 3]| ring.project(&pose, *point, width).map(|x| x / half - 1.0);
            voxels.iter().flat_map(to).collect::<Vec<_>>()
        })
        .enumerate()
        .filter(|(i, _)| i % 3 < 2)
        .map(|(_, x)| x)
        .collect();
    let places = Tensor::from_vec(places, [views, side, side, side, 2]);
    close("places", &places, file.get(&format!("out.warp_coords_{width}")).unwrap(), 1e-5);
}

/// Cameras of the reduced model, and the first numbers of weights that are made from their paths and a seed.
#[test]
fn the_setup_of_a_reduced_model() {
    let file = load("pipeline_setup");
    let (views, image) = (size(&file, "views"), size(&file, "image_size"));
    let ring = Ring::published(views);
    let poses: Vec<f64> = (0..views).flat_map(|view| ring.pose(view).concat()).collect();
    close("poses", &Tensor::from_vec(poses, [views, 3, 4]), file.get("poses").unwrap(), 2e-7);
    let azimuths: Vec<f64> = (0..views).map(|view| ring.azimuth(view)).collect();
    close("azimuth", &Tensor::from_vec(azimuths, [views]), file.get("azimuth").unwrap(), 1e-6);
    let intrinsics = (0..views).flat_map(|view| {
        let camera = ring.camera(view, image);
        [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    });
    close("Ks", &Tensor::from_vec(intrinsics.collect(), [views, 3, 3]), file.get("Ks").unwrap(), 1e-6);

    let place = &places()[0];
    let sizes = sampling::sizes(&Case::new(&file, place), 4);
    let shapes: BTreeMap<String, Shape> = listing(|scope| Denoiser::new(scope, &sizes)).unwrap().into_iter().collect();
    let seed = setting(&file, "weight_seed");
    let checks: Vec<_> = file.tensors.iter().filter_map(|(name, x)| Some((name.strip_prefix("check.")?, x))).collect();
    assert!(!checks.is_empty());
    for (path, expected) in checks {
        let shape = shapes.get(path).unwrap_or_else(|| panic!("the model has no {path}"));
        let found = weight(seed.as_str().unwrap(), path, shape).to_vec().unwrap();
        assert_eq!(found[..expected.len()], expected.to_vec().unwrap(), "{path}");
    }
}

#[test]
fn the_cameras_of_a_clip_see_what_those_of_the_model_see() {
    let ring = Ring::published(6);
    for view in 0..6 {
        let (camera, pose) = (ring.camera(view, 200), ring.pose(view));
        assert_eq!((camera.id, camera.width, camera.height), (view as i64, 200, 200));
        for point in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.4], [-0.5, 0.1, -0.3]] {
            let [x, y, z] = point;
            let found = camera.project([x, z, -y]).unwrap();
            let wanted = ring.project(&pose, point, 200);
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}, not {wanted:?}");
        }
        // 30 degrees above the ground, the distance of the ring away
        let [x, y, z] = camera.centre();
        assert!((y - 0.75).abs() < 1e-12 && (x * x + y * y + z * z - 2.25).abs() < 1e-12);
    }
}

#[test]
fn frustum_points() {
    let file = load("cameras");
    let views = file.get("poses").unwrap().dims()[0];
    let ring = Ring::published(views);
    let whole: Vec<_> = file.tensors.iter().filter(|(name, _)| name.starts_with("out.frustum_xyz_")).collect();
    assert!(!whole.is_empty());
    for (name, expected) in whole {
        let [_, _, depth, _, width] = expected.dims()[..] else { panic!("views, axes, depth, rows, columns") };
        let of_view = |view: usize| {
            let points: Vec<[f64; 3]> = ring.frustum(view, depth, width).collect();
            (0..3).flat_map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        let found: Vec<f64> = (0..views).flat_map(of_view).collect();
        close(name, &Tensor::from_vec(found, expected.dims()), expected, 1e-5);
    }
    // some points of the published frustum
    let indices = file.get("in.frustum_full_dhw_index").unwrap().to_vec().unwrap();
    let flat: Vec<usize> = indices.chunks(3).map(|i| ((i[0] * 32.0 + i[1]) * 32.0 + i[2]) as usize).collect();
    let expected = file.get("out.frustum_full_xyz").unwrap().to_vec().unwrap();
    for view in 0..views {
        let points: Vec<[f64; 3]> = ring.frustum(view, 48, 32).collect();
        for (k, &i) in flat.iter().enumerate() {
            for axis in 0..3 {
                let want = expected[(view * 3 + axis) * flat.len() + k];
                assert!((points[i][axis] - want).abs() < 1e-5, "view {view}, sample {i}: {:?}", points[i]);
            }
        }
    }
}

#[test]
fn a_picture_is_prepared_as_published() {
    let file = load("preprocess");
    let picture = file.get("in.rgba").unwrap();
    let height = picture.dims()[0];
    let rgba: Vec<u8> = picture.to_vec().unwrap().iter().map(|v| *v as u8).collect();
    let side = size(&file, "image_size");
    let crops: Vec<&String> = file.tensors.keys().filter(|name| name.starts_with("out.crop_")).collect();
    assert!(crops.len() > 1, "a crop, and none");
    for name in crops {
        let expected = file.get(name).unwrap().to_vec().unwrap();
        let crop = name["out.crop_".len()..].parse().ok();
        let found = prepare(&rgba, height, side, crop).unwrap().to_vec().unwrap();
        let pixels = side * side;
        let errors: Vec<f64> = (0..3 * pixels).map(|i| (found[i % 3 * pixels + i / 3] - expected[i]).abs()).collect();
        let (worst, mean) =
            (errors.iter().fold(0.0f64, |m, e| m.max(*e)), errors.iter().sum::<f64>() / errors.len() as f64);
        assert!(worst <= 0.016 && mean < 0.002, "{name}: worst {worst}, mean {mean}");
    }
    assert!(prepare(&rgba[..4 * height - 4], height, side, None).is_err());
    assert!(prepare(&vec![0; 400], 10, side, Some(side - 14)).unwrap_err().to_string().contains("foreground"));
}

#[test]
fn aligned_bicubic_resizing() {
    let file = load("primitives");
    let of = |name: &str| file.get(&format!("resize_bicubic_align_corners.{name}")).unwrap();
    let tape = Tape::new();
    let x = tape.leaf(of("in.x").clone());
    let expected = of("out");
    let y = Bicubic::Aligned.resize(&x, expected.dims()[2], expected.dims()[3]).unwrap();
    close("out", y.value().unwrap(), expected, 1e-5);
    let gradients = (&y * &tape.constant(of("cot").clone())).sum_all().backward().unwrap();
    close("grad", gradients.wrt(&x).unwrap(), of("grad.in.x"), 1e-4);
}
