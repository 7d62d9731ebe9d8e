//! One substep, forward and vjp; see `forward.rs` for forward mode, `flip.rs` for the blend of APIC and FLIP.
//!
//! Forward: material → records → scatter → node update → gather. Vjp, from the state at the start of the substep:
//! recompute material and scatter; scatter the cotangents of gathered values; node adjoint; gather the cotangents of
//! scattered values; adjoint of the material. Buffers belong to the simulation; a substep does not allocate.

use std::cell::RefCell;
use std::ops::Range;

use gradreel::{Element, Error, ErrorKind, Result};
use rayon::prelude::*;

use super::contact::Placed;
use super::denormals::Flush;
use super::failure::{Moment, failure};
use super::flip::Old;
use super::forward::Buffers;
use super::grid::{Buckets, scatter_all, update, update_vjp};
use super::kernel::{Limits, Motion, advance, assemble, collect, momenta};
use super::law::{Law, Run};
use super::node_grid::NodeGrid;
use super::row::{Level, Number};
use super::state::{BLOCK, C, F, HISTORY, State, V, widen};
use super::totals::{Sink, Totals};
use super::transfer::Record;
use super::values::{ValueGradients, Values, check_values};
use super::world::World;

/// Consecutive particles of one material.
#[derive(Debug, Clone)]
pub struct Portion<'a, T> {
    /// Their material.
    pub law: &'a Law,
    /// The range of their indices.
    pub particles: Range<usize>,
    /// Rest volume of each of them \[m³\].
    pub volume: f64,
    /// Parameters in the order of [`Law::parameters`]. A list has one entry per particle of the whole simulation; those
    /// of the portion are used.
    pub parameters: Vec<Values<T>>,
}

/// Materials in a world with a fixed substep: advances states, and cotangents backward.
#[derive(Debug)]
pub struct Simulation<'a, T: Number> {
    pub(super) world: &'a World,
    pub(super) dt: f64,
    pub(super) particles: usize,
    /// History variables per particle: the maximum over the materials.
    pub(super) history: usize,
    pub(super) mass: Values<T>,
    /// Whether all particles have the same density; masses may still differ.
    one_density: bool,
    pub(super) portions: Vec<Portion<'a, T>>,
    pub(super) labels: Vec<u32>,
    pub(super) level: Level,
    /// Number of substeps taken, for error messages and moving obstacles.
    pub(crate) substep: usize,
    // Buffers.
    pub(super) obstacles: Vec<Placed>,
    pub(super) scattered: Vec<Record<T>>,
    gathered: Vec<Record<T>>,
    motions: Vec<Motion<T>>,
    pub(super) buckets: Buckets,
    pub(super) grid: Vec<T>,
    pub(super) cotangent_grid: Vec<T>,
    pub(super) old: Old<T>,
    pub(super) tangents: Vec<Buffers<T>>,
    /// Shared by all tangents: derivatives of the gather with respect to positions, from the grid and from the grid
    /// before forces.
    pub(super) slopes: [Vec<T>; 2],
    totals: Totals<T>,
}

