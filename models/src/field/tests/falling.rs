//! A small moving scene: a two-coloured ball that falls, filmed from all sides by the renderer of particles.

use std::sync::Arc;

use crate::field::temporal::{
    ClipRays, TemporalField, TemporalFit, TemporalFitSettings, TemporalSettings, TemporalWeights,
};
use crate::field::{Occupancy, RadianceSizes, StaticFit, StaticFitSettings, bounding_sphere, hull, static_step};
use crate::particles::Jitter;
use crate::render::{Rays, Splat, Surface, ViewWeights, render};
use crate::video::{Camera, Clip, Foreground, Frame};
use gradreel::io::TensorFile;
use gradreel::optim::Params;
use gradreel::{DType, Key, Result, Tape, Tensor};
use ndarray::{Array2, Array3};

const FRAMES: usize = 5;
const FRAME_DT: f64 = 0.06;
const SIZE: usize = 24;
const GRAVITY: [f64; 3] = [0.0, -9.8, 0.0];
const VELOCITY: [f64; 3] = [0.5, 0.0, 0.0];
const CENTRE: [f64; 3] = [-0.06, 0.8, 0.0];

/// Where the ball is at a time \[s\].
fn centre(t: f64) -> [f64; 3] {
    [0, 1, 2].map(|axis| CENTRE[axis] + VELOCITY[axis] * t + 0.5 * GRAVITY[axis] * t * t)
}

/// A camera on a ring around the scene.
fn camera(id: i64, azimuth: f64, height: f64) -> Camera {
    let camera = [2.2 * azimuth.sin(), height, 2.2 * azimuth.cos()];
    let back = [camera[0], camera[1] - 0.6, camera[2]];
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let back = back.map(|x| x / length(back));
    let right = [back[2], 0.0, -back[0]].map(|x| x / length([back[2], 0.0, -back[0]]));
    let up = [
        back[1] * right[2] - back[2] * right[1],
        back[2] * right[0] - back[0] * right[2],
        back[0] * right[1] - back[1] * right[0],
    ];
    let c2w = [0, 1, 2].map(|i| [right[i], up[i], back[i], camera[i]]);
    let size = SIZE as f64;
    Camera { id, width: SIZE, height: SIZE, fx: 1.8 * size, fy: 1.8 * size, cx: size / 2.0, cy: size / 2.0, c2w }
}

fn clip_of(cameras: Vec<Camera>) -> Clip {
    let radius = 0.22;
    let near: Vec<[f64; 3]> = (0..1000)
        .map(|i: usize| [i / 100, i / 10 % 10, i % 10].map(|n| 0.05 * (n as f64 - 4.5)))
        .filter(|x: &[f64; 3]| x.iter().map(|x| x * x).sum::<f64>() < radius * radius)
        .collect();
    let colours: Vec<f64> =
        near.iter().flat_map(|x| if x[0] > 0.0 { [0.9, 0.1, 0.1] } else { [0.1, 0.2, 0.9] }).collect();
    let count = near.len();
    let picture = |camera: &Camera, frame: usize| {
        let at = centre(FRAME_DT * frame as f64);
        let positions: Vec<f64> = near.iter().flat_map(|x| [0, 1, 2].map(|axis| x[axis] + at[axis])).collect();
        let tape = Tape::new();
        let constant = |values: Vec<f64>, columns| tape.constant(Tensor::from_vec(values, [count, columns]));
        let (positions, opacity) = (constant(positions, 3), constant(vec![1.0; count], 1));
        let rays = Arc::new(Rays::of_camera(camera));
        let splat = Splat { spacing: 0.1, particle_spacing: 0.05 };
        let colour = constant(colours.clone(), 3);
        let pixels = render(&positions, &opacity, &colour, &rays, &splat, &Surface::default()).unwrap();
        let pixels = pixels.value().unwrap().to_vec().unwrap();
        let alpha = |i: usize| pixels[4 * i + 3];
        Frame {
            rgb: Array3::from_shape_fn((SIZE, SIZE, 3), |(row, column, c)| {
                let i = row * SIZE + column;
                (pixels[4 * i + c] + 1.0 - alpha(i)) as f32
            }),
            alpha: Array2::from_shape_fn((SIZE, SIZE), |(row, column)| alpha(row * SIZE + column) as f32),
            weight: Array2::ones((SIZE, SIZE)),
        }
    };
    Clip {
        name: "falling".to_owned(),
        root: "falling".into(),
        times: (0..FRAMES).map(|f| FRAME_DT * f as f64).collect(),
        frame_numbers: (0..FRAMES as i64).collect(),
        frames: cameras.iter().map(|c| (0..FRAMES).map(|f| picture(c, f)).collect()).collect(),
        foreground: vec![Foreground::ImageAlpha; cameras.len()],
        imagined: vec![false; cameras.len()],
        cameras,
        assumptions: Vec::new(),
        flight: None,
        around: None,
        story: None,
    }
}

