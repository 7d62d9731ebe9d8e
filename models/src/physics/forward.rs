//! Forward mode: a substep together with its derivatives along several directions.
//!
//! The adjoint gives the gradient of one scalar; forward mode gives the derivatives of all outputs along one direction,
//! as Gauss–Newton needs for few parameters and many residuals. Its memory does not grow with the number of substeps.

use gradreel::{ErrorKind, Result};
use rayon::prelude::*;

use super::denormals::Flush;
use super::grid::{OnWorld, scatter_tangents, update, update_jvp};
use super::kernel::{MOVING, advance_tangent, interpolate_tangent, moving};
use super::law::Run;
use super::node_grid::NodeGrid;
use super::row::Number;
use super::state::{BLOCK, C, F, HISTORY, State, V};
use super::substep::{Constants, Simulation, block_len, masses, with_scratch};
use super::transfer::{Record, position, record};
use super::values::Values;

/// The derivative of a simulation along one direction: the tangents of its state and of its constants.
#[derive(Debug, Clone)]
pub struct Tangent<T> {
    /// Tangent of the state; advances with the simulation.
    pub state: State<T>,
    /// Tangent of the density \[kg/m³\].
    pub density: Values<T>,
    /// Tangents of each portion's parameters, in the order of its law.
    pub parameters: Vec<Vec<Values<T>>>,
    /// Tangent of gravity \[m/s²\].
    pub gravity: [f64; 3],
    /// Tangents of the friction coefficient of each obstacle.
    pub friction: Vec<f64>,
}

/// Buffers of one tangent.
#[derive(Debug, Clone, Default)]
pub(super) struct Buffers<T> {
    records: Vec<Record<T>>,
    grid: Vec<T>,
    old_records: Vec<Record<T>>,
    old_grid: Vec<T>,
}

