//! Running a scene frame by frame; the substeps are halved where a frame becomes unstable.

use gradreel::{ErrorKind, Result};

use super::setup::Setup;
use super::totals::Totals;
use crate::physics::{Guard, Number, Portion, Simulation, State, Values, World, neighbours};

/// Maximum number of halvings of the substeps per scene.
const MOST_HALVINGS: usize = 4;

/// The results at one frame.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Frame number; 0 is the start.
    pub index: usize,
    /// Positions \[m\] in the order of [`Setup`].
    pub positions: Vec<[f32; 3]>,
    /// Sums over all particles.
    pub totals: Totals,
    /// Substeps per frame from here on.
    pub substeps: usize,
}

/// Restart data: the last complete frame and its state.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// The frame.
    pub frame: usize,
    /// Substeps per frame.
    pub substeps: usize,
    /// The numbers of the state; particles in grid order.
    pub state: Vec<f64>,
}

/// A scene that can be stepped frame by frame.
#[derive(Debug)]
pub struct Runner<'a, T> {
    setup: &'a Setup,
    /// The surroundings, without those obstacles that only `guard` handles.
    world: World,
    guard: Guard,
    /// Material and volume of each kind of particle. `kind_of` maps particles, in the order of the setup, to kinds.
    kinds: Vec<(u32, f64)>,
    kind_of: Vec<u32>,
    /// Index in the setup of each particle in grid order.
    order: Vec<u32>,
    /// Densities in grid order \[kg/m³\].
    densities: Values<T>,
    now: State<T>,
    frame: usize,
    substeps: usize,
    halvings: usize,
}

impl<'a, T: Number> Runner<'a, T> {
    /// The scene at its start.
    ///
    /// # Errors
    /// As [`Simulation::of_portions`].
    pub fn new(setup: &'a Setup) -> Result<Self> {
        let mut kinds: Vec<(u32, f64)> = Vec::new();
        let kind = |p: usize| {
            let kind = (setup.material_of[p], setup.volumes[setup.object_of[p] as usize]);
            let known = kinds.iter().position(|known| *known == kind);
            known.unwrap_or_else(|| {
                kinds.push(kind);
                kinds.len() - 1
            }) as u32
        };
        let kind_of: Vec<u32> = (0..setup.len()).map(kind).collect();
        let order = neighbours(setup.world.dx, &setup.positions, |p| kind_of[p]);
        let (guard, on_grid) = Guard::of(&setup.world);
        let density = |p: u32| T::from_f64(setup.materials[setup.material_of[p as usize] as usize].density);
        let densities = match &setup.materials[..] {
            [one] => Values::Same(T::from_f64(one.density)),
            _ => Values::Each(order.iter().map(|&p| density(p)).collect()),
        };
        let triple = |x: [f64; 3]| x.map(T::from_f64);
        let list = |all: &[[f64; 3]]| -> Vec<[T; 3]> { order.iter().map(|&p| triple(all[p as usize])).collect() };
        let (x, v) = (list(&setup.positions), list(&setup.velocities));
        let mut runner = Self {
            setup,
            world: World { colliders: on_grid, ..setup.world.clone() },
            guard,
            kinds,
            kind_of,
            densities,
            now: State::zeros(0),
            frame: 0,
            substeps: setup.schedule.substeps,
            halvings: 0,
            order,
        };
        runner.now = runner.simulation()?.at_rest(&x, &v)?;
        for (p, &label) in runner.order.iter().enumerate() {
            // velocity gradient of a rigid rotation
            let [x, y, z] = setup.spins[label as usize].map(T::from_f64);
            runner.now.set_affine_velocity(p, [[T::ZERO, -z, y], [z, T::ZERO, -x], [-y, x, T::ZERO]]);
        }
        Ok(runner)
    }

