//! One substep forwards and backwards.
//!
//! Forwards: material → records → scatter → node update → gather. Backwards, from the state at the start of the substep:
//! material, scatter again; scatter the cotangents of what was gathered; node adjoint; gather the cotangents of what was
//! scattered; adjoint of the material. Buffers live as long as the simulation; a substep allocates nothing.

use gradreel::scalar::Lanes;
use gradreel::{Error, ErrorKind, Result};
use rayon::prelude::*;

use super::denormals::Flush;
use super::failure::{Moment, failure};
use super::grid::{Buckets, scatter_all, update, update_vjp};
use super::kernel::{Limits, Motion, advance, collect};
use super::lattice::Lattice;
use super::law::{Block, Law, PARAMETER_LIMIT};
use super::row::{Level, Number};
use super::state::{BLOCK, C, COMPONENTS, F, State, V, widen};
use super::transfer::{Record, record};
use super::values::{ValueGradients, Values, check_values};
use super::world::World;

/// Numbers per block of particles.
const STRIDE: usize = COMPONENTS * BLOCK;

/// A material in a world with a fixed substep: steps states forwards and cotangents backwards.
#[derive(Debug)]
pub struct Simulation<'a, T: Number> {
    world: &'a World,
    law: &'a Law,
    dt: f64,
    particles: usize,
    mass: Values<T>,
    parameters: Vec<Values<T>>,
    labels: Vec<u32>,
    level: Level,
    /// Substeps taken forwards, for error messages.
    pub(crate) substep: usize,
    // Buffers.
    scattered: Vec<Record<T>>,
    gathered: Vec<Record<T>>,
    slab_of: Vec<u32>,
    motions: Vec<Motion<T>>,
    buckets: Buckets,
    grid: Vec<T>,
    cotangent_grid: Vec<T>,
    /// Per block: cotangents of mass and parameters, one array each.
    value_cotangents: Vec<T>,
}

