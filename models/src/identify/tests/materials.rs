//! Five materials recovered from pictures, as the pool searches them.

use gradreel::DType;

use super::scene::{block, film_of, problem_of, quick, search};
use crate::identify::hypotheses::{Hypothesis, apart};
use crate::identify::solve::Point;
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Free, Unknowns};
use crate::physics::Map;

/// Films a block and finds its material again: points of the prior, then Gauss–Newton from the best that lie apart.
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
    let law = problem.law.clone();
    let points = Prior::of(&law, free, &truth, None).points(&truth, 24 * allowed.len());
    let ended = |points: Vec<Point>| -> Vec<Hypothesis> {
        let one =
            |at: Point| Hypothesis { loss: Some(at.loss), cost: Some(at.cost), ..Hypothesis::new(name, at.unknowns) };
        points.into_iter().map(one).collect()
    };
    let looked = search(problem, &points, free, frames, 0);
    let starts = apart(ended(looked), 3, f64::INFINITY, &|_| (&law, free));
    assert!(!starts.is_empty());
    let starts: Vec<Unknowns> = starts.into_iter().map(|start| start.unknowns).collect();
    let again = problem_of(name, &particles, &observed, &config, DType::F32);
    let found = search(again, &starts, free, frames, 12);
    let found = found.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).unwrap();
    println!("{name}: {:?} (true {:?}), loss {:.2e}", found.unknowns.parameters, truth.parameters, found.loss);
    for &(k, allowed) in allowed {
        let parameter = law.parameters()[k];
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