fn ring() -> Clip {
    let azimuth = |i: i64| std::f64::consts::TAU * i as f64 / 6.0;
    clip_of((0..6).map(|i| camera(i, azimuth(i), if i % 2 == 0 { 1.2 } else { 0.5 })).collect())
}

fn sizes() -> TemporalSettings {
    TemporalSettings {
        width: 32,
        channels: 4,
        position_levels: 3,
        time_levels: 3,
        view_levels: 1,
        ..TemporalSettings::default()
    }
}

fn settings() -> TemporalFitSettings {
    TemporalFitSettings {
        iterations: 100,
        rays: 256,
        nodes: 6000,
        refinements: 1,
        grid_rate: 0.3,
        network_rate: 4e-3,
        bending_rate: 4e-3,
        mask_nodes: 1000,
        mask_every: 20,
        ..TemporalFitSettings::default()
    }
}

const LOW: [f64; 3] = [-0.4, 0.2, -0.35];
const HIGH: [f64; 3] = [0.4, 1.1, 0.35];

fn fit_of(sizes: &TemporalSettings, settings: &TemporalFitSettings) -> TemporalFit {
    TemporalFit::new(LOW, HIGH, sizes, settings, DType::F32).unwrap()
}

fn rays_of(clip: &Clip) -> ClipRays<'_> {
    ClipRays::new(clip, &ViewWeights { alpha: 0.0, ..ViewWeights::default() }, [0.0, 0.6, 0.0], 0, &[], 0.7)
}

/// The peak signal-to-noise ratio of a whole picture \[dB\].
fn psnr(field: &TemporalField, params: &Params, rays: &ClipRays<'_>, camera: usize, frame: usize) -> f64 {
    let batch = rays.picture(camera, frame, DType::F32).unwrap();
    let tape = Tape::new();
    let bound = params.bind(&tape);
    let seen = field.render(&bound, &batch.rays, &batch.moment_of, &rays.times).unwrap();
    let (found, wanted) = (seen.pixels.rgb.value().unwrap().to_vec().unwrap(), batch.targets.colours.to_vec().unwrap());
    let square: f64 = found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2)).sum();
    -10.0 * (square / found.len() as f64).log10()
}