    /// Resumes an earlier run of the same setup.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a snapshot of another scene.
    pub fn resume(setup: &'a Setup, snapshot: &Snapshot) -> Result<Self> {
        let mut runner = Self::new(setup)?;
        runner.now.restore(&snapshot.state)?;
        (runner.frame, runner.substeps) = (snapshot.frame, snapshot.substeps.max(1));
        Ok(runner)
    }

    /// Restart data of the current frame.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { frame: self.frame, substeps: self.substeps, state: self.now.numbers() }
    }

    /// The current frame.
    pub fn frame(&self) -> Frame {
        let mut positions = vec![[0.0; 3]; self.order.len()];
        for (x, &label) in self.now.positions().iter().zip(&self.order) {
            positions[label as usize] = x.map(|x| x.to_f64() as f32);
        }
        let world = &self.setup.world;
        let volume = |p: usize| self.kinds[self.kind_of[self.order[p] as usize] as usize].1;
        let mass = |p: usize| self.densities.get(p).to_f64() * volume(p);
        let time = self.frame as f64 * self.setup.schedule.frame_dt;
        let totals = Totals::of(&self.now, mass, world.gravity, world.dx, time);
        Frame { index: self.frame, positions, totals, substeps: self.substeps }
    }

    /// Advances to the next frame. `go_on` is called before every substep; if it returns false, the method returns
    /// false and changes nothing.
    ///
    /// With automatic substeps, a frame that becomes unstable is simulated again with twice as many, which are kept
    /// for the rest of the run; at most four times per run.
    ///
    /// # Errors
    /// [`ErrorKind::Physics`] naming the particle, if the simulation becomes unstable.
    pub fn advance(&mut self, mut go_on: impl FnMut() -> bool) -> Result<bool> {
        loop {
            match self.try_frame(&mut go_on) {
                Ok(None) => return Ok(false),
                Ok(Some(state)) => {
                    self.now = state;
                    self.frame += 1;
                    return Ok(true);
                }
                Err(error) => {
                    let stepping = error.kind() == ErrorKind::Physics && error.to_string().contains("unstable");
                    if !(self.setup.automatic && stepping && self.halvings < MOST_HALVINGS) {
                        return Err(error);
                    }
                    self.halvings += 1;
                    self.substeps *= 2;
                }
            }
        }
    }

    fn try_frame(&self, go_on: &mut impl FnMut() -> bool) -> Result<Option<State<T>>> {
        let mut simulation = self.simulation()?;
        let first = self.frame * self.substeps;
        simulation.rewind(first);
        let dt = self.setup.schedule.frame_dt / self.substeps as f64;
        let mut now = self.now.clone();
        let mut next = now.zeros_like();
        for step in first..first + self.substeps {
            if !go_on() {
                return Ok(None);
            }
            simulation.substep(&now, &mut next)?;
            self.guard.hold(&now, &mut next, [step, step + 1].map(|step| step as f64 * dt));
            std::mem::swap(&mut now, &mut next);
        }
        Ok(Some(now))
    }

    fn simulation(&self) -> Result<Simulation<'_, T>> {
        let setup = self.setup;
        let mut portions: Vec<Portion<'_, T>> = Vec::with_capacity(self.kinds.len());
        for (index, &(material, volume)) in self.kinds.iter().enumerate() {
            let stuff = &setup.materials[material as usize];
            let start = portions.last().map_or(0, |portion| portion.particles.end);
            let own = self.order[start..].iter().take_while(|&&p| self.kind_of[p as usize] as usize == index);
            let parameters = stuff.parameters.iter().map(|&value| Values::Same(T::from_f64(value))).collect();
            portions.push(Portion { law: &stuff.law, particles: start..start + own.count(), volume, parameters });
        }
        let dt = setup.schedule.frame_dt / self.substeps as f64;
        let mut simulation = Simulation::of_portions(&self.world, dt, &self.densities, portions)?;
        simulation.label(self.order.clone());
        Ok(simulation)
    }
}