impl<'a, T: Number> Simulation<'a, T> {
    /// Prepares a simulation of `particles` particles with substep `dt` \[s\]. `density` in kg/m³; `parameters` in the
    /// order of [`Law::parameters`].
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] for an invalid world, substep or density, [`ErrorKind::NonFinite`] for a non-finite
    /// parameter.
    ///
    /// # Panics
    ///
    /// If the number of parameters, or of their values, is wrong.
    #[track_caller]
    pub fn new(
        world: &'a World,
        law: &'a Law,
        dt: f64,
        particles: usize,
        density: &Values<T>,
        parameters: Vec<Values<T>>,
    ) -> Result<Self> {
        check_values(law, density, &parameters, particles)?;
        Self::of_portions(
            world,
            dt,
            density,
            vec![Portion { law, particles: 0..particles, volume: world.particle_volume, parameters }],
        )
    }

    /// Prepares a simulation of several materials; the portions cover all particles, one after the other.
    ///
    /// # Errors
    ///
    /// As [`Simulation::new`].
    ///
    /// # Panics
    ///
    /// If a portion does not start where the previous one ends, or its parameters have the wrong number.
    #[track_caller]
    pub fn of_portions(world: &'a World, dt: f64, density: &Values<T>, portions: Vec<Portion<'a, T>>) -> Result<Self> {
        world.check()?;
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Error::new(ErrorKind::Input, "the substep must be positive").found(format!("{dt} s")));
        }
        let mut particles = 0;
        for Portion { particles: range, .. } in &portions {
            assert!(range.start == particles && range.end >= particles, "portions: {range:?} follows {particles}");
            particles = range.end;
        }
        for Portion { law, parameters, .. } in &portions {
            check_values(law, density, parameters, particles)?;
        }
        if let Some(Portion { volume, .. }) = portions.iter().find(|p| !(p.volume.is_finite() && p.volume > 0.0)) {
            let error = Error::new(ErrorKind::Input, "a particle has no volume").found(format!("{volume:?} m³"));
            return Err(error.wanted("a positive number"));
        }
        let mass = masses(density, &portions);
        let one_density = matches!(density, Values::Same(_));
        let blocks = particles.div_ceil(BLOCK);
        let totals = Totals::new(std::iter::once(&mass).chain(portions.iter().flat_map(|p| &p.parameters)), blocks);
        Ok(Self {
            world,
            dt,
            particles,
            history: portions.iter().map(|portion| portion.law.history().len()).max().unwrap_or(0),
            mass,
            one_density,
            portions,
            labels: Vec::new(),
            level: Level::detect(),
            substep: 0,
            obstacles: Vec::new(),
            scattered: vec![[T::ZERO; 16]; particles],
            gathered: Vec::new(),
            motions: vec![Motion { extent: [[T::ZERO; 3]; 2], broken: None }; blocks],
            buckets: Buckets::default(),
            grid: Vec::new(),
            cotangent_grid: Vec::new(),
            old: Old::default(),
            tangents: Vec::new(),
            slopes: [Vec::new(), Vec::new()],
            totals,
        })
    }

    /// Undeformed particles at these positions \[m\] with these velocities \[m/s\] and the initial history of their
    /// materials, which may depend on the place ([`Law::placed`]).
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NonFinite`] naming the first particle with a non-finite value.
    ///
    /// # Panics
    ///
    /// If the length of a list is not the number of particles.
    #[track_caller]
    pub fn at_rest(&self, positions: &[[T; 3]], velocities: &[[T; 3]]) -> Result<State<T>> {
        assert!(positions.len() == self.particles, "at_rest: {} positions, {} wanted", positions.len(), self.particles);
        let mut history = vec![vec![T::ZERO; self.particles]; self.history];
        for Portion { law, particles, .. } in &self.portions {
            let places: Vec<[f64; 3]> = positions[particles.clone()].iter().map(|x| x.map(T::to_f64)).collect();
            let label = |p: usize| self.labels.get(p).map_or(p, |&label| label as usize);
            for (p, start) in particles.clone().zip(law.starts_of(&places, particles.clone().map(label))) {
                history.iter_mut().zip(start).for_each(|(values, start)| values[p] = T::from_f64(start));
            }
        }
        Ok(State::at_rest(positions, velocities)?.with_history(&history))
    }

    /// Sets the number of substeps before the next one, which determines the position of moving obstacles. Forward
    /// substeps increment it, backward ones do not.
    pub fn rewind(&mut self, substeps: usize) {
        self.substep = substeps;
    }

    /// Sets the particle indices used in error messages.
    pub(crate) fn label(&mut self, labels: Vec<u32>) {
        self.labels = labels;
    }

    /// Advances `now` by one substep into `next`.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Physics`], naming the particle, when a velocity is not finite, a particle would cross more than a
    /// cell or leave the bounds, or the grid would become too large.
    ///
    /// # Panics
    ///
    /// If a state has another number of particles.
    #[track_caller]
    pub fn substep(&mut self, now: &State<T>, next: &mut State<T>) -> Result<()> {
        self.check(&[now, next]);
        if now.is_empty() {
            return Ok(());
        }
        let node_grid = self.scatter(now, &mut next.values)?;
        self.scatter_old(now, &node_grid);
        update(self.world, &self.obstacles, &node_grid, self.dt, &mut self.grid);
        self.advance(&node_grid, now, next)
    }

    /// Grid to particle, from the node velocities.
    pub(super) fn advance(&mut self, node_grid: &NodeGrid<T>, now: &State<T>, next: &mut State<T>) -> Result<()> {
        let bounds = self.world.bounds.unwrap_or([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]);
        let limits = Limits {
            dt: T::from_f64(self.dt),
            speed: T::from_f64(self.world.dx / self.dt),
            bounds: bounds.map(|corner| corner.map(T::from_f64)),
        };
        let (level, grid, particles) = (self.level, &self.grid, self.particles);
        let stride = now.stride();
        now.values
            .par_chunks_exact(stride)
            .zip(next.values.par_chunks_exact_mut(stride))
            .zip(self.motions.par_iter_mut())
            .enumerate()
            .for_each(|(block, ((now, next), motion))| {
                let _flush = Flush::start();
                *motion = advance(level, node_grid, grid, &limits, now, block_len(particles, block), next);
            });
        // A failed state stays invalid.
        next.extent = [[T::INFINITY; 3]; 2];
        for (block, motion) in self.motions.iter().enumerate() {
            if let Some(at) = motion.broken {
                let moment = Moment { substep: self.substep, dt: self.dt, labels: &self.labels };
                let broken = |record: &Record<T>| record.iter().any(|value| !value.is_finite());
                let source = || self.scattered.iter().position(broken);
                return Err(failure(self.world, moment, block * BLOCK + at, now, next, source));
            }
        }
        self.blend(node_grid, now, next);
        next.extent = self.motions.iter().fold(self.motions[0].extent, |extent, motion| {
            let [low, high] = motion.extent;
            widen(widen(extent, low), high)
        });
        self.substep += 1;
        Ok(())
    }

    /// Propagates a cotangent backward through the substep that started at `now`.
    ///
    /// `cotangent` is that of the state after the substep and becomes that of `now`; the cotangents of density and
    /// parameters accumulate in the simulation (see [`Simulation::value_gradients`]). `scratch` is any state of the
    /// same size.
    ///
    /// # Errors
    ///
    /// As [`Simulation::substep`].
    ///
    /// # Panics
    ///
    /// If a state has another number of particles.
    #[track_caller]
    pub fn substep_vjp(&mut self, now: &State<T>, scratch: &mut State<T>, cotangent: &mut State<T>) -> Result<()> {
        self.check(&[now, scratch, cotangent]);
        if now.is_empty() {
            return Ok(());
        }
        let node_grid = self.scatter(now, &mut scratch.values)?;
        self.scatter_old(now, &node_grid);
        self.scatter_cotangents(&node_grid, now, cotangent);
        update_vjp(
            self.world,
            &self.obstacles,
            &node_grid,
            self.dt,
            &mut self.grid,
            &mut self.cotangent_grid,
            &mut self.totals.world,
        );
        self.scatter_old_cotangents(&node_grid, cotangent);
        let (level, particles, stride) = (self.level, self.particles, now.stride());
        let (grid, cotangent_grid) = (&self.grid, &self.cotangent_grid);
        let constants = Constants::of(self.world, self.dt, &self.mass);
        let old = (self.world.flip > 0.0).then_some(&self.old);
        let (portions, places, widths) = (&self.portions, &self.totals.places, self.totals.widths);
        now.values
            .par_chunks_exact(stride)
            .zip(cotangent.values.par_chunks_exact_mut(stride))
            .zip(self.totals.sums.par_chunks_exact_mut(widths[0]).zip(self.totals.each.par_chunks_exact_mut(widths[1])))
            .zip(self.scattered.par_chunks(BLOCK).zip(self.gathered.par_chunks(BLOCK)))
            .enumerate()
            .for_each(|(block, (((now, cotangent), (sums, each)), (scattered, gathered)))| {
                let _flush = Flush::start();
                let mut affine = [T::ZERO; 9 * BLOCK];
                let mut on_mass = [T::ZERO; BLOCK];
                let grids = (cotangent_grid.as_slice(), grid.as_slice());
                collect(
                    level,
                    &node_grid,
                    grids.0,
                    grids.1,
                    scattered,
                    gathered,
                    now,
                    cotangent,
                    &mut affine,
                    &mut on_mass,
                );
                let mut on_old = [T::ZERO; 9 * BLOCK];
                if let Some(old) = old {
                    let masses = constants.mass.run(block * BLOCK, scattered.len());
                    old.collect(level, &node_grid, block, now, masses, cotangent, &mut on_old, &mut on_mass);
                }
                let mut sink = Sink { sums, each };
                let mut first_place = 1;
                for portion in portions {
                    let places = &places[first_place..first_place + portion.parameters.len()];
                    first_place += places.len();
                    let Some(with) = constants.run(portion, block, particles) else { continue };
                    let lanes = with.first..with.first + with.len;
                    with_scratch(portion.law.cotangent_count() * BLOCK, |found| {
                        portion.law.pull_back(now, &with, cotangent, &affine, found);
                        let array = |k: usize| &found[k * BLOCK..][lanes.clone()];
                        let history = 19 + places.len()..portion.law.cotangent_count();
                        let components = (F..F + 9).chain(C..C + 9).zip(0..18);
                        for (component, k) in components.chain((HISTORY..).zip(history)) {
                            cotangent[component * BLOCK..][lanes.clone()].copy_from_slice(array(k));
                        }
                        on_mass[lanes.clone()].iter_mut().zip(array(18)).for_each(|(sum, &g)| *sum += g);
                        for (k, &place) in places.iter().enumerate() {
                            sink.add(place, lanes.clone(), array(19 + k));
                        }
                    });
                }
                if old.is_some() {
                    let on_c = cotangent[C * BLOCK..][..9 * BLOCK].iter_mut();
                    on_c.zip(&on_old).for_each(|(sum, &g)| *sum += g);
                }
                let lanes = 0..block_len(particles, block);
                sink.add(places[0], lanes.clone(), &on_mass[lanes]);
            });
        Ok(())
    }

    /// The accumulated cotangents of density, parameters, gravity and friction.
    pub fn value_gradients(&self) -> ValueGradients<T> {
        let mut found = self.totals.places.iter().map(|&place| self.totals.of(place, self.particles));
        let on_mass = found.next().unwrap_or_default().into_iter().map(Element::to_f64).collect();
        let density = self.on_density(on_mass).into_iter().map(T::from_f64).collect();
        let parameters = found.collect();
        let mut friction = self.totals.world.friction.clone();
        friction.resize(self.world.colliders.len(), 0.0);
        ValueGradients { density, parameters, gravity: self.totals.world.gravity, friction }
    }

    /// The cotangents of the density, from those of the masses.
    pub(super) fn on_density(&self, mut on_mass: Vec<f64>) -> Vec<f64> {
        match (&self.mass, self.portions.first()) {
            (Values::Same(_), Some(portion)) => on_mass.iter_mut().for_each(|g| *g *= portion.volume),
            _ => {
                for Portion { particles, volume, .. } in &self.portions {
                    on_mass[particles.clone()].iter_mut().for_each(|g| *g *= volume);
                }
            }
        }
        if self.one_density { vec![on_mass.iter().sum()] } else { on_mass }
    }

    /// Total momentum \[kg m/s\] and mass \[kg\] on the grid after the last forward substep.
    pub(crate) fn grid_totals(&self) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for node in self.grid.chunks_exact(4) {
            let mass = node[3].to_f64();
            (0..3).for_each(|axis| sum[axis] += mass * node[axis].to_f64());
            sum[3] += mass;
        }
        sum
    }

    #[track_caller]
    pub(super) fn check(&self, states: &[&State<T>]) {
        for state in states {
            let (found, wanted) = ((state.len(), state.history_count()), (self.particles, self.history));
            assert!(
                found == wanted,
                "substep: a state has (particles, history variables) {found:?}, not {wanted:?}; \
                 Simulation::at_rest and State::zeros_like make states that fit"
            );
        }
    }

    /// Material and particle-to-grid: fills `scattered`, the buckets, the grid, and `F` of `next`.
    pub(super) fn scatter(&mut self, now: &State<T>, next: &mut [T]) -> Result<NodeGrid<T>> {
        let time = self.substep as f64 * self.dt;
        self.obstacles.clear();
        self.obstacles.extend(self.world.colliders.iter().map(|collider| Placed::new(collider, time)));
        let node_grid = NodeGrid::covering(now.extent, self.world.dx, self.world.node_limit)?;
        let constants = Constants::of(self.world, self.dt, &self.mass);
        let (level, portions, particles, stride) = (self.level, &self.portions, self.particles, now.stride());
        now.values
            .par_chunks_exact(stride)
            .zip(next.par_chunks_exact_mut(stride))
            .zip(self.scattered.par_chunks_mut(BLOCK).zip(self.buckets.lists(particles, node_grid.slabs())))
            .enumerate()
            .for_each(|(block, ((now, next), (records, list)))| {
                let _flush = Flush::start();
                with_scratch(13 * BLOCK, |scratch| {
                    let (affine, q) = scratch.split_at_mut(9 * BLOCK);
                    for portion in portions {
                        if let Some(with) = constants.run(portion, block, particles) {
                            portion.law.advance(now, &with, next, affine);
                        }
                    }
                    let masses = constants.mass.run(block * BLOCK, records.len());
                    momenta(level, masses, &now[V * BLOCK..], records.len(), q);
                    assemble(level, now, q, affine, records);
                });
                list.sort(|i| node_grid.slab(now[i]));
            });
        scatter_all(self.level, &node_grid, &mut self.grid, &self.scattered, &self.buckets);
        Ok(node_grid)
    }

    /// The adjoint of grid-to-particle: a scatter with `q = gv + dt gx` and `A = 4/dx² gc`.
    fn scatter_cotangents(&mut self, node_grid: &NodeGrid<T>, now: &State<T>, cotangent: &State<T>) {
        self.gathered.resize(self.particles, [T::ZERO; 16]);
        let (level, dt) = (self.level, T::from_f64(self.dt));
        let four = T::from_f64(4.0) * node_grid.inverse_dx * node_grid.inverse_dx;
        cotangent
            .values
            .par_chunks_exact(cotangent.stride())
            .zip(now.values.par_chunks_exact(now.stride()))
            .zip(self.gathered.par_chunks_mut(BLOCK))
            .for_each(|((cotangent, now), records)| {
                let _flush = Flush::start();
                let (mut q, mut a) = ([T::ZERO; 4 * BLOCK], [T::ZERO; 9 * BLOCK]);
                let (on_x, on_v) = (&cotangent[..V * BLOCK], &cotangent[V * BLOCK..C * BLOCK]);
                q.iter_mut().zip(on_v.iter().zip(on_x)).for_each(|(q, (&v, &x))| *q = v + dt * x);
                a.iter_mut().zip(&cotangent[C * BLOCK..]).for_each(|(a, &c)| *a = four * c);
                assemble(level, now, &q, &a, records);
            });
        scatter_all(self.level, node_grid, &mut self.cotangent_grid, &self.gathered, &self.buckets);
    }
}

