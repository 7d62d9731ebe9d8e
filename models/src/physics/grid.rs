//! The whole grid: parallel scatter without conflicts, node update, vjp and jvp.
//!
//! Particles are listed by the slab of [`SLAB`] node planes in which their stencil starts. Even slabs are scattered in
//! parallel, then odd ones; within a slab particles keep their order. The order of every node's sum is therefore fixed,
//! whatever the number of threads.

use std::cell::RefCell;
use std::ops::Range;

use gradreel::Element;
use rayon::prelude::*;

use super::contact::{Placed, collide, collide_jvp, collide_vjp};
use super::denormals::Flush;
use super::kernel::{scatter, scatter_tangent};
use super::node_grid::{NodeGrid, SLAB};
use super::row::{Level, Number};
use super::state::BLOCK;
use super::transfer::Record;
use super::world::World;

/// Particles listed by slab. Each block of particles has its own list, so that lists are built in parallel.
#[derive(Debug, Default)]
pub(crate) struct Buckets {
    slabs: usize,
    /// The particles of each block, ordered by slab; within a slab they keep their order.
    order: Vec<u32>,
    /// For each block, the range of slabs of its particles.
    spans: Vec<Range<usize>>,
    /// For each block, the end of each slab's list.
    ends: Vec<u32>,
}

impl Buckets {
    /// Empty lists for this number of particles and slabs, one per block, to be filled.
    pub fn lists(&mut self, particles: usize, slabs: usize) -> impl IndexedParallelIterator<Item = BlockList<'_>> {
        self.slabs = slabs;
        self.order.resize(particles, 0);
        let blocks = particles.div_ceil(BLOCK);
        self.spans.resize(blocks, 0..0);
        self.ends.resize(blocks * slabs, 0);
        let lists = self.order.par_chunks_mut(BLOCK).zip(self.ends.par_chunks_exact_mut(slabs));
        let lists = lists.zip(&mut self.spans).enumerate();
        lists.map(|(block, ((order, ends), span))| BlockList { first: block * BLOCK, order, ends, span })
    }

    /// Collects the particles of a slab into `list`.
    fn of_slab(&self, slab: usize, list: &mut Vec<u32>) {
        list.clear();
        for (block, span) in self.spans.iter().enumerate().filter(|(_, span)| span.contains(&slab)) {
            let ends = &self.ends[block * self.slabs..];
            let start = if slab > span.start { ends[slab - 1] } else { 0 };
            list.extend_from_slice(&self.order[block * BLOCK..][start as usize..ends[slab] as usize]);
        }
    }
}

/// The lists of one block.
pub(crate) struct BlockList<'a> {
    first: usize,
    order: &'a mut [u32],
    ends: &'a mut [u32],
    span: &'a mut Range<usize>,
}

impl BlockList<'_> {
    /// Lists the particles of the block by slab: a stable counting sort.
    pub fn sort(self, slab: impl Fn(usize) -> usize) {
        let Self { first, order, ends, span } = self;
        let mut slabs = [0; BLOCK];
        let slabs = &mut slabs[..order.len()];
        let (mut lowest, mut end) = (usize::MAX, 0);
        for (i, at) in slabs.iter_mut().enumerate() {
            *at = slab(i);
            (lowest, end) = (lowest.min(*at), end.max(*at + 1));
        }
        *span = lowest..end;
        ends[span.clone()].fill(0);
        slabs.iter().for_each(|slab| ends[*slab] += 1);
        let mut start = 0;
        for end in &mut ends[span.clone()] {
            (*end, start) = (start, start + *end);
        }
        // counting sort: starts advance to ends
        for (i, slab) in slabs.iter().enumerate() {
            order[ends[*slab] as usize] = (first + i) as u32;
            ends[*slab] += 1;
        }
    }
}

/// Clears `grid` and scatters all records into it.
pub(crate) fn scatter_all<T: Number>(
    level: Level,
    node_grid: &NodeGrid<T>,
    grid: &mut Vec<T>,
    records: &[Record<T>],
    buckets: &Buckets,
) {
    by_slabs(node_grid, grid, buckets, |first_plane, region, order| {
        scatter(level, node_grid, first_plane, region, records, order);
    });
}

/// Clears `grid` and scatters the tangents of all records; see [`push_tangent`](super::transfer::push_tangent).
pub(crate) fn scatter_tangents<T: Number>(
    level: Level,
    node_grid: &NodeGrid<T>,
    grid: &mut Vec<T>,
    records: &[Record<T>],
    tangents: &[Record<T>],
    buckets: &Buckets,
) {
    by_slabs(node_grid, grid, buckets, |first_plane, region, order| {
        scatter_tangent(level, node_grid, first_plane, region, records, tangents, order);
    });
}

thread_local! {
    /// The particles of the slab that a thread visits.
    static LIST: RefCell<Vec<u32>> = const { RefCell::new(Vec::new()) };
}

