//! Stress, single substeps and whole trajectories of an independent simulator, with their gradients.

use gradreel::scalar::Lanes;
use gradreel_models::physics::{Law, Number, Simulation, State, materials::NeoHookean};

use crate::scene::{Vectors, close, close_norm};

fn columns(values: &[f64]) -> Vec<Vec<f64>> {
    (0..9).map(|k| values.iter().skip(k).step_by(9).copied().collect()).collect()
}

fn rows(columns: &[Vec<f64>]) -> Vec<f64> {
    (0..columns[0].len()).flat_map(|p| columns.iter().map(move |column| column[p])).collect()
}

#[test]
fn stress_and_its_gradients() {
    let file = Vectors::load("constitutive_elastic");
    let law = Law::of(NeoHookean);
    let f = columns(file.get("F_trial"));
    let n = f[0].len();
    let parameters = file.young_poisson::<f64>();
    let [young, poisson] = [0, 1].map(|k| (0..n).map(|p| parameters[k].get(p)).collect::<Vec<_>>());
    let mut inputs: Vec<Lanes<'_, f64>> = f.iter().map(|column| Lanes::Each(column)).collect();
    inputs.extend([Lanes::Same(0.0); 9]);
    inputs.extend([Lanes::Same(file.number("dt")), Lanes::Each(&young), Lanes::Each(&poisson)]);

    let mut outputs = vec![vec![0.0; n]; 18];
    let mut slices: Vec<&mut [f64]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
    law.program().run(n, &inputs, &mut slices);
    close("F", &rows(&outputs[..9]), file.get("F_new"), 1e-12);
    close_norm("tau", &rows(&outputs[9..]), file.get("tau"), 1e-12);

    let cotangents = [columns(file.get("cot_F")), columns(file.get("cot_tau"))].concat();
    inputs.extend(cotangents.iter().map(|column| Lanes::Each(column)));
    let mut outputs = vec![vec![0.0; n]; 21];
    let mut slices: Vec<&mut [f64]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
    law.program().vjp().run(n, &inputs, &mut slices);
    close_norm("g_F_trial", &rows(&outputs[..9]), file.get("g_F_trial"), 1e-9);
    let [mu, lam] = file.to_lame(&outputs[19], &outputs[20]);
    close_norm("g_mu", &mu, file.get("g_mu"), 1e-9);
    close_norm("g_lam", &lam, file.get("g_lam"), 1e-9);
}

fn substep<T: Number>(name: &str, forward: f64, gradient: f64) {
    let file = Vectors::load(name);
    let (law, world) = (Law::of(NeoHookean), file.world());
    let state = |x: &str, v: &str, c: &str, f: &str| {
        State::<T>::new(&file.vectors(x), &file.vectors(v), &file.matrices(c), &file.matrices(f)).unwrap()
    };
    let now = state("x", "v", "C", "F");
    let mut next = State::zeros(now.len());
    let parameters = file.young_poisson();
    let mut simulation =
        Simulation::new(&world, &law, file.number("dt"), now.len(), &file.density(), parameters).unwrap();
    simulation.substep(&now, &mut next).unwrap();
    compare(&file, &next, ["x_new", "v_new", "C_new", "F_new"], &[forward; 4], close_norm);

    let mut cotangent = state("cot_x", "cot_v", "cot_C", "cot_F");
    simulation.substep_vjp(&now, &mut next, &mut cotangent).unwrap();
    compare(&file, &cotangent, ["g_x", "g_v", "g_C", "g_F"], &[gradient; 4], close_norm);
    value_gradients(&file, &simulation, "g_", gradient);
}

/// Compares positions, velocities, affine velocities and deformation gradients.
fn compare<T: Number>(
    file: &Vectors,
    state: &State<T>,
    names: [&str; 4],
    tolerances: &[f64; 4],
    close: fn(&str, &[T], &[f64], f64),
) {
    close(names[0], state.positions().as_flattened(), file.get(names[0]), tolerances[0]);
    close(names[1], state.velocities().as_flattened(), file.get(names[1]), tolerances[1]);
    close(names[2], state.affine_velocities().as_flattened().as_flattened(), file.get(names[2]), tolerances[2]);
    close(names[3], state.deformation_gradients().as_flattened().as_flattened(), file.get(names[3]), tolerances[3]);
}

