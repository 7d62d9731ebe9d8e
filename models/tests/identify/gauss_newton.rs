//! Least squares over the pixels: derivatives against the tape and against differences, and five materials recovered.

use gradreel::DType;
use gradreel_models::identify::{
    Answer, Config, Evaluation, Free, Ground, Observed, Problem, Sight, Steps, Unknowns, apart, gauss_newton, scan,
};
use gradreel_models::particles::Particles;
use gradreel_models::physics::Map;

use crate::scene::{block, camera, film, film_of, problem, problem_of, quick};

const FRAMES: usize = 5;

/// A block of rubber that is thrown down, and the film of it.
fn thrown() -> (Config, Particles, Unknowns, Observed) {
    let config = quick();
    let particles = block(5, 0.04);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: vec![6e4, 0.3], ..Unknowns::default() };
    let observed = film(&particles, &truth, &config, FRAMES, 20, DType::F64);
    (config, particles, truth, observed)
}

#[test]
fn forward_mode_agrees_with_the_tape_and_with_differences_of_pictures() {
    let (config, particles, truth, observed) = thrown();
    let mut problem = problem(&particles, &observed, &config, DType::F64);
    contact_height(&problem, &truth, FRAMES);
    let unknowns = Unknowns { velocity: [0.25, -1.1, 0.15], parameters: vec![4e4, 0.22], ..Unknowns::default() };
    let mut substeps = 128;
    let (loss, gradient) = problem.evaluate(&unknowns, Free::Both, FRAMES, &mut substeps, &mut |_| ()).unwrap();
    let at = problem.linearise(&unknowns, Free::Both, FRAMES, &mut substeps, &mut |_| ()).unwrap();
    assert!((at.loss - loss).abs() < 1e-12 * loss, "{} by forward mode, {loss} on the tape", at.loss);
    assert_eq!(at.scores.len(), FRAMES * 3, "a score for each picture");
    for k in 0..5 {
        let relative = (at.gradient[k] - gradient[k]).abs() / gradient[k].abs().max(1e-3);
        assert!(relative < 1e-7, "unknown {k}: {} by forward mode, {} on the tape", at.gradient[k], gradient[k]);
        let sum: f64 = at.scores.iter().map(|score| score.gradient[k]).sum();
        assert!((sum - at.gradient[k]).abs() < 1e-12, "scores sum to the gradient");
    }
    // Derivatives over a finite step become those of an infinitesimal one as it becomes small.
    problem.secant = 1e-4;
    let near = problem.linearise(&unknowns, Free::Both, FRAMES, &mut substeps, &mut |_| ()).unwrap();
    problem.secant = 0.0;
    assert_eq!(near.loss, at.loss, "the same picture");
    for k in 0..5 {
        let relative = (near.gradient[k] - at.gradient[k]).abs() / at.gradient[k].abs().max(1e-3);
        assert!(relative < 1e-5, "unknown {k}: {} over a finite step, {}", near.gradient[k], at.gradient[k]);
        let relative = (near.curvature[k][k] / at.curvature[k][k] - 1.0).abs();
        assert!(0.0 < relative && relative < 1e-4, "unknown {k}: curvature off by {relative}");
    }
    // At the truth residuals vanish, and the curvature is that of the loss itself.
    let best = problem.linearise(&truth, Free::Both, FRAMES, &mut 0, &mut |_| ()).unwrap();
    assert!(best.loss < 1e-20, "{}", best.loss);
    let x = truth.coordinates(&problem.law, Free::Both);
    let slope = |x: &[f64]| {
        let at = truth.moved(&problem.law, Free::Both, x);
        problem.linearise(&at, Free::Both, FRAMES, &mut 0, &mut |_| ()).unwrap().gradient
    };
    for (k, step) in [(3, 1e-5), (4, 1e-5), (1, 1e-5)] {
        let moved = |sign: f64| {
            let mut x = x.clone();
            x[k] += sign * step;
            slope(&x)
        };
        let (plus, minus) = (moved(1.0), moved(-1.0));
        for l in 0..5 {
            let difference = (plus[l] - minus[l]) / (2.0 * step);
            let scale = (best.curvature[k][k] * best.curvature[l][l]).sqrt();
            assert!(
                (difference - best.curvature[k][l]).abs() < 2e-2 * scale,
                "curvature {k},{l}: {} by Gauss and Newton, {difference} by differences",
                best.curvature[k][l]
            );
            assert_eq!(best.curvature[k][l], best.curvature[l][k]);
        }
    }
}

