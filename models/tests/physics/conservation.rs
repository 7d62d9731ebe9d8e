//! Free fall in closed form; momentum and angular momentum of a free body.

use gradreel_models::physics::{Law, Simulation, State, Values, World, materials::NeoHookean};

use crate::scene::cube;

const DX: f64 = 0.04;
const DT: f64 = 1e-4;

fn parameters() -> Vec<Values<f64>> {
    vec![Values::Same(2e5), Values::Same(0.3)]
}

/// A cube that is stretched, sheared and spinning, different in every particle.
fn wild() -> State<f64> {
    let x = cube(6, DX, [0.31, 0.52, -0.17]);
    let wave = |p: usize, k: usize| (0.37 * p as f64 + 1.3 * k as f64).sin();
    let v: Vec<_> = (0..x.len()).map(|p| [0, 1, 2].map(|k| 0.5 * wave(p, k))).collect();
    let matrix = |p: usize, scale: f64, shift: usize| {
        std::array::from_fn(|i| std::array::from_fn(|j| scale * wave(p, shift + 3 * i + j)))
    };
    let c: Vec<[[f64; 3]; 3]> = (0..x.len()).map(|p| matrix(p, 3.0, 3)).collect();
    let mut f: Vec<[[f64; 3]; 3]> = (0..x.len()).map(|p| matrix(p, 0.1, 12)).collect();
    for f in &mut f {
        (0..3).for_each(|i| f[i][i] += 1.0);
    }
    State::new(&x, &v, &c, &f).unwrap()
}

fn densities(n: usize) -> Vec<f64> {
    (0..n).map(|p| 700.0 + 300.0 * (0.9 * p as f64).cos()).collect()
}

#[test]
fn an_undeformed_body_falls_as_galileo_says() {
    let (law, world) = (Law::of(NeoHookean), World::new(DX));
    let x0 = cube(5, DX, [0.0, 1.0, 0.0]);
    let v0 = [0.7, 0.2, -0.4];
    let mut now = State::at_rest(&x0, &vec![v0; x0.len()]).unwrap();
    let mut next = State::zeros(x0.len());
    let mut simulation = Simulation::new(&world, &law, DT, x0.len(), &Values::Same(1000.0), parameters()).unwrap();
    let steps = 200;
    for _ in 0..steps {
        simulation.substep(&now, &mut next).unwrap();
        std::mem::swap(&mut now, &mut next);
    }
    let n = f64::from(steps);
    for (x, x0) in now.positions().iter().zip(&x0) {
        for axis in 0..3 {
            let fallen = world.gravity[axis] * DT * DT * n * (n + 1.0) / 2.0;
            approx::assert_abs_diff_eq!(x[axis], x0[axis] + v0[axis] * DT * n + fallen, epsilon = 1e-11);
        }
    }
}

/// Linear and angular momentum about the origin; the affine velocity carries `m dx²/4` of the latter.
fn momenta(state: &State<f64>, densities: &[f64], world: &World) -> [f64; 6] {
    let (x, v, c) = (state.positions(), state.velocities(), state.affine_velocities());
    let mut sum = [0.0; 6];
    for p in 0..x.len() {
        let m = densities[p] * world.particle_volume;
        let spin = world.dx * world.dx / 4.0;
        for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            sum[i] += m * v[p][i];
            sum[3 + i] += m * (x[p][j] * v[p][k] - x[p][k] * v[p][j] + spin * (c[p][k][j] - c[p][j][k]));
        }
    }
    sum
}

#[test]
fn a_free_body_keeps_momentum_and_angular_momentum() {
    let world = World { gravity: [0.0; 3], ..World::new(DX) };
    let law = Law::of(NeoHookean);
    let mut now = wild();
    let densities = densities(now.len());
    let before = momenta(&now, &densities, &world);
    let mut next = State::zeros(now.len());
    let density = Values::Each(densities.clone());
    let mut simulation = Simulation::new(&world, &law, DT, now.len(), &density, parameters()).unwrap();
    for _ in 0..100 {
        simulation.substep(&now, &mut next).unwrap();
        std::mem::swap(&mut now, &mut next);
    }
    let after = momenta(&now, &densities, &world);
    let scale: f64 = densities.iter().sum::<f64>() * world.particle_volume;
    for k in 0..6 {
        approx::assert_abs_diff_eq!(after[k], before[k], epsilon = 1e-11 * scale);
    }
}

#[test]
fn nothing_to_simulate_is_no_fault() {
    let (law, world) = (Law::of(NeoHookean), World::new(DX));
    let now = State::<f64>::at_rest(&[], &[]).unwrap();
    let mut simulation = Simulation::new(&world, &law, DT, 0, &Values::Same(1000.0), parameters()).unwrap();
    let mut next = State::zeros(0);
    simulation.substep(&now, &mut next).unwrap();
    simulation.substep_vjp(&now, &mut next, &mut State::zeros(0)).unwrap();
    assert!(next.is_empty() && simulation.value_gradients().density == [0.0]);
}