/// Clears `grid` and visits each slab with its region, its first plane and its particles. Slabs with common nodes are
/// not visited concurrently.
fn by_slabs<T: Number>(
    node_grid: &NodeGrid<T>,
    grid: &mut Vec<T>,
    buckets: &Buckets,
    visit: impl Fn(usize, &mut [T], &[u32]) + Sync,
) {
    grid.resize(node_grid.len(), T::ZERO);
    grid.par_chunks_mut(node_grid.stride[0]).for_each(|plane| plane.fill(T::ZERO));
    let slab_len = SLAB * node_grid.stride[0];
    let odd_first = (node_grid.origin[0].div_euclid(SLAB as i32) & 1) as usize;
    for phase in [odd_first, 1 - odd_first] {
        let Some(rest) = grid.get_mut(phase * slab_len..) else { continue };
        rest.par_chunks_mut(2 * slab_len).with_max_len(1).enumerate().for_each(|(pair, region)| {
            let slab = 2 * pair + phase;
            if slab < buckets.slabs {
                let _flush = Flush::start();
                LIST.with_borrow_mut(|list| {
                    buckets.of_slab(slab, list);
                    visit(slab * SLAB, region, list);
                });
            }
        });
    }
}

/// Turns `[momentum, mass]` into `[velocity, mass]` at every node: gravity, then obstacles. Nodes below the least mass
/// get velocity 0.
pub(crate) fn update<T: Number>(world: &World, obstacles: &[Placed], node_grid: &NodeGrid<T>, dt: f64, grid: &mut [T]) {
    let least = T::from_f64(world.least_mass());
    let kick = world.gravity.map(|g| g * dt);
    each_plane(node_grid, grid, |node, value| {
        if value[3] > least {
            let v = collide(obstacles, node_grid.node(node), free_velocity(value, kick));
            value[..3].copy_from_slice(&v.map(T::from_f64));
        } else {
            value[..3].fill(T::ZERO);
        }
    });
}

/// The cotangents, or the tangents, of gravity and friction.
#[derive(Debug, Clone, Default)]
pub(crate) struct OnWorld {
    /// Of gravity.
    pub gravity: [f64; 3],
    /// Of the friction coefficients, one per obstacle.
    pub friction: Vec<f64>,
}

/// The vjp of [`update`]: `grid` becomes `[velocity, mass]`, and `cotangent` turns from that of the velocity into that
/// of momentum and mass: `g_mom = g/m`, `g_mass = −g·mom/m²`. Adds to the cotangents of the world.
pub(crate) fn update_vjp<T: Number>(
    world: &World,
    obstacles: &[Placed],
    node_grid: &NodeGrid<T>,
    dt: f64,
    grid: &mut [T],
    cotangent: &mut [T],
    on_world: &mut OnWorld,
) {
    let least = T::from_f64(world.least_mass());
    let kick = world.gravity.map(|g| g * dt);
    let plane = node_grid.stride[0].max(1);
    let both = grid.par_chunks_mut(plane).zip(cotangent.par_chunks_mut(plane)).enumerate();
    let planes: Vec<OnWorld> = both
        .map(|(x, (values, cotangents))| {
            let _flush = Flush::start();
            let mut sums = OnWorld { gravity: [0.0; 3], friction: vec![0.0; obstacles.len()] };
            for (at, (value, g)) in values.chunks_exact_mut(4).zip(cotangents.chunks_exact_mut(4)).enumerate() {
                if value[3] > least {
                    let node = node_grid.node([x, at / node_grid.shape[2], at % node_grid.shape[2]]);
                    let free = free_velocity(value, kick);
                    let after = [g[0], g[1], g[2]].map(Element::to_f64);
                    let (v, before) = collide_vjp(obstacles, node, free, after, &mut sums.friction);
                    (0..3).for_each(|axis| sums.gravity[axis] += dt * before[axis]);
                    let mass = value[3].to_f64();
                    let momentum: [f64; 3] = std::array::from_fn(|i| value[i].to_f64());
                    let on_mass = -(0..3).map(|i| before[i] * momentum[i]).sum::<f64>() / (mass * mass);
                    g[..3].copy_from_slice(&before.map(|g| T::from_f64(g / mass)));
                    g[3] = T::from_f64(on_mass);
                    value[..3].copy_from_slice(&v.map(T::from_f64));
                } else {
                    value[..3].fill(T::ZERO);
                    g.fill(T::ZERO);
                }
            }
            sums
        })
        .collect();
    on_world.friction.resize(obstacles.len(), 0.0);
    let sum = |of: &dyn Fn(&OnWorld) -> f64| planes.iter().map(of).sum::<f64>();
    (0..3).for_each(|axis| on_world.gravity[axis] += sum(&|plane| plane.gravity[axis]));
    (0..obstacles.len()).for_each(|k| on_world.friction[k] += sum(&|plane| plane.friction[k]));
}