/// The derivative along the height at which the ground is felt, against differences, and forward mode against the tape there.
fn contact_height(problem: &Problem<'_>, truth: &Unknowns, frames: usize) {
    let at = |contact: f64| Unknowns { contact, ..truth.clone() };
    let free = Free::NOTHING.with_ground(&problem.law, Ground::Known);
    let loss = |contact| problem.linearise(&at(contact), free, frames, &mut 0, &mut |_| ()).unwrap();
    let (here, plus, minus) = (loss(-0.1), loss(-0.1 + 1e-6), loss(-0.1 - 1e-6));
    let difference = (plus.loss - minus.loss) / 2e-6;
    assert!((here.gradient[0] - difference).abs() < 1e-5 * difference.abs(), "{} {difference}", here.gradient[0]);
    let taped = problem.evaluate(&at(-0.1), Free::Velocity, frames, &mut 0, &mut |_| ()).unwrap().0;
    assert!((here.loss - taped).abs() < 1e-12 * taped && here.loss > 1e-4, "{} {taped}", here.loss);
}

/// What leans away from its only camera, or is farther away, looks the same in the first frame and falls another way; derivatives along that against
/// differences, simulated and in flight, and forward mode against the tape there.
#[test]
fn a_body_leans_along_the_rays_of_its_camera() {
    let (config, particles, truth, seen_by_three) = thrown();
    let middle = particles.centre_of_mass();
    let observed = Observed { sight: Sight::at(&camera(1, 2.5, 20), middle), ..seen_by_three };
    let problem = problem(&particles, &observed, &config, DType::F64);
    let leaning = |lean: [f64; 3]| Unknowns { lean, ..truth.clone() };
    let positions = |lean| problem.positions(&leaning(lean)).unwrap().slice::<f64>().to_vec();
    let (upright, leans) = (positions([0.0; 3]), positions([0.4, -0.3, 0.1]));
    let own = camera(1, 2.5, 20);
    for (x, moved) in upright.chunks_exact(3).zip(leans.chunks_exact(3)).take(particles.len()) {
        let of = |x: &[f64]| own.project([x[0], x[1], x[2]]).unwrap();
        let ([u, v, depth], [u2, v2, deeper]) = (of(x), of(moved));
        assert!((u - u2).abs() < 1e-9 && (v - v2).abs() < 1e-9, "({u}, {v}) became ({u2}, {v2})");
        // tangents of angles, right and up
        let [mu, mv, _] = own.project(middle).unwrap();
        let wanted = depth * (1.1 + 0.4 * (u - mu) / own.fx + 0.3 * (v - mv) / own.fy);
        assert!((deeper - wanted).abs() < 1e-9, "{deeper}, not {wanted} m away");
    }
    let free = Free::NOTHING.with_lean(&problem.law).with_distance(&problem.law);
    for problem in [&problem, &problem.flying()] {
        let at = |lean| problem.linearise(&leaning(lean), free, FRAMES, &mut 0, &mut |_| ()).unwrap();
        let here = at([0.2, -0.1, 0.05]);
        for axis in 0..3 {
            let [plus, minus] = [1e-6, -1e-6].map(|step| {
                let mut lean = [0.2, -0.1, 0.05];
                lean[axis] += step;
                at(lean).loss
            });
            let difference = (plus - minus) / 2e-6;
            let found = here.gradient[axis];
            assert!((found - difference).abs() < 1e-5 * difference.abs(), "axis {axis}: {found}, {difference}");
        }
        let taped =
            problem.evaluate(&leaning([0.2, -0.1, 0.05]), Free::Velocity, FRAMES, &mut 0, &mut |_| ()).unwrap().0;
        assert!((here.loss - taped).abs() < 1e-12 * taped && here.loss > 1e-4, "{} {taped}", here.loss);
    }
}

