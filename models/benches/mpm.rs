//! Nanoseconds per particle and substep of the material point method, forwards and backwards.
//!
//! `cargo bench -p gradreel-models --bench mpm [-- particles-per-edge [threads]]`. The floor is what the machine needs to
//! move the bytes of a particle's state through memory once, at an assumed 15 GB/s per core.

use std::time::Instant;

use gradreel_models::physics::{Collider, Law, Number, Simulation, State, Values, World, materials::NeoHookean};

fn main() {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<usize>().ok());
    let side = numbers.next().unwrap_or(40);
    let threads = numbers.next().unwrap_or(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        measure::<f32>(side, threads);
        measure::<f64>(side, threads);
    });
}

fn measure<T: Number>(side: usize, threads: usize) {
    let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
    let law = Law::of(NeoHookean);
    let positions: Vec<[T; 3]> = (0..side * side * side)
        .map(|i| [i / (side * side), i / side % side, i % side].map(|k| T::from_f64(0.0101 * k as f64 + 0.003)))
        .collect();
    let n = positions.len();
    let fall = [T::ZERO, T::from_f64(-1.0), T::ZERO];
    let parameters = vec![Values::Same(T::from_f64(1e5)), Values::Same(T::from_f64(0.3))];
    let density = Values::Same(T::from_f64(1000.0));
    let mut simulation = Simulation::new(&world, &law, 2e-4, n, &density, parameters).expect("sound inputs");
    let mut now = State::at_rest(&positions, &vec![fall; n]).expect("finite numbers");
    let mut next = State::zeros(n);
    let warm = 40;
    let steps = 20;
    let mut forward = f64::INFINITY;
    for round in 0..3 {
        let start = Instant::now();
        for _ in 0..if round == 0 { warm } else { steps } {
            simulation.substep(&now, &mut next).expect("a stable step");
            std::mem::swap(&mut now, &mut next);
        }
        if round > 0 {
            forward = forward.min(start.elapsed().as_secs_f64() / (steps * n) as f64);
        }
    }
    let mut cotangent = now.clone();
    let mut reverse = f64::INFINITY;
    for _ in 0..3 {
        let start = Instant::now();
        for _ in 0..steps / 2 {
            simulation.substep_vjp(&now, &mut next, &mut cotangent).expect("a stable step");
        }
        reverse = reverse.min(start.elapsed().as_secs_f64() / (steps / 2 * n) as f64);
    }
    let floor = 48.0 * size_of::<T>() as f64 / (15e9 * threads as f64);
    println!(
        "{:>4} {n:>8} particles {threads:>2} threads   forward {:6.1} ns ({:4.1} x floor)   reverse {:6.1} ns ({:4.1} x floor)",
        T::NAME,
        forward * 1e9,
        forward / floor,
        reverse * 1e9,
        reverse / (2.0 * floor),
    );
}
