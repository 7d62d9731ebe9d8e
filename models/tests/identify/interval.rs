//! Stated intervals against a scan of the likelihood, and against the truth.

use gradreel::{DType, Tensor};
use gradreel_models::identify::{Free, Linearised, Observed, Score, Unknowns, gauss_newton, intervals};
use gradreel_models::physics::{Map, materials};

use crate::scene::{block, film, problem, quick};

/// Adds an independent error to every value of every pixel.
fn noisy(mut observed: Observed, deviation: f32, seed: u64) -> Observed {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    for target in &mut observed.targets {
        let values = target.rgba.slice::<f32>();
        // the sum of twelve uniform numbers is normal enough
        let values = values.iter().map(|v| v + deviation * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)).collect();
        target.rgba = Tensor::from_vec(values, target.rgba.shape());
    }
    observed
}

#[test]
fn intervals_agree_with_a_scan_of_the_likelihood_and_hold_the_truth() {
    const FRAMES: usize = 7;
    let config = quick();
    let particles = block(5, 0.04);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let young = Free::Magnitudes;
    let mut held = 0;
    for seed in 1..=4 {
        let observed = noisy(film(&particles, &truth, &config, FRAMES, 20, DType::F32), 0.05, seed);
        let problem = problem(&particles, &observed, &config, DType::F32);
        let start = Unknowns { parameters: vec![5e4, 0.3], ..truth.clone() };
        let best =
            gauss_newton(&problem, &start, young, FRAMES, 8.into(), &[], &mut |_, _| Ok(()), &mut |_| ()).unwrap();
        let at = problem.linearise(&best.unknowns, young, FRAMES, &mut 0, &mut |_| ()).unwrap();
        let found = intervals(&best.unknowns, &problem.law, young, &at, &[1.0], &[], None).unwrap();
        let [low, high] = found[0].interval_90;
        assert_eq!(found[0].name, "young");
        assert!(found[0].determined);
        held += usize::from((low..high).contains(&truth.parameters[0]));
        // With independent errors of deviation s the likelihood is exp(−loss m/(2 s² w)): it falls by a factor of e^{−½} where the
        // loss has risen by s² w/m, one standard deviation away.
        let rise = f64::from(0.05f32).powi(2) * 0.01 / FRAMES as f64;
        let substeps = problem.schedule(&best.unknowns, FRAMES).substeps;
        let at_best = problem.misfit(&best.unknowns, FRAMES, &mut substeps.clone(), &mut |_| ()).unwrap();
        let loss = |decades: f64| {
            let at =
                Unknowns { parameters: vec![best.unknowns.parameters[0] * 10f64.powf(decades), 0.3], ..truth.clone() };
            problem.misfit(&at, FRAMES, &mut substeps.clone(), &mut |_| ()).unwrap() - at_best
        };
        // the mean of both sides: the search ends near the bottom, not exactly there
        let side = |sign: f64| {
            let (mut near, mut far) = (0.0, 0.1);
            for _ in 0..10 {
                let middle = 0.5 * (near + far);
                if loss(sign * middle) > rise { far = middle } else { near = middle }
            }
            near
        };
        let near = 0.5 * (side(1.0) + side(-1.0));
        let deviation = (high / low).log10() / 2.0 / 2.92; // Student's t of three cameras
        println!("E {:.4e}: ± {deviation:.5} decades; by the scan {near:.5}", best.unknowns.parameters[0]);
        // three cameras and seven frames are a small sample of what errors may do
        assert!((0.3..4.0).contains(&(deviation / near)), "{deviation} by the sandwich, {near} by the scan");
    }
    assert!(held >= 3, "{held} of 4 intervals hold the truth");
}

#[test]
fn what_does_not_touch_the_ground_is_not_determined() {
    let config = quick();
    let particles = block(4, 0.05);
    let truth = Unknowns { velocity: [0.3, 0.5, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = noisy(film(&particles, &truth, &config, 3, 16, DType::F32), 0.02, 3);
    let problem = problem(&particles, &observed, &config, DType::F32);
    let at = problem.linearise(&truth, Free::Both, 3, &mut 0, &mut |_| ()).unwrap();
    let found = intervals(&truth, &problem.law, Free::Both, &at, &[1.0; 5], &[], None).unwrap();
    for interval in &found {
        println!("{interval:?}");
        let [low, high] = interval.interval_90;
        assert_eq!(interval.determined, interval.name.starts_with("velocity"), "{}", interval.name);
        if interval.name == "young" {
            assert!(high / low > 1e3, "as wide as what is plausible: {low} to {high}");
        }
    }
}

/// Whatever the pictures say and wherever the estimate is: an interval holds the estimate, and of a parameter with bounds it stays
/// within what is plausible.
#[test]
fn intervals_stay_within_what_a_parameter_can_be() {
    for law in materials::all() {
        let count = law.parameters().len();
        for known in [1e-9, 1e-3, 1.0, 1e6] {
            for place in [0.0, 0.02, 0.5, 0.97, 1.0] {
                let value = |p: &gradreel_models::physics::Parameter| match p.map {
                    Map::Log10 => p.prior[0] * (p.prior[1] / p.prior[0]).powf(place),
                    // the very end of a bounded parameter has no finite coordinate
                    _ => p.prior[0] + (p.prior[1] - p.prior[0]) * place.clamp(0.001, 0.999),
                };
                let at = Unknowns { parameters: law.parameters().iter().map(value).collect(), ..Unknowns::default() };
                let score = |k: usize| Score { frame: k, camera: k % 3, gradient: vec![(k as f64).sin(); count] };
                let curvature =
                    (0..count).map(|i| (0..count).map(|j| f64::from(u8::from(i == j)) * known).collect()).collect();
                let scores = (0..6).map(score).collect();
                let linearised = Linearised { loss: 1.0, gradient: vec![0.0; count], curvature, scores };
                let found = intervals(&at, &law, Free::Material, &linearised, &vec![1.0; count], &[], None).unwrap();
                for ((interval, p), value) in found.iter().zip(law.parameters()).zip(&at.parameters) {
                    let [low, high] = interval.interval_90;
                    let place = format!("{} of {}, {value}: {low} to {high}", p.name, law.name());
                    assert!(low <= *value && *value <= high && high.is_finite(), "{place}");
                    match p.map {
                        Map::Log10 => assert!(low > 0.0, "{place}"),
                        _ => assert!(p.prior[0] <= low && high <= p.prior[1], "{place}"),
                    }
                }
            }
        }
    }
}