#[test]
fn derivatives_of_a_search_that_stands_still_reach_less_far() {
    let (config, particles, truth, observed) = thrown();
    let mut problem = problem(&particles, &observed, &config, DType::F64);
    let exact = problem.linearise(&truth, Free::Material, FRAMES, &mut 0, &mut |_| ()).unwrap().curvature;
    // from the truth there is nowhere to go
    let errors = |problem: &Problem<'_>| {
        let mut errors = Vec::new();
        let mut each = |_: &Evaluation, answer: Option<&Answer>| {
            errors.push((answer.unwrap().curvature[0][0] / exact[0][0] - 1.0).abs());
            Ok(())
        };
        gauss_newton(problem, &truth, Free::Material, FRAMES, 10.into(), &[], &mut each, &mut |_| ()).unwrap();
        errors
    };
    assert_eq!(errors(&problem), [0.0], "as near as can be");
    problem.secant = 0.02;
    let found = errors(&problem);
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found[1] < found[0] / 4.0 && found[2] < found[1] / 4.0, "{found:?}");
}

/// Films a block and finds its material again: a scan, then Gauss–Newton from the best of it.
fn recover(name: &str, truth: &[f64], allowed: &[(usize, f64)], frames: usize) {
    let config = quick();
    let particles = block(6, 0.04);
    let velocity = [0.3, -1.2, 0.1];
    let truth = Unknowns { velocity, parameters: truth.to_vec(), ..Unknowns::default() };
    let observed = film_of(name, &particles, &truth, &config, frames, 24, DType::F32);
    let problem = problem_of(name, &particles, &observed, &config, DType::F32);
    let held: Vec<&str> = problem
        .law
        .parameters()
        .iter()
        .enumerate()
        .filter(|(k, _)| allowed.iter().all(|(a, _)| a != k))
        .map(|(_, p)| p.name)
        .collect();
    let free = Free::all_but(&problem.law, &held, false);
    let mut start = truth.clone();
    let mut points = Vec::new();
    for index in 0..12 {
        for &(k, _) in allowed {
            let p = &problem.law.parameters()[k];
            let place = ((index * [1, 5, 7, 11][k] + 3 * k) % 12) as f64 / 12.0 + 0.04;
            start.parameters[k] = match p.map {
                Map::Log10 => p.prior[0] * (p.prior[1] / p.prior[0]).powf(place),
                _ => p.prior[0] + place * (p.prior[1] - p.prior[0]),
            };
        }
        points.push(start.clone());
    }
    let all = scan(&problem, &points, free, frames, &[], &mut |_, _| Ok(()), &mut |_| ()).unwrap();
    let mut evaluations = all.len();
    let starts = apart(all, &problem.law, free, 3);
    assert!(!starts.is_empty());
    let found = starts.iter().map(|start| {
        gauss_newton(
            &problem,
            start,
            free,
            frames,
            12.into(),
            &[],
            &mut |_, _| {
                evaluations += 1;
                Ok(())
            },
            &mut |_| (),
        )
        .unwrap()
    });
    let found = found.min_by(|a, b| a.loss.total_cmp(&b.loss)).unwrap();
    println!(
        "{name}: {:?} (true {:?}), loss {:.2e}, {evaluations} evaluations",
        found.unknowns.parameters, truth.parameters, found.loss
    );
    for &(k, allowed) in allowed {
        let parameter = problem.law.parameters()[k];
        let (a, b) = (found.unknowns.parameters[k], truth.parameters[k]);
        let off = if parameter.map == Map::Log10 { (a / b).log10() } else { a - b };
        assert!(off.abs() < allowed, "{name}: {} is {a}, not {b}", parameter.name);
    }
}

#[test]
fn rubber() {
    recover("neo_hookean", &[6e4, 0.3], &[(0, 0.02), (1, 0.02)], 8);
}

#[test]
fn plasticine() {
    recover("von_mises", &[4e5, 0.3, 3e3], &[(0, 0.1), (1, 0.05), (2, 0.02)], 8);
}

#[test]
fn honey() {
    recover("newtonian", &[60.0, 5e4], &[(0, 0.02), (1, 0.1)], 8);
}