/// Masses \[kg\] of particles from their densities \[kg/m³\], or the tangents of both.
pub(super) fn masses<T: Number>(density: &Values<T>, portions: &[Portion<'_, T>]) -> Values<T> {
    let volume = |portion: &Portion<'_, T>| T::from_f64(portion.volume);
    match (density, portions.first()) {
        (Values::Same(density), Some(first)) if portions.iter().all(|portion| portion.volume == first.volume) => {
            Values::Same(*density * volume(first))
        }
        _ => {
            let own = |portion: &Portion<'_, T>| {
                let volume = volume(portion);
                portion.particles.clone().map(move |p| density.get(p) * volume)
            };
            Values::Each(portions.iter().flat_map(own).collect())
        }
    }
}

/// Inputs of the materials besides the state.
pub(super) struct Constants<'a, T> {
    dt: f64,
    /// `4/dx²`
    per_volume: f64,
    pub(super) mass: &'a Values<T>,
}

impl<'a, T: Number> Constants<'a, T> {
    pub(super) fn of(world: &World, dt: f64, mass: &'a Values<T>) -> Self {
        Self { dt, per_volume: 4.0 / (world.dx * world.dx), mass }
    }

    /// The particles of a portion that lie in a block, if any.
    pub(super) fn run(&self, portion: &'a Portion<'a, T>, block: usize, particles: usize) -> Option<Run<'a, T>> {
        let start = block * BLOCK;
        let particle = portion.particles.start.max(start);
        let end = portion.particles.end.min(start + block_len(particles, block));
        (particle < end).then(|| Run {
            first: particle - start,
            particle,
            len: end - particle,
            dt: T::from_f64(self.dt),
            stress_scale: T::from_f64(self.dt * portion.volume * self.per_volume),
            mass: self.mass.run(particle, end - particle),
            parameters: &portion.parameters,
        })
    }
}

pub(super) fn block_len(particles: usize, block: usize) -> usize {
    (particles - block * BLOCK).min(BLOCK)
}

/// Lends thread-local scratch memory, not initialised between uses.
pub(super) fn with_scratch<T: Number>(len: usize, run: impl FnOnce(&mut [T])) {
    thread_local! {
        static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
    }
    SCRATCH.with_borrow_mut(|scratch| {
        if scratch.len() < len {
            scratch.resize(len, 0.0);
        }
        run(&mut bytemuck::cast_slice_mut(scratch)[..len]);
    });
}
