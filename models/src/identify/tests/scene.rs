//! A small scene: a block of rubber with colours falls onto the ground before a ring of cameras.

use std::sync::Arc;

use crate::identify::solve::{GaussNewton, Point, Setting, Threads, drive};
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Config, Free, Observed, Problem, Unknowns};
use crate::particles::Particles;
use crate::physics::materials;
use crate::render::{Rays, Target};
use crate::video::Camera;
use gradreel::{DType, Tape, Tensor};

/// A camera of `size`² pixels that looks from `angle` \[rad\] at a point above the origin.
pub fn camera(id: i64, angle: f64, size: usize) -> Camera {
    let (sin, cos) = angle.sin_cos();
    let centre = [1.6 * sin, 0.45, 1.6 * cos];
    // columns: right, up, backwards
    let c2w = [[cos, 0.0, sin, centre[0]], [0.0, 1.0, 0.0, centre[1]], [-sin, 0.0, cos, centre[2]]];
    let focal = 1.4 * size as f64;
    let middle = 0.5 * size as f64;
    Camera { id, width: size, height: size, fx: focal, fy: focal, cx: middle, cy: middle, c2w }
}

/// The default settings, but as few substeps as are stable: enough where picture and model are of one kind.
pub fn quick() -> Config {
    let mut config = Config::default();
    config.world.least_speed = 0.0;
    config
}

/// An L-shaped block, `edge` particles long, so that no symmetry hides an error.
pub fn block(edge: usize, spacing: f64) -> Particles {
    let mut particles = Particles { positions: vec![], opacity: vec![], colour: vec![], spacing };
    for i in 0..edge {
        for j in 0..edge {
            for k in 0..edge {
                if i >= edge / 2 && j >= edge / 2 {
                    continue;
                }
                let at = [i, j, k].map(|n| (n as f64 + 0.5) * spacing);
                particles.positions.push([at[0] - 0.2, at[1] + 0.28, at[2] - 0.15]);
                particles.opacity.push(if (i + j + k) % 5 == 0 { 0.7 } else { 1.0 });
                particles.colour.push([i, j, k].map(|n| 0.2 + 0.7 * n as f64 / edge as f64));
            }
        }
    }
    particles
}

/// Pixels of the block's motion as rubber with the true unknowns, and the problem's configuration.
pub fn film(
    particles: &Particles,
    truth: &Unknowns,
    config: &Config,
    frames: usize,
    size: usize,
    dtype: DType,
) -> Observed {
    film_of("neo_hookean", particles, truth, config, frames, size, dtype)
}

/// Pixels of the block's motion as some material.
pub fn film_of(
    law: &str,
    particles: &Particles,
    truth: &Unknowns,
    config: &Config,
    frames: usize,
    size: usize,
    dtype: DType,
) -> Observed {
    let cameras: Vec<Camera> = (0..3).map(|i| camera(i, 0.4 + 2.1 * i as f64, size)).collect();
    let rays = Arc::new(Rays::of_cameras(&cameras));
    let blank = Tensor::zeros([rays.len(), 4], dtype);
    let empty = Target { rgba: blank.clone(), weight: blank, robust: None, trajectory: None };
    let views = vec![size * size; cameras.len()];
    let unfilmed = Observed {
        rays,
        views,
        targets: vec![empty; frames],
        frame_dt: 1.0 / 24.0,
        imagined: vec![false; cameras.len()],
        sight: None,
        rows: None,
    };
    let problem = problem_of(law, particles, &unfilmed, config, dtype);
    let motion = problem.positions(truth).unwrap();
    let targets = (0..frames).map(|frame| {
        let tape = Tape::new();
        let positions = tape.constant(motion.clone()).select(0, frame);
        let opacity = tape.constant(particles.opacity(dtype).unwrap());
        let colour = tape.constant(particles.colour(dtype).unwrap());
        let rgba =
            problem.render(&positions, &opacity, &colour, &problem.observed.rays).unwrap().value().unwrap().clone();
        let weight = Tensor::full(1.0 / 100.0, rgba.shape(), dtype);
        Target { rgba, weight, robust: None, trajectory: None }
    });
    let targets = targets.collect();
    Observed { targets, ..unfilmed }
}

/// The problem of a neo-Hookean block over the ground.
pub fn problem<'a>(particles: &'a Particles, observed: &'a Observed, config: &Config, dtype: DType) -> Problem<'a> {
    problem_of("neo_hookean", particles, observed, config, dtype)
}

/// The problem of a block of some material over the ground.
pub fn problem_of<'a>(
    law: &str,
    particles: &'a Particles,
    observed: &'a Observed,
    config: &Config,
    dtype: DType,
) -> Problem<'a> {
    Problem::new(particles, observed, materials::find(law).unwrap(), config, dtype)
}

/// Where Gauss–Newton searches of so many steps end, from these starts, over the first frames.
pub fn search(problem: Problem<'_>, starts: &[Unknowns], free: Free, frames: usize, steps: usize) -> Vec<Point> {
    let law = problem.law.clone();
    let pictures = (frames * problem.observed.views.len()) as f64;
    // the pictures have no noise
    let setting = [Setting { problem, free, frames: 0..frames, floor: 1e-7 }];
    let reach = Config::default().estimate.reach;
    let begun = |start: &Unknowns| {
        GaussNewton::new(Prior::of(&law, free, start, None), 0, pictures, steps, start).reaching(reach)
    };
    let mut searches: Vec<GaussNewton<'_>> = starts.iter().map(begun).collect();
    drive(&Threads(&setting), &mut searches, &[], &mut |_, _| Ok(())).unwrap();
    searches.iter().map(|search| search.best().clone()).collect()
}
