//! The blend of APIC and FLIP: particles keep a share of their own velocity and add only the change on the grid.
//!
//! `v' = Σ w v_i + flip (v − Σ w v_i⁰)`, where `v_i⁰` comes from a scatter of `m (v + C δ)` without stress. The second
//! scatter and gather, and their adjoints, run only if [`World::flip`](super::World::flip) is above 0.
//!
//! Source: Brackbill and Ruppel, *FLIP*, 1986; Fei et al., *Revisiting Integration in the Material Point Method*, 2021.

use gradreel::scalar::Lanes;
use rayon::prelude::*;

use super::denormals::Flush;
use super::grid::scatter_all;
use super::kernel::{collect_old, interpolate};
use super::node_grid::NodeGrid;
use super::row::{Level, Number};
use super::state::{BLOCK, C, State, V};
use super::substep::{Simulation, block_len};
use super::transfer::{Record, position, record};

/// Buffers of the blend.
#[derive(Debug, Clone, Default)]
pub(super) struct Old<T> {
    /// Records scattered for the velocity.
    pub scattered: Vec<Record<T>>,
    /// Records scattered by the adjoint of their gather.
    gathered: Vec<Record<T>>,
    /// Node velocities before forces.
    pub grid: Vec<T>,
    /// The cotangents of the momenta before forces.
    cotangent_grid: Vec<T>,
}

impl<T: Number> Simulation<'_, T> {
    /// Node velocities before forces; `grid` holds momentum and mass.
    pub(super) fn scatter_old(&mut self, now: &State<T>, node_grid: &NodeGrid<T>) {
        if self.world.flip == 0.0 {
            return;
        }
        let (mass, old) = (&self.mass, &mut self.old);
        old.scattered.resize(self.particles, [T::ZERO; 16]);
        now.values.par_chunks_exact(now.stride()).zip(old.scattered.par_chunks_mut(BLOCK)).enumerate().for_each(
            |(block, (now, records))| {
                let _flush = Flush::start();
                let masses = mass.run(block * BLOCK, records.len());
                for (i, out) in records.iter_mut().enumerate() {
                    let (at, m) = (|component: usize| now[component * BLOCK + i], mass_of(masses, i));
                    let q = std::array::from_fn(|axis| m * at(V + axis));
                    *out = record([at(0), at(1), at(2)], q, T::ZERO, std::array::from_fn(|k| m * at(C + k)));
                }
            },
        );
        scatter_all(self.level, node_grid, &mut old.grid, &old.scattered, &self.buckets);
        let least = T::from_f64(self.world.least_mass());
        let plane = node_grid.stride[0].max(1);
        old.grid.par_chunks_mut(plane).zip(self.grid.par_chunks(plane)).for_each(|(old, now)| {
            for (old, now) in old.chunks_exact_mut(4).zip(now.chunks_exact(4)) {
                if now[3] > least {
                    (0..3).for_each(|axis| old[axis] /= now[3]);
                } else {
                    old.fill(T::ZERO);
                }
            }
        });
    }

    /// Adds the FLIP share to the particle velocities.
    pub(super) fn blend(&self, node_grid: &NodeGrid<T>, now: &State<T>, next: &mut State<T>) {
        if self.world.flip == 0.0 {
            return;
        }
        let (flip, level, particles, grid) = (T::from_f64(self.world.flip), self.level, self.particles, &self.old.grid);
        let stride = now.stride();
        let blocks = now.values.par_chunks_exact(stride).zip(next.values.par_chunks_exact_mut(stride));
        blocks.enumerate().for_each(|(block, (now, next))| {
            let _flush = Flush::start();
            let mut before = [T::ZERO; 4 * BLOCK];
            interpolate(level, node_grid, grid, now, block_len(particles, block), &mut before);
            let velocities = &now[V * BLOCK..][..3 * BLOCK];
            let blended = next[V * BLOCK..][..3 * BLOCK].iter_mut();
            for ((v, &own), &before) in blended.zip(velocities).zip(&before) {
                *v += flip * (own - before);
            }
        });
    }

    /// The cotangents of the momenta before forces, and of the node masses through them.
    pub(super) fn scatter_old_cotangents(&mut self, node_grid: &NodeGrid<T>, cotangent: &State<T>) {
        if self.world.flip == 0.0 {
            return;
        }
        let (flip, old) = (T::from_f64(self.world.flip), &mut self.old);
        old.gathered.resize(self.particles, [T::ZERO; 16]);
        cotangent
            .values
            .par_chunks_exact(cotangent.stride())
            .zip(old.gathered.par_chunks_mut(BLOCK))
            .zip(old.scattered.par_chunks(BLOCK))
            .for_each(|((cotangent, records), scattered)| {
                let _flush = Flush::start();
                for (i, (out, scattered)) in records.iter_mut().zip(scattered).enumerate() {
                    let q = std::array::from_fn(|axis| -(flip * cotangent[(V + axis) * BLOCK + i]));
                    *out = record(position(scattered), q, T::ZERO, [T::ZERO; 9]);
                }
            });
        scatter_all(self.level, node_grid, &mut old.cotangent_grid, &old.gathered, &self.buckets);
        let least = T::from_f64(self.world.least_mass());
        let plane = node_grid.stride[0].max(1);
        let grids = self.cotangent_grid.par_chunks_mut(plane).zip(self.grid.par_chunks(plane));
        let olds = old.cotangent_grid.par_chunks_mut(plane).zip(old.grid.par_chunks(plane));
        grids.zip(olds).for_each(|((on_new, new), (on_old, old))| {
            let nodes = on_new.chunks_exact_mut(4).zip(new.chunks_exact(4));
            for ((on_new, new), (g, v)) in nodes.zip(on_old.chunks_exact_mut(4).zip(old.chunks_exact(4))) {
                if new[3] > least {
                    (0..3).for_each(|axis| g[axis] /= new[3]);
                    on_new[3] -= g[0] * v[0] + g[1] * v[1] + g[2] * v[2];
                } else {
                    g.fill(T::ZERO);
                }
            }
        });
    }
}

