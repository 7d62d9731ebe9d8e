//! The ring of cameras, the places where views are sampled, and the preparation of the input picture.

use gradreel::{Tape, Tensor};
use gradreel_models::views::{Bicubic, Ring, prepare};

use crate::harness::{close, load};

#[test]
fn poses_and_projections() {
    let file = load("cameras");
    let ring = Ring::published(16);
    let poses: Vec<f64> = (0..16).flat_map(|view| ring.pose(view).concat()).collect();
    // one sits 4e-8 off at azimuths that are multiples of 90 degrees
    close("poses", &Tensor::from_vec(poses, [16, 3, 4]), file.get("poses").unwrap(), 2e-7);
    let azimuths: Vec<f64> = (0..16).map(|view| ring.azimuth(view)).collect();
    close("azimuths", &Tensor::from_vec(azimuths, [16]), file.get("azimuth_buffer").unwrap(), 1e-6);

    let elevations = file.get("in.elevation_input_rad").unwrap().to_vec().unwrap();
    let told: Vec<f64> = elevations.iter().flat_map(|e| (0..16).flat_map(|view| ring.viewpoint(view, *e))).collect();
    close("viewpoints", &Tensor::from_vec(told, [4, 16, 4]), file.get("out.viewpoint_embedding").unwrap(), 1e-6);

    let size = 4;
    let voxels: Vec<[f64; 3]> = ring.voxels(size).collect();
    let planes: Vec<f64> = (0..3).flat_map(|axis| voxels.iter().map(move |v| v[axis])).collect();
    close("voxels", &Tensor::from_vec(planes, [1, 3, 4, 4, 4]), file.get("voxel_xyz").unwrap(), 1e-6);
    let places: Vec<f64> = (0..16)
        .flat_map(|view| {
            let pose = ring.pose(view);
            let to = |point: &[f64; 3]| ring.project(&pose, *point, 32).map(|x| x / 15.5 - 1.0);
            voxels.iter().flat_map(to).collect::<Vec<_>>()
        })
        .enumerate()
        .filter(|(i, _)| i % 3 < 2)
        .map(|(_, x)| x)
        .collect();
    let places = Tensor::from_vec(places, [16, 4, 4, 4, 2]);
    close("places", &places, file.get("out.warp_coords_32").unwrap(), 1e-5);
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
    let ring = Ring::published(16);
    let of = |depth: usize, width: usize, keep: &dyn Fn(usize) -> bool| -> Vec<f64> {
        (0..16)
            .flat_map(|view| {
                let kept = ring.frustum(view, depth, width).enumerate().filter(|(i, _)| keep(*i)).map(|(_, p)| p);
                let points: Vec<[f64; 3]> = kept.collect();
                (0..3).flat_map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>()).collect::<Vec<_>>()
            })
            .collect()
    };
    let small = Tensor::from_vec(of(6, 4, &|_| true), [16, 3, 6, 4, 4]);
    close("small", &small, file.get("out.frustum_xyz_hw4_d6").unwrap(), 1e-5);
    let indices = file.get("in.frustum_full_dhw_index").unwrap().to_vec().unwrap();
    let flat: Vec<usize> = indices.chunks(3).map(|i| ((i[0] * 32.0 + i[1]) * 32.0 + i[2]) as usize).collect();
    let expected = file.get("out.frustum_full_xyz").unwrap().to_vec().unwrap();
    for view in 0..16 {
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
    for (name, crop) in [("out.crop_50", Some(50)), ("out.crop_none", None)] {
        let expected = file.get(name).unwrap().to_vec().unwrap();
        let found = prepare(&rgba, height, 64, crop).unwrap().to_vec().unwrap();
        let pixels = 64 * 64;
        let errors: Vec<f64> = (0..3 * pixels).map(|i| (found[i % 3 * pixels + i / 3] - expected[i]).abs()).collect();
        let (worst, mean) =
            (errors.iter().fold(0.0f64, |m, e| m.max(*e)), errors.iter().sum::<f64>() / errors.len() as f64);
        assert!(worst <= 0.016 && mean < 0.002, "{name}: worst {worst}, mean {mean}");
    }
    assert!(prepare(&rgba[..4 * height - 4], height, 64, None).is_err());
    assert!(prepare(&vec![0; 400], 10, 64, Some(50)).unwrap_err().to_string().contains("foreground"));
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