#[test]
fn a_ball_is_seen_falling_from_a_side_that_nobody_filmed() {
    let (clip, other) = (ring(), clip_of(vec![camera(9, 0.5, 0.9)]));
    let (rays, unseen) = (rays_of(&clip), rays_of(&other));
    let mut fit = fit_of(&sizes(), &settings()).within_silhouettes(&rays).unwrap();
    let empty = psnr(&fit.field, &fit.params, &unseen, 0, 2);
    fit.run(&rays, |_, _| Ok(())).unwrap();
    let found: Vec<f64> = (0..FRAMES).map(|f| psnr(&fit.field, &fit.params, &unseen, 0, f)).collect();
    let motion = fit.field.motion(&fit.params, &rays.times, &clip.times, 20_000).unwrap();
    let (start, velocity) = motion.ballistic(GRAVITY, FRAMES).unwrap();
    println!("{empty:.1} → {found:.1?} dB, {motion:.3?}, {start:.3?} {velocity:.3?}");
    assert!(found.iter().all(|psnr| *psnr > 22.0), "{empty:.1} → {found:.1?} dB");
    for (f, found) in motion.centroids.iter().enumerate() {
        let wanted = centre(clip.times[f]);
        assert!((0..3).all(|axis| (found[axis] - wanted[axis]).abs() < 0.03), "frame {f}: {found:?} for {wanted:?}");
    }
    assert!((0..3).all(|axis| (velocity[axis] - VELOCITY[axis]).abs() < 0.2), "{velocity:?}");
    assert!((0..3).all(|axis| (start[axis] - CENTRE[axis]).abs() < 0.03), "{start:?}");

    // one picture is of another time: it alone contradicts the field
    let mut wrong = ring();
    wrong.frames[4][1] = wrong.frames[4][4].clone();
    let agreement = fit.field.agreement(&fit.params, &rays_of(&wrong), 200, Key::new(2)).unwrap().within(3.0);
    let doubted: Vec<_> =
        (0..6).flat_map(|c| (0..FRAMES).map(move |f| (c, f))).filter(|(c, f)| !agreement[*c][*f]).collect();
    assert_eq!(doubted, [(4, 1)]);

    // the ablation: one still field cannot be in five places
    let still = TemporalSettings { time: false, ..sizes() };
    let without = fit_of(&still, &TemporalFitSettings { iterations: 20, ..settings() });
    let mut without = without.within_silhouettes(&rays).unwrap();
    without.run(&rays, |_, _| Ok(())).unwrap();
    let blurred = psnr(&without.field, &without.params, &unseen, 0, 0);
    assert!(blurred < found[0] - 3.0, "{blurred:.1} dB without time, {:.1} dB with", found[0]);
}

#[test]
fn rays_in_parts_have_the_gradients_of_all_together() {
    let clip = ring();
    let rays = rays_of(&clip);
    // offsets are averaged over the opaque samples of a part
    let weights = TemporalWeights { offsets: 0.0, ..TemporalWeights::default() };
    let after = |rays_at_once: usize| {
        let settings = TemporalFitSettings { rays: 90, rays_at_once, weights: weights.clone(), ..settings() };
        let mut fit = TemporalFit::new(LOW, HIGH, &sizes(), &settings, DType::F64).unwrap();
        for _ in 0..2 {
            fit.step(&rays).unwrap();
        }
        fit.params
    };
    let (whole, parts) = (after(90), after(40));
    let mut apart = 0;
    for (path, value) in whole.iter() {
        let (a, b) = (value.slice::<f64>(), parts.get(path).unwrap().slice::<f64>());
        apart += a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-6).count();
    }
    // Adam makes whole steps of gradients that are nothing but rounding
    assert!(1000 * apart < whole.count(), "{apart} of {}", whole.count());
}

#[test]
fn silhouettes_leave_room_for_the_object_in_every_frame() {
    let clip = ring();
    let mask = rays_of(&clip).hull_mask(LOW, HIGH, 30_000).unwrap();
    for f in 0..FRAMES {
        let at = centre(clip.times[f]);
        let mut shell = (0..400).map(|i| {
            let (up, turn) = (1.0 - (f64::from(i) + 0.5) / 200.0, 2.4 * f64::from(i));
            let around = (1.0 - up * up).sqrt();
            [at[0] + 0.2 * around * turn.cos(), at[1] + 0.2 * up, at[2] + 0.2 * around * turn.sin()]
        });
        assert!(mask.contains(at) && shell.all(|x| mask.contains(x)), "frame {f}");
    }
    let kept = mask.occupied.iter().filter(|o| **o).count() as f64 / mask.occupied.len() as f64;
    // the ball sweeps a fifth of the box
    assert!((0.15..0.6).contains(&kept), "{kept}");
    // an imagined view that sees nothing does not carve anything away
    let mut wrong = clip.clone();
    wrong.frames[2].iter_mut().for_each(|frame| frame.alpha.fill(0.0));
    let off = ViewWeights { alpha: 0.0, ..ViewWeights::default() };
    let with = |imagined: &[usize]| {
        let rays = ClipRays::new(&wrong, &off, [0.0, 0.6, 0.0], 0, imagined, 0.7);
        rays.hull_mask(LOW, HIGH, 30_000).unwrap().occupied.iter().filter(|o| **o).count()
    };
    assert_eq!(with(&[]), 0);
    assert!(with(&[1, 2, 3]) > 0);
    // nor from the voxels of the first frame, unless it is real
    let ball = bounding_sphere(&clip, 0).unwrap();
    let carved = |clip: &Clip| {
        hull(clip, 0, &ball, 0.05, 0.3, clip.imagined.iter().filter(|imagined| **imagined).count() / 2)
            .map(|hull| hull.voxels.len())
    };
    let whole = carved(&clip).unwrap();
    assert!(carved(&wrong).is_err());
    wrong.imagine(&[1, 2, 3]).unwrap();
    assert!((whole..2 * whole).contains(&carved(&wrong).unwrap()), "{whole}, {:?}", carved(&wrong));
}