impl<T: Number> Old<T> {
    /// Adds the contribution of the velocities before forces to the cotangents of a block: position and velocity,
    /// affine velocity (`on_c`, nine arrays) and mass.
    #[allow(clippy::too_many_arguments)] // plain data of one loop
    pub(super) fn collect(
        &self,
        level: Level,
        node_grid: &NodeGrid<T>,
        block: usize,
        now: &[T],
        masses: Lanes<'_, T>,
        cotangent: &mut [T],
        on_c: &mut [T],
        on_mass: &mut [T],
    ) {
        let start = block * BLOCK;
        let end = (start + BLOCK).min(self.scattered.len());
        let (scattered, gathered) = (&self.scattered[start..end], &self.gathered[start..end]);
        let mut sums = [T::ZERO; 4 * BLOCK];
        collect_old(
            level,
            node_grid,
            &self.cotangent_grid,
            &self.grid,
            scattered,
            gathered,
            cotangent,
            on_c,
            &mut sums,
        );
        for i in 0..scattered.len() {
            let (at, m) = (|component: usize| now[component * BLOCK + i], mass_of(masses, i));
            for axis in 0..3 {
                let g = sums[axis * BLOCK + i];
                on_mass[i] += g * at(V + axis);
                // The share of `v` that is kept.
                let on_v = &mut cotangent[(V + axis) * BLOCK + i];
                *on_v = *on_v + m * g - gathered[i][axis];
            }
            for k in 0..9 {
                let g = &mut on_c[k * BLOCK + i];
                on_mass[i] += *g * at(C + k);
                *g = m * *g;
            }
        }
    }
}

fn mass_of<T: Number>(masses: Lanes<'_, T>, i: usize) -> T {
    match masses {
        Lanes::Same(mass) => mass,
        Lanes::Each(masses) => masses[i],
    }
}