impl<T: Number> Simulation<'_, T> {
    /// A zero tangent, to be filled in. `like` is a state of the simulation.
    pub fn tangent(&self, like: &State<T>) -> Tangent<T> {
        Tangent {
            state: like.zeros_like(),
            density: Values::Same(T::ZERO),
            parameters: self.portions.iter().map(|p| vec![Values::Same(T::ZERO); p.parameters.len()]).collect(),
            gravity: [0.0; 3],
            friction: vec![0.0; self.world.colliders.len()],
        }
    }

    /// Advances `now` by one substep into `next`, and the tangents along with it.
    ///
    /// # Errors
    ///
    /// As [`Simulation::substep`]; [`ErrorKind::NonFinite`] when a tangent is not finite.
    ///
    /// # Panics
    ///
    /// If a state has another number of particles, or a tangent has the wrong number of values.
    #[track_caller]
    pub fn substep_jvp(&mut self, now: &State<T>, next: &mut State<T>, tangents: &mut [Tangent<T>]) -> Result<()> {
        self.check(&[now, next]);
        for tangent in &*tangents {
            self.check(&[&tangent.state]);
            let counts: Vec<usize> = tangent.parameters.iter().map(Vec::len).collect();
            let wanted: Vec<usize> = self.portions.iter().map(|portion| portion.parameters.len()).collect();
            assert!(counts == wanted, "substep_jvp: tangents of {counts:?} parameters, {wanted:?} wanted");
            let (found, wanted) = (tangent.friction.len(), self.world.colliders.len());
            assert!(found == wanted, "substep_jvp: tangents of {found} coefficients of friction, {wanted} wanted");
        }
        if now.is_empty() {
            return Ok(());
        }
        let node_grid = self.scatter(now, &mut next.values)?;
        self.scatter_old(now, &node_grid);
        let (level, world, dt) = (self.level, self.world, self.dt);
        // Taken out, so that `self` can be borrowed besides.
        let mut buffers = std::mem::take(&mut self.tangents);
        buffers.resize_with(tangents.len(), Buffers::default);
        // In parallel over tangents: workers that would idle on one continue with another.
        tangents.par_iter_mut().zip(&mut buffers).for_each(|(tangent, own)| {
            self.scatter_material(now, tangent, own);
            scatter_tangents(level, &node_grid, &mut own.grid, &self.scattered, &own.records, &self.buckets);
            if world.flip > 0.0 {
                self.scatter_old_tangent(now, &node_grid, tangent, own);
            }
            let change = OnWorld { gravity: tangent.gravity, friction: tangent.friction.clone() };
            update_jvp(world, &self.obstacles, &node_grid, dt, &self.grid, &mut own.grid, &change);
        });
        update(world, &self.obstacles, &node_grid, dt, &mut self.grid);
        self.advance(&node_grid, now, next)?;
        if tangents.is_empty() {
            return Ok(());
        }
        let mut slopes = std::mem::take(&mut self.slopes);
        self.move_all(&node_grid, now, &self.grid, &mut slopes[0]);
        if world.flip > 0.0 {
            self.move_all(&node_grid, now, &self.old.grid, &mut slopes[1]);
        }
        let (particles, [slopes_now, slopes_old]) = (self.particles, &slopes);
        let (flip, step) = (T::from_f64(world.flip), T::from_f64(dt));
        let all = tangents.par_iter_mut().zip(&buffers).map(|(tangent, own)| {
            let stride = now.stride();
            let blocks = now.values.par_chunks_exact(stride).zip(tangent.state.values.par_chunks_exact_mut(stride));
            let sound = blocks.enumerate().map(|(block, (now, tangent))| {
                let _flush = Flush::start();
                let len = block_len(particles, block);
                let own_slopes = block * MOVING * BLOCK..(block + 1) * MOVING * BLOCK;
                let mut kept = [T::ZERO; 4 * BLOCK];
                if flip > T::ZERO {
                    let slopes = &slopes_old[own_slopes.clone()];
                    interpolate_tangent(level, &node_grid, &own.old_grid, slopes, now, tangent, len, &mut kept);
                    let own = tangent[V * BLOCK..][..3 * BLOCK].iter();
                    kept.iter_mut().zip(own).for_each(|(kept, &own)| *kept = flip * (own - *kept));
                }
                advance_tangent(level, &node_grid, &own.grid, &slopes_now[own_slopes], step, now, len, tangent);
                if flip > T::ZERO {
                    let v = tangent[V * BLOCK..][..3 * BLOCK].iter_mut();
                    v.zip(&kept).for_each(|(v, &kept)| *v += kept);
                }
                (0..3).all(|axis| tangent[(V + axis) * BLOCK..][..len].iter().all(|v| v.is_finite()))
            });
            sound.reduce(|| true, |a, b| a & b)
        });
        let sound: Vec<bool> = all.collect();
        (self.tangents, self.slopes) = (buffers, slopes);
        let Some(index) = sound.iter().position(|sound| !sound) else { return Ok(()) };
        Err(gradreel::Error::new(ErrorKind::NonFinite, "a derivative of the simulation is not finite")
            .at(format!("direction {index}, substep {}, t = {:.6} s", self.substep - 1, self.substep as f64 * dt))
            .wanted("finite tangents")
            .fix("use more substeps per frame, or parameters away from the limits of the material"))
    }

    /// The gather of all particles and its derivatives with respect to their positions; shared by all tangents.
    fn move_all(&self, node_grid: &NodeGrid<T>, now: &State<T>, grid: &[T], slopes: &mut Vec<T>) {
        slopes.resize(now.values.len() / now.stride() * MOVING * BLOCK, T::ZERO);
        let blocks = now.values.par_chunks_exact(now.stride()).zip(slopes.par_chunks_exact_mut(MOVING * BLOCK));
        blocks.enumerate().for_each(|(block, (now, slopes))| {
            let _flush = Flush::start();
            moving(self.level, node_grid, grid, now, block_len(self.particles, block), slopes);
        });
    }

    /// The tangents of the records; those of `F` and history are advanced to the end of the substep.
    fn scatter_material(&self, now: &State<T>, tangent: &mut Tangent<T>, own: &mut Buffers<T>) {
        let mass = masses(&tangent.density, &self.portions);
        let constants = Constants::of(self.world, self.dt, &self.mass);
        let (portions, particles, stride) = (&self.portions, self.particles, now.stride());
        own.records.resize(particles, [T::ZERO; 16]);
        let parameters = &tangent.parameters;
        let blocks = now.values.par_chunks_exact(stride).zip(tangent.state.values.par_chunks_exact_mut(stride));
        blocks.zip(own.records.par_chunks_mut(BLOCK).zip(self.scattered.par_chunks(BLOCK))).enumerate().for_each(
            |(block, ((now, tangent), (records, scattered)))| {
                let _flush = Flush::start();
                let mut affine = [T::ZERO; 9 * BLOCK];
                for (portion, parameters) in portions.iter().zip(parameters) {
                    let Some(with) = constants.run(portion, block, particles) else { continue };
                    let direction = Run {
                        dt: T::ZERO,
                        stress_scale: T::ZERO,
                        mass: mass.run(with.particle, with.len),
                        parameters,
                        ..with
                    };
                    let lanes = with.first..with.first + with.len;
                    with_scratch(portion.law.tangent_count() * BLOCK, |found| {
                        portion.law.push_forward(now, &with, tangent, &direction, found);
                        let array = |k: usize| &found[k * BLOCK..][lanes.clone()];
                        for k in 0..9 {
                            tangent[(F + k) * BLOCK..][lanes.clone()].copy_from_slice(array(k));
                            affine[k * BLOCK..][lanes.clone()].copy_from_slice(array(9 + k));
                        }
                        for k in 18..portion.law.tangent_count() {
                            tangent[(HISTORY + k - 18) * BLOCK..][lanes.clone()].copy_from_slice(array(k));
                        }
                    });
                }
                for (i, (out, scattered)) in records.iter_mut().zip(scattered).enumerate() {
                    let at = |component: usize| tangent[component * BLOCK + i];
                    let (dx, m, dm) = ([at(0), at(1), at(2)], scattered[3], mass.get(block * BLOCK + i));
                    let q = std::array::from_fn(|axis| m * at(V + axis) + dm * now[(V + axis) * BLOCK + i]);
                    let a = std::array::from_fn(|k| affine[k * BLOCK + i]);
                    *out = record(dx, less(q, scattered, dx), dm, a);
                }
            },
        );
    }

    /// The tangents of node velocities before forces.
    fn scatter_old_tangent(&self, now: &State<T>, node_grid: &NodeGrid<T>, tangent: &Tangent<T>, own: &mut Buffers<T>) {
        own.old_records.resize(self.particles, [T::ZERO; 16]);
        let directions = &own.records;
        let stride = now.stride();
        now.values
            .par_chunks_exact(stride)
            .zip(tangent.state.values.par_chunks_exact(stride))
            .zip(own.old_records.par_chunks_mut(BLOCK).zip(self.old.scattered.par_chunks(BLOCK)))
            .enumerate()
            .for_each(|(block, ((now, tangent), (records, scattered)))| {
                let _flush = Flush::start();
                for (i, (out, old)) in records.iter_mut().zip(scattered).enumerate() {
                    let particle = block * BLOCK + i;
                    let (m, dm) = (self.mass.get(particle), directions[particle][3]);
                    let change = |k: usize| m * tangent[k * BLOCK + i] + dm * now[k * BLOCK + i];
                    let dx = position(&directions[particle]);
                    let q = less(std::array::from_fn(|axis| change(V + axis)), old, dx);
                    *out = record(dx, q, T::ZERO, std::array::from_fn(|k| change(C + k)));
                }
            });
        let old = &self.old;
        scatter_tangents(self.level, node_grid, &mut own.old_grid, &old.scattered, &own.old_records, &self.buckets);
        let least = T::from_f64(self.world.least_mass());
        let plane = node_grid.stride[0].max(1);
        let changes = own.old_grid.par_chunks_mut(plane).zip(own.grid.par_chunks(plane));
        changes.zip(old.grid.par_chunks(plane).zip(self.grid.par_chunks(plane))).for_each(
            |((changes, new_changes), (old, new))| {
                let nodes = changes.chunks_exact_mut(4).zip(new_changes.chunks_exact(4));
                for ((d, new_d), (v, new)) in nodes.zip(old.chunks_exact(4).zip(new.chunks_exact(4))) {
                    if new[3] > least {
                        // v⁰ = p⁰/m
                        (0..3).for_each(|axis| d[axis] = (d[axis] - v[axis] * new_d[3]) / new[3]);
                        d[3] = T::ZERO;
                    } else {
                        d.fill(T::ZERO);
                    }
                }
            },
        );
    }
}

/// `q − A dx`, with `A` from a record.
#[inline(always)]
fn less<T: Number>(q: [T; 3], record: &Record<T>, dx: [T; 3]) -> [T; 3] {
    std::array::from_fn(|axis| {
        q[axis] - record[4 + axis] * dx[0] - record[8 + axis] * dx[1] - record[12 + axis] * dx[2]
    })
}
