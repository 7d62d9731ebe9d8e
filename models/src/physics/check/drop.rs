//! Conservation checks: a block dropped on frictionless ground.

use gradreel::Result;

use super::MaterialCheck;
use super::response::DENSITY;
use crate::physics::collider::{Collider, Contact};
use crate::physics::law::Law;
use crate::physics::substep::Simulation;
use crate::physics::timestep::{CFL, Schedule};
use crate::physics::values::Values;
use crate::physics::world::World;

/// Simulated time \[s\].
const TIME: f64 = 2.0;
/// Grid spacing \[m\].
const DX: f64 = 0.1;
/// Particles along each edge.
const SIDE: usize = 5;

/// The largest imbalances, relative to the mass or to the largest momentum of the fall.
#[derive(Default)]
struct Imbalance {
    mass: f64,
    transfer: f64,
    horizontal: f64,
    pull: f64,
}

/// Checks conservation of mass, momentum transfer between particles and grid, conservation of horizontal momentum, and
/// that the ground only pushes.
pub(super) fn checks(law: &Law) -> Vec<MaterialCheck> {
    match fall(law) {
        Ok(Imbalance { mass, transfer, horizontal, pull }) => {
            let check = |name, found| MaterialCheck { name, found, allowed: 1e-9, note: String::new() };
            vec![
                check("two-second drop: mass on the grid", mass),
                check("two-second drop: momentum from grid to body", transfer),
                check("two-second drop: horizontal momentum", horizontal),
                check("two-second drop: pull of the ground", pull),
            ]
        }
        Err(error) => {
            let note = error.to_string();
            vec![MaterialCheck { name: "two-second drop", found: f64::INFINITY, allowed: 1e-9, note }]
        }
    }
}

fn fall(law: &Law) -> Result<Imbalance> {
    let ground = Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Separate);
    let world = World { colliders: vec![ground], ..World::new(DX) };
    let values = law.start_values();
    // Compression raises the speed of sound: half of the default CFL number.
    let schedule = Schedule::stable(&world, 2, TIME, law.wave_speed_on(&values, DENSITY, world.dx), 3.0, 0.5 * CFL);
    let positions: Vec<[f64; 3]> = (0..SIDE.pow(3))
        .map(|i| [i / SIDE / SIDE, i / SIDE % SIDE, i % SIDE].map(|k| DX * (0.5 * k as f64 + 0.27)))
        .map(|[x, y, z]| [x, y + 0.6 * DX, z])
        .collect();
    let n = positions.len();
    let parameters = values.into_iter().map(Values::Same).collect();
    let mut simulation = Simulation::new(&world, law, schedule.dt(), n, &Values::Same(DENSITY), parameters)?;
    let mut now = simulation.at_rest(&positions, &vec![[0.3, -0.5, -0.2]; n])?;
    let mut next = now.zeros_like();
    let particle_mass = DENSITY * world.particle_volume;
    let mass = particle_mass * n as f64;
    let momentum = |velocities: &[[f64; 3]]| -> [f64; 3] {
        std::array::from_fn(|axis| particle_mass * velocities.iter().map(|v| v[axis]).sum::<f64>())
    };
    let (start, unit) = (momentum(&now.velocities()), mass * 3.0);
    let (mut before, mut most) = (start, Imbalance::default());
    for _ in 0..schedule.steps() {
        simulation.substep(&now, &mut next)?;
        let grid = simulation.grid_totals();
        let after = momentum(&next.velocities());
        most.mass = most.mass.max((grid[3] - mass).abs() / mass);
        for axis in 0..3 {
            most.transfer = most.transfer.max((grid[axis] - after[axis]).abs() / unit);
        }
        for axis in [0, 2] {
            most.horizontal = most.horizontal.max((after[axis] - start[axis]).abs() / unit);
        }
        let free = before[1] + mass * world.gravity[1] * schedule.dt();
        most.pull = most.pull.max((free - after[1]) / unit);
        before = after;
        std::mem::swap(&mut now, &mut next);
    }
    Ok(most)
}