#[test]
fn cream() {
    recover("viscoplastic", &[2e4, 1e5, 500.0, 20.0], &[(0, 0.2), (1, 0.2), (2, 0.1), (3, 0.2)], 8);
}

#[test]
fn sand() {
    recover("drucker_prager", &[2e5, 0.3, 30.0, 0.0], &[(2, 1.0)], 8);
}

/// Steps beyond those that are taken in any case are taken while each lowers the loss by a hundredth.
#[test]
fn a_search_goes_on_while_the_loss_falls() {
    let (config, particles, truth, observed) = thrown();
    let problem = problem(&particles, &observed, &config, DType::F64);
    let start = Unknowns { parameters: vec![4e3, 0.1], ..truth };
    let search = |steps| {
        let mut evaluations = 0;
        let mut each = |_: &Evaluation, _: Option<&Answer>| {
            evaluations += 1;
            Ok(())
        };
        let found = gauss_newton(&problem, &start, Free::Material, FRAMES, steps, &[], &mut each, &mut |_| ()).unwrap();
        (found.loss, evaluations)
    };
    let (one, of_one) = search(Steps::from(1));
    let (more, of_more) = search(Steps { falling: 30, ..Steps::from(1) });
    let (all, of_all) = search(Steps::from(31));
    // given up after half of its steps, unless the loss is low enough then
    let given_up = search(Steps { hopeless: 1e-12, ..Steps::from(2) });
    assert_eq!(given_up, (one, of_one));
    assert_eq!(search(Steps { hopeless: one, ..Steps::from(2) }), search(Steps::from(2)));
    assert!(more < 1e-3 * one && of_more > of_one, "{one} after a step, {more} after {of_more} evaluations");
    assert!(all <= more && of_all >= of_more, "{all} after {of_all} evaluations");
    assert!(of_more < 31 * 2, "{of_more} evaluations: the minimum is reached long before");
}

/// An interrupted search ends as an uninterrupted one, without computing again what was known.
#[test]
fn a_search_goes_on_where_it_was_interrupted() {
    interrupt("neo_hookean", [6e4, 0.3], [2e4, 0.1]);
    // derivatives over a finite step, to the side of the step before
    interrupt("newtonian", [60.0, 5e4], [15.0, 2e4]);
}

fn interrupt(law: &str, truth: [f64; 2], start: [f64; 2]) {
    let config = quick();
    let particles = block(4, 0.05);
    let truth = Unknowns { velocity: [0.3, -1.2, 0.1], parameters: truth.to_vec(), ..Unknowns::default() };
    let observed = film_of(law, &particles, &truth, &config, 6, 16, DType::F32);
    let problem = problem_of(law, &particles, &observed, &config, DType::F32);
    assert_eq!(problem.secant > 0.0, law == "newtonian");
    let start = Unknowns { parameters: start.to_vec(), ..truth };
    let (mut whole, mut kept) = (Vec::new(), Vec::new());
    let search = |known: &[_], each: &mut gradreel_models::identify::Listener<'_>| {
        gauss_newton(&problem, &start, Free::Material, 6, 4.into(), known, each, &mut |_| ())
    };
    let uninterrupted = search(&[], &mut |evaluation, answer| {
        whole.push(evaluation.clone());
        kept.extend(answer.cloned());
        Ok(())
    })
    .unwrap();
    assert!(whole.len() > 4, "{} evaluations", whole.len());
    for stop in [1, 3, whole.len() - 1] {
        // what a run's file gives back
        let known: Vec<_> = kept[..stop]
            .iter()
            .map(|answer| serde_json::from_str(&serde_json::to_string(answer).unwrap()).unwrap())
            .collect();
        assert_eq!(known, kept[..stop]);
        let (mut again, mut new) = (Vec::new(), 0);
        let resumed = search(&known, &mut |evaluation, answer| {
            again.push(evaluation.clone());
            new += usize::from(answer.is_some());
            Ok(())
        })
        .unwrap();
        assert_eq!(resumed, uninterrupted);
        assert_eq!(again, whole);
        assert_eq!(new, whole.len() - stop);
    }
}