fn value_gradients<T: Number>(file: &Vectors, simulation: &Simulation<'_, T>, prefix: &str, tolerance: f64) {
    let gradients = simulation.value_gradients();
    let [mu, lam] = file.to_lame(&gradients.parameters[0], &gradients.parameters[1]);
    close_norm("rho", &gradients.density, file.get(&format!("{prefix}rho")), tolerance);
    close_norm("mu", &mu, file.get(&format!("{prefix}mu")), tolerance);
    close_norm("lam", &lam, file.get(&format!("{prefix}lam")), tolerance);
}

#[test]
fn substep_on_sticky_ground() {
    substep::<f64>("substep_elastic_sticky", 1e-10, 1e-8);
    substep::<f32>("substep_elastic_sticky", 1e-4, 2e-3);
}

#[test]
fn substep_on_a_tilted_slippery_plane() {
    substep::<f64>("substep_elastic_slip_tilted", 1e-10, 1e-8);
    substep::<f32>("substep_elastic_slip_tilted", 1e-4, 2e-3);
}

fn trajectory<T: Number>(name: &str, tolerances: [f64; 4], gradient: f64) {
    let file = Vectors::load(name);
    let (law, world) = (Law::of(NeoHookean), file.world());
    let start = State::<T>::at_rest(&file.vectors("x0"), &file.vectors("v0")).unwrap();
    let parameters = file.young_poisson();
    let n = start.len();
    let mut simulation = Simulation::new(&world, &law, file.number("dt"), n, &file.density(), parameters).unwrap();
    let mut states = vec![start];
    for step in 0..file.number("steps") as usize {
        let mut next = State::zeros(n);
        simulation.substep(&states[step], &mut next).unwrap();
        states.push(next);
    }
    for step in file.list("keep") {
        let step = step as usize;
        let names = ["x", "v", "C", "F"].map(|part| format!("{part}_{step}"));
        compare(&file, &states[step], [&names[0], &names[1], &names[2], &names[3]], &tolerances, close);
    }

    let last = states.pop().unwrap();
    let target: Vec<[T; 3]> = file.vectors("target");
    let away: Vec<[T; 3]> = last.positions().iter().zip(&target).map(|(x, t)| [0, 1, 2].map(|i| x[i] - t[i])).collect();
    let loss = away.as_flattened().iter().map(|d| d.to_f64().powi(2)).sum::<f64>() / n as f64;
    close("loss", &[loss], file.get("loss"), tolerances[0]);
    let scale = T::from_f64(2.0 / n as f64);
    let (zero, zeros) = (vec![[T::ZERO; 3]; n], vec![[[T::ZERO; 3]; 3]; n]);
    let seed: Vec<[T; 3]> = away.iter().map(|d| d.map(|d| d * scale)).collect();
    let mut cotangent = State::new(&seed, &zero, &zeros, &zeros).unwrap();
    let mut scratch = State::zeros(n);
    for now in states.iter().rev() {
        simulation.substep_vjp(now, &mut scratch, &mut cotangent).unwrap();
    }
    compare(&file, &cotangent, ["grad.x0", "grad.v0", "grad.C0", "grad.F0"], &[gradient; 4], close_norm);
    value_gradients(&file, &simulation, "grad.", gradient);
}

#[test]
fn trajectory_of_an_elastic_block() {
    trajectory::<f64>("traj_elastic", [1e-12; 4], 1e-7);
    trajectory::<f32>("traj_elastic", [2e-6, 1e-4, 2e-3, 1e-4], 1e-4);
}

#[test]
fn trajectory_of_particles_of_different_opacity() {
    trajectory::<f64>("traj_elastic_soft_alpha", [1e-12; 4], 1e-7);
    trajectory::<f32>("traj_elastic_soft_alpha", [2e-6, 1e-4, 2e-3, 1e-4], 1e-4);
}

#[test]
fn trajectory_over_a_slippery_slope_and_a_sticky_rod() {
    trajectory::<f64>("traj_elastic_slip_cylinder", [1e-12; 4], 1e-7);
    trajectory::<f32>("traj_elastic_slip_cylinder", [2e-6, 1e-4, 2e-3, 1e-4], 1e-4);
}