#[test]
fn an_interrupted_fit_ends_like_an_uninterrupted_one() {
    let clip = ring();
    let rays = rays_of(&clip);
    let settings = TemporalFitSettings { iterations: 30, rays: 100, mask_every: 4, ..settings() };
    let mut whole = fit_of(&sizes(), &settings);
    let mut file = TensorFile::default();
    whole
        .run(&rays, |fit, progress| -> Result<()> {
            assert_eq!(progress.iteration, fit.iteration);
            // after the refinement and after a mask was made
            if progress.iteration == 23 {
                fit.save(&mut file);
            }
            Ok(())
        })
        .unwrap();
    let file = TensorFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    let mut resumed = fit_of(&sizes(), &settings);
    resumed.restore(&file).unwrap();
    assert_eq!((resumed.iteration, resumed.field.mask.is_some()), (23, true));
    resumed.run(&rays, |_, _| Ok(())).unwrap();
    for (path, value) in whole.params.iter() {
        assert_eq!(value.slice::<f32>(), resumed.params.get(path).unwrap().slice::<f32>(), "{path}");
    }
    let mut other = fit_of(&TemporalSettings { width: 16, ..sizes() }, &settings);
    assert!(other.restore(&file).is_err() && other.iteration == 0);
}

#[test]
fn a_still_field_of_the_first_frame() {
    let (clip, other) = (ring(), clip_of(vec![camera(9, 0.5, 0.9)]));
    let (rays, unseen) = (rays_of(&clip), rays_of(&other));
    let sizes = RadianceSizes { features: 6, width: 32, view_levels: 1 };
    let settings = StaticFitSettings {
        iterations: 100,
        refine_after: vec![40],
        grid_rate: 0.5,
        network_rate: 1e-2,
        ..StaticFitSettings::default()
    };
    let mut fit = StaticFit::new([-0.45, 0.4, -0.4], [0.35, 1.2, 0.4], 0.1, &sizes, &settings, DType::F32).unwrap();
    let mut particles = 0;
    fit.run(&rays, |_, progress| {
        particles = progress.particles;
        Ok(())
    })
    .unwrap();
    assert_eq!(fit.field.grid.spacing, 0.05);
    // a view that nobody filmed
    let batch = unseen.picture(0, 0, DType::F32).unwrap();
    let tape = Tape::new();
    let bound = fit.params.bind(&tape);
    let (colours, weight) = (&batch.targets.colours, &batch.targets.weight);
    let jitter = Jitter::Drawn(Key::new(5));
    let seen =
        static_step(&fit.field, &bound, &fit.occupancy, &jitter, &batch.rays, colours, weight, &settings.step).unwrap();
    let psnr = -10.0 * seen.colour.item().unwrap().log10();
    println!("{psnr:.1} dB, {particles} particles, {:?}", fit.field.grid);
    assert!(psnr > 20.0, "{psnr:.1} dB");
    // at first there was fog in every place
    let places = settings.step.seeding.places(&Occupancy::full(fit.field.grid.clone())).len();
    assert!(8 * particles < 3 * places, "{particles} particles in {places} places");
}