/// The jvp of [`update`]: `tangent` turns from that of momentum and mass into that of the velocity. `grid` still holds
/// `[momentum, mass]`; `change` holds the tangents of the world.
pub(crate) fn update_jvp<T: Number>(
    world: &World,
    obstacles: &[Placed],
    node_grid: &NodeGrid<T>,
    dt: f64,
    grid: &[T],
    tangent: &mut [T],
    change: &OnWorld,
) {
    let least = T::from_f64(world.least_mass());
    let kick = world.gravity.map(|g| g * dt);
    let plane = node_grid.stride[0].max(1);
    tangent.par_chunks_mut(plane).zip(grid.par_chunks(plane)).enumerate().for_each(|(x, (tangents, values))| {
        let _flush = Flush::start();
        for (at, (d, value)) in tangents.chunks_exact_mut(4).zip(values.chunks_exact(4)).enumerate() {
            if value[3] > least {
                let per_mass = 1.0 / value[3].to_f64();
                let on_mass = d[3].to_f64() * per_mass;
                let free = free_velocity(value, kick);
                let along: [f64; 3] = std::array::from_fn(|i| {
                    (d[i].to_f64() - value[i].to_f64() * on_mass) * per_mass + dt * change.gravity[i]
                });
                let node = node_grid.node([x, at / node_grid.shape[2], at % node_grid.shape[2]]);
                d[..3].copy_from_slice(&collide_jvp(obstacles, node, free, along, &change.friction).map(T::from_f64));
                d[3] = T::ZERO;
            } else {
                d.fill(T::ZERO);
            }
        }
    });
}

/// `momentum/mass + dt g` \[m/s\]
#[inline(always)]
fn free_velocity<T: Number>(value: &[T], kick: [f64; 3]) -> [f64; 3] {
    let per_mass = 1.0 / value[3].to_f64();
    std::array::from_fn(|axis| value[axis].to_f64() * per_mass + kick[axis])
}

fn each_plane<T: Number>(node_grid: &NodeGrid<T>, grid: &mut [T], visit: impl Fn([usize; 3], &mut [T]) + Sync) {
    grid.par_chunks_mut(node_grid.stride[0].max(1)).enumerate().for_each(|(x, plane)| {
        let _flush = Flush::start();
        for (at, value) in plane.chunks_exact_mut(4).enumerate() {
            visit([x, at / node_grid.shape[2], at % node_grid.shape[2]], value);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::transfer::record;

    /// Particles throughout a box that spans several slabs, with arbitrary records.
    fn records<T: Number>() -> Vec<Record<T>> {
        let wave = |p: usize, k: usize| (1.3 * p as f64 + 2.1 * k as f64).sin();
        let number = |p: usize, k: usize| T::from_f64(wave(p, k));
        (0..500)
            .map(|p| {
                let x = [0.9 * wave(p, 0), 0.3 * wave(p, 1), 0.2 * wave(p, 2)].map(T::from_f64);
                let q = std::array::from_fn(|k| number(p, 3 + k));
                record(x, q, T::from_f64(1.5 + wave(p, 6)), std::array::from_fn(|k| number(p, 7 + k)))
            })
            .collect()
    }

    fn scattered<T: Number>(level: Level, records: &[Record<T>]) -> Vec<T> {
        let node_grid =
            NodeGrid::covering([[-0.9, -0.3, -0.2], [0.9, 0.3, 0.2]].map(|x| x.map(T::from_f64)), 0.05, 1 << 20);
        let node_grid = node_grid.unwrap();
        let mut buckets = Buckets::default();
        let lists = buckets.lists(records.len(), node_grid.slabs());
        lists.zip(records.par_chunks(BLOCK)).for_each(|(list, records)| list.sort(|i| node_grid.slab(records[i][7])));
        let mut grid = Vec::new();
        scatter_all(level, &node_grid, &mut grid, records, &buckets);
        grid
    }

    #[test]
    fn mass_and_momentum_arrive_whole() {
        let records = records::<f64>();
        let grid = scattered(Level::detect(), &records);
        for component in 0..4 {
            let sent: f64 = records.iter().map(|r| r[component]).sum();
            let arrived: f64 = grid.iter().skip(component).step_by(4).sum();
            approx::assert_abs_diff_eq!(sent, arrived, epsilon = 1e-11);
        }
    }

    #[test]
    fn instruction_sets_agree() {
        fn agree<T: Number>(tolerance: f64) {
            let records = records::<T>();
            let plain = scattered(Level::Portable, &records);
            for level in Level::available() {
                for (a, b) in scattered(level, &records).iter().zip(&plain) {
                    assert!((a.to_f64() - b.to_f64()).abs() < tolerance, "{level:?}: {a} is not {b}");
                }
            }
        }
        agree::<f32>(2e-5);
        agree::<f64>(1e-13);
    }
}