impl<'a, T: Number> Simulation<'a, T> {
    /// Prepares a simulation of `particles` particles with substep `dt` \[s\]. `density` in kg/m³; `parameters` in the
    /// order of [`Law::parameters`].
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] for a world, substep or density that makes no sense, [`ErrorKind::NonFinite`] for a parameter
    /// that is not finite.
    ///
    /// # Panics
    ///
    /// If the number of parameters, or of their values, does not fit.
    #[track_caller]
    pub fn new(
        world: &'a World,
        law: &'a Law,
        dt: f64,
        particles: usize,
        density: &Values<T>,
        parameters: Vec<Values<T>>,
    ) -> Result<Self> {
        world.check()?;
        if !(dt.is_finite() && dt > 0.0) {
            return Err(Error::new(ErrorKind::Input, "the substep must be positive").found(format!("{dt} s")));
        }
        let wanted = check_values(law, density, &parameters, particles)?;
        let volume = T::from_f64(world.particle_volume);
        let mass = match density {
            Values::Same(density) => Values::Same(*density * volume),
            Values::Each(densities) => Values::Each(densities.iter().map(|&density| density * volume).collect()),
        };
        let blocks = particles.div_ceil(BLOCK);
        Ok(Self {
            world,
            law,
            dt,
            particles,
            mass,
            parameters,
            labels: Vec::new(),
            level: Level::detect(),
            substep: 0,
            scattered: vec![[T::ZERO; 16]; particles],
            gathered: Vec::new(),
            slab_of: vec![0; particles],
            motions: vec![Motion { extent: [[T::ZERO; 3]; 2], broken: None }; blocks],
            buckets: Buckets::default(),
            grid: Vec::new(),
            cotangent_grid: Vec::new(),
            value_cotangents: vec![T::ZERO; blocks * (1 + wanted) * BLOCK],
        })
    }

    /// Gives particles the numbers by which errors name them.
    pub(crate) fn label(&mut self, labels: Vec<u32>) {
        self.labels = labels;
    }

    /// Advances `now` by one substep into `next`.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Physics`] when a velocity is not finite, a particle would cross a cell or leaves the bounds, or the
    /// grid would become too large; the error names the particle.
    ///
    /// # Panics
    ///
    /// If a state has another number of particles.
    #[track_caller]
    pub fn substep(&mut self, now: &State<T>, next: &mut State<T>) -> Result<()> {
        assert!(now.len() == self.particles && next.len() == self.particles, "substep: wrong number of particles");
        if now.is_empty() {
            return Ok(());
        }
        let lattice = self.scatter(now, &mut next.values)?;
        update(self.world, &lattice, self.dt, &mut self.grid);
        let bounds = self.world.bounds.unwrap_or([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]);
        let limits = Limits {
            dt: T::from_f64(self.dt),
            speed: T::from_f64(self.world.dx / self.dt),
            bounds: bounds.map(|corner| corner.map(T::from_f64)),
        };
        let (level, grid, particles) = (self.level, &self.grid, self.particles);
        now.values
            .par_chunks_exact(STRIDE)
            .zip(next.values.par_chunks_exact_mut(STRIDE))
            .zip(self.motions.par_iter_mut())
            .enumerate()
            .for_each(|(block, ((now, next), motion))| {
                let _flush = Flush::start();
                *motion = advance(level, &lattice, grid, &limits, now, block_len(particles, block), next);
            });
        // A state that broke down stays unusable.
        next.extent = [[T::INFINITY; 3]; 2];
        for (block, motion) in self.motions.iter().enumerate() {
            if let Some(at) = motion.broken {
                let moment = Moment { substep: self.substep, dt: self.dt, labels: &self.labels };
                return Err(failure(self.world, moment, block * BLOCK + at, now, next, &self.scattered));
            }
        }
        next.extent = self.motions.iter().fold(self.motions[0].extent, |extent, motion| {
            let [low, high] = motion.extent;
            widen(widen(extent, low), high)
        });
        self.substep += 1;
        Ok(())
    }

    /// Carries a cotangent backwards through the substep that started at `now`.
    ///
    /// `cotangent` is that of the state after the substep and becomes that of `now`; the cotangents of density and
    /// parameters add up inside (see [`Simulation::value_gradients`]). `scratch` is any state of the same size.
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
        let lens = [now.len(), scratch.len(), cotangent.len()];
        assert!(lens == [self.particles; 3], "substep_vjp: states of {lens:?} particles, not {}", self.particles);
        if now.is_empty() {
            return Ok(());
        }
        let lattice = self.scatter(now, &mut scratch.values)?;
        self.scatter_cotangents(&lattice, &cotangent.values);
        update_vjp(self.world, &lattice, self.dt, &mut self.grid, &mut self.cotangent_grid);
        let (level, law, particles) = (self.level, self.law, self.particles);
        let (grid, cotangent_grid) = (&self.grid, &self.cotangent_grid);
        let constants = Constants::of(self.world, self.dt, &self.mass, &self.parameters);
        let arrays = 1 + self.parameters.len();
        now.values
            .par_chunks_exact(STRIDE)
            .zip(cotangent.values.par_chunks_exact_mut(STRIDE))
            .zip(self.value_cotangents.par_chunks_exact_mut(arrays * BLOCK))
            .zip(self.scattered.par_chunks(BLOCK).zip(self.gathered.par_chunks(BLOCK)))
            .enumerate()
            .for_each(|(block, (((now, cotangent), values), (scattered, gathered)))| {
                let _flush = Flush::start();
                let with = constants.block(block, block_len(particles, block));
                let mut affine = [T::ZERO; 9 * BLOCK];
                let mut found = [T::ZERO; (19 + PARAMETER_LIMIT) * BLOCK];
                let (on_mass, _) = values.split_at_mut(BLOCK);
                let grids = (cotangent_grid.as_slice(), grid.as_slice());
                collect(level, &lattice, grids.0, grids.1, scattered, gathered, now, cotangent, &mut affine, on_mass);
                law.pull_back(now, &with, &cotangent[F * BLOCK..], &affine, &mut found);
                let (on_f, rest) = found.split_at(9 * BLOCK);
                let (on_c, on_values) = rest.split_at(9 * BLOCK);
                cotangent[F * BLOCK..].copy_from_slice(on_f);
                cotangent[C * BLOCK..F * BLOCK].copy_from_slice(on_c);
                for (sum, &term) in values.iter_mut().zip(on_values) {
                    *sum += term;
                }
            });
        Ok(())
    }

    /// The cotangents of density and parameters that the backward substeps have added up.
    pub fn value_gradients(&self) -> ValueGradients<T> {
        let arrays = 1 + self.parameters.len();
        let volume = T::from_f64(self.world.particle_volume);
        let array = |k: usize| -> Vec<T> {
            let at = |p: usize| self.value_cotangents[(p / BLOCK * arrays + k) * BLOCK + p % BLOCK];
            (0..self.particles).map(at).collect()
        };
        let density = array(0).into_iter().map(|g| g * volume).collect();
        ValueGradients { density, parameters: (1..arrays).map(array).collect() }
    }

    /// Material and particle-to-grid: fills `scattered`, the buckets and the grid, and `F` of `next`.
    fn scatter(&mut self, now: &State<T>, next: &mut [T]) -> Result<Lattice<T>> {
        let lattice = Lattice::covering(now.extent, self.world.dx, self.world.node_limit)?;
        let constants = Constants::of(self.world, self.dt, &self.mass, &self.parameters);
        let law = self.law;
        now.values
            .par_chunks_exact(STRIDE)
            .zip(next.par_chunks_exact_mut(STRIDE))
            .zip(self.scattered.par_chunks_mut(BLOCK).zip(self.slab_of.par_chunks_mut(BLOCK)))
            .enumerate()
            .for_each(|(block, ((now, next), (records, slabs)))| {
                let _flush = Flush::start();
                let with = constants.block(block, records.len());
                let mut affine = [T::ZERO; 9 * BLOCK];
                law.advance(now, &with, next, &mut affine);
                for (i, (record_, slab)) in records.iter_mut().zip(slabs).enumerate() {
                    let at = |component: usize| now[component * BLOCK + i];
                    let x = [at(0), at(1), at(2)];
                    let mass = match with.mass {
                        Lanes::Same(mass) => mass,
                        Lanes::Each(masses) => masses[i],
                    };
                    let q = [mass * at(V), mass * at(V + 1), mass * at(V + 2)];
                    *record_ = record(x, q, mass, std::array::from_fn(|k| affine[k * BLOCK + i]));
                    *slab = lattice.slab(x[0]) as u32;
                }
            });
        self.buckets.sort(&self.slab_of, lattice.slabs());
        scatter_all(self.level, &lattice, &mut self.grid, &self.scattered, &self.buckets);
        Ok(lattice)
    }

    /// The adjoint of grid-to-particle: a scatter of `gv + dt gx` and `4/dx² gc`.
    fn scatter_cotangents(&mut self, lattice: &Lattice<T>, cotangent: &[T]) {
        self.gathered.resize(self.particles, [T::ZERO; 16]);
        let dt = T::from_f64(self.dt);
        let four = T::from_f64(4.0) * lattice.inverse_dx * lattice.inverse_dx;
        cotangent
            .par_chunks_exact(STRIDE)
            .zip(self.gathered.par_chunks_mut(BLOCK))
            .zip(self.scattered.par_chunks(BLOCK))
            .for_each(|((cotangent, records), scattered)| {
                let _flush = Flush::start();
                for (i, (record_, scattered)) in records.iter_mut().zip(scattered).enumerate() {
                    let at = |component: usize| cotangent[component * BLOCK + i];
                    let q = std::array::from_fn(|axis| at(V + axis) + dt * at(axis));
                    let a = std::array::from_fn(|k| four * at(C + k));
                    *record_ = record(super::transfer::position(scattered), q, T::ZERO, a);
                }
            });
        scatter_all(self.level, lattice, &mut self.cotangent_grid, &self.gathered, &self.buckets);
    }
}

/// What the material needs besides the state.
struct Constants<'a, T> {
    dt: T,
    stress_scale: T,
    mass: &'a Values<T>,
    parameters: &'a [Values<T>],
}

impl<'a, T: Number> Constants<'a, T> {
    fn of(world: &World, dt: f64, mass: &'a Values<T>, parameters: &'a [Values<T>]) -> Self {
        let stress_scale = T::from_f64(dt * world.particle_volume * 4.0 / (world.dx * world.dx));
        Self { dt: T::from_f64(dt), stress_scale, mass, parameters }
    }

    fn block(&self, block: usize, len: usize) -> Block<'a, T> {
        let mut parameters = [Lanes::Same(T::ZERO); PARAMETER_LIMIT];
        for (slot, values) in parameters.iter_mut().zip(self.parameters) {
            *slot = values.block(block, len);
        }
        let mass = self.mass.block(block, len);
        Block { len, dt: self.dt, stress_scale: self.stress_scale, mass, parameters }
    }
}

fn block_len(particles: usize, block: usize) -> usize {
    (particles - block * BLOCK).min(BLOCK)
}
