//! Stable substeps, and the schedule of a rollout.

use std::collections::BTreeSet;

use gradreel::{Error, ErrorKind, Result};

use super::law::Law;
use super::row::Number;
use super::values::Values;
use super::world::World;

/// The default share of a cell that waves and particles may cross in one substep.
///
/// Explicit MLS-MPM with quadratic B-splines is stable up to about 1. The margin allows for compression, which raises
/// the speed of sound, for parameters that change during a fit, and for the accuracy of trajectories.
pub const CFL: f64 = 0.35;

/// The share of a cell above which a rollout refuses to start.
pub const CFL_LIMIT: f64 = 1.0;

/// Largest number of substeps between two frames, and in a whole rollout.
const MOST_SUBSTEPS: [usize; 2] = [1 << 20, 1 << 30];

/// The times of a rollout: equidistant frames, each with equal substeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Number of frames, including frame 0, the start.
    pub frames: usize,
    /// Time between frames \[s\].
    pub frame_dt: f64,
    /// Number of substeps between frames.
    pub substeps: usize,
}

impl Schedule {
    /// A schedule in which nothing crosses more than `cfl` cells per substep ([`CFL`] is the recommended value):
    /// `dt ≤ cfl · dx/(c + v)`, with the speed of sound `c` and the largest particle speed `v` in m/s.
    ///
    /// The number of substeps is one of 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, … (about four per doubling), so
    /// that a small change of a parameter rarely changes it. It is capped at 2²⁰; a rollout that needs more refuses to
    /// start.
    ///
    /// ```
    /// use gradreel_models::physics::{CFL, Schedule, World};
    ///
    /// let schedule = Schedule::stable(&World::new(0.02), 14, 1.0 / 24.0, 36.7, 3.0, CFL);
    /// assert_eq!(schedule.substeps, 256);
    /// assert_eq!(schedule, Schedule::stable(&World::new(0.02), 14, 1.0 / 24.0, 37.5, 3.0, CFL));
    /// ```
    pub fn stable(world: &World, frames: usize, frame_dt: f64, sound: f64, speed: f64, cfl: f64) -> Self {
        let wanted = (frame_dt * (sound + speed) / (cfl * world.dx)).ceil();
        let least = wanted.clamp(1.0, MOST_SUBSTEPS[0] as f64);
        let steps = (0..).map(|k| 2_f64.powf(f64::from(k) / 4.0).ceil()).find(|&n| n >= least);
        Self { frames, frame_dt, substeps: steps.map_or(1, |n| n as usize) }
    }

    /// The same frames with half the substep, for retrying an unstable rollout.
    #[must_use]
    pub fn halved(self) -> Self {
        Self { substeps: 2 * self.substeps, ..self }
    }

    /// The length of a substep \[s\].
    pub fn dt(&self) -> f64 {
        self.frame_dt / self.substeps as f64
    }

    /// Number of substeps of the rollout.
    pub fn steps(&self) -> usize {
        self.frames.saturating_sub(1) * self.substeps
    }

    /// Validates the schedule.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] without frames or substeps, with a frame time that is not positive, or with too many
    /// substeps.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { frames, frame_dt, substeps } = *self;
        if !(frames > 0 && substeps > 0 && frame_dt.is_finite() && frame_dt > 0.0) {
            return Err(Error::new(ErrorKind::Input, "the schedule has no time in it")
                .at("Schedule")
                .found(format!("{frames} frames {frame_dt:?} s apart, {substeps} substeps between them"))
                .wanted("at least one frame, one substep per frame, and a positive frame time"));
        }
        let [per_frame, whole] = MOST_SUBSTEPS;
        let steps = substeps as f64 * (frames - 1) as f64;
        if substeps > per_frame || steps > whole as f64 {
            return Err(Error::new(ErrorKind::Input, "the simulation would take too many substeps")
                .found(format!("{substeps} per frame, {steps:.3e} in all"))
                .wanted(format!("at most {per_frame} per frame and {whole} in all"))
                .fix("use fewer substeps per frame or fewer frames; a coarser grid and a softer material need fewer"));
        }
        Ok(())
    }

    /// Checks that these speeds \[m/s\] allow a feasible number of substeps; see [`Schedule::stable`].
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] with the required number, and the speed that would be feasible.
    pub(crate) fn check_speeds(world: &World, frame_dt: f64, [sound, speed]: [f64; 2], cfl: f64) -> Result<()> {
        let substeps = frame_dt * (sound + speed) / (cfl * world.dx);
        let most = MOST_SUBSTEPS[0] as f64;
        if substeps <= most {
            return Ok(());
        }
        let slow = most * cfl * world.dx / frame_dt;
        let coarse = frame_dt * (sound + speed) / (cfl * most);
        let (what, fix) = match sound >= speed {
            true => ("the material is too stiff for this grid", "a softer or denser material"),
            false => ("something moves too fast for this grid", "lower velocities, a lower gravity or a smaller drop"),
        };
        Err(Error::new(ErrorKind::Input, what)
            .found(format!(
                "{substeps:.3e} substeps per frame of {frame_dt:.4e} s: sound of {sound:.4e} m/s and particles of \
                 {speed:.4e} m/s on a grid of {:?} m",
                world.dx
            ))
            .wanted(format!("at most {most} substeps per frame"))
            .fix(format!(
                "use {fix} (together at most {slow:.3e} m/s), a grid spacing of {coarse:.3e} m, or shorter frames"
            )))
    }

    /// Checks that sound crosses less than a cell per substep, for those of `n` particles that are a `member` and have an
    /// extreme density, parameter, or ratio of the two: a speed of sound may take milliseconds to compute.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Physics`] naming the particle and both speeds, or for parameters without a wave speed.
    pub(crate) fn check_waves<T: Number>(
        &self,
        world: &World,
        law: &Law,
        density: &Values<T>,
        parameters: &[Values<T>],
        n: usize,
        member: impl Fn(usize) -> bool,
    ) -> Result<()> {
        let dt = self.dt();
        for particle in extremes(density, parameters, n, member) {
            let values: Vec<f64> = parameters.iter().map(|values| values.get(particle).to_f64()).collect();
            let density = density.get(particle).to_f64();
            let sound = law.wave_speed(&values, density);
            if sound * dt <= CFL_LIMIT * world.dx {
                continue;
            }
            let place = format!("particle {particle}: {} with {values:?}, density {density} kg/m³", law.name());
            if !sound.is_finite() {
                return Err(Error::new(ErrorKind::Physics, "the material has no speed of sound")
                    .at(place)
                    .found(sound));
            }
            Self::check_speeds(world, self.frame_dt, [sound, 0.0], CFL).map_err(|e| e.within(&place))?;
            let substeps = Self::stable(world, self.frames, self.frame_dt, sound, 0.0, CFL).substeps;
            return Err(Error::new(ErrorKind::Physics, "the substep is too long for this material")
                .at(place)
                .found(format!("a speed of sound of {sound:.4e} m/s, {:.4e} m per substep of {dt:.4e} s", sound * dt))
                .wanted(format!("at most {:?} m, the grid spacing", CFL_LIMIT * world.dx))
                .fix(format!("use at least {substeps} substeps per frame instead of {}", self.substeps)));
        }
        Ok(())
    }
}

/// Ratios that differ by less than this share are alike.
const ALIKE: f64 = 1e-3;

/// The members with the least and the most of the density, of each parameter, and of each parameter per density.
fn extremes<T: Number>(
    density: &Values<T>,
    parameters: &[Values<T>],
    n: usize,
    member: impl Fn(usize) -> bool,
) -> BTreeSet<usize> {
    let members: Vec<usize> = (0..n).filter(|&p| member(p)).collect();
    if std::iter::once(density).chain(parameters).all(|values| matches!(values, Values::Same(_))) {
        return members.into_iter().take(1).collect();
    }
    let of = |values: &Values<T>, p: usize| values.get(p).to_f64();
    let plain = std::iter::once(density).chain(parameters).map(|values| (values, None));
    let ratios = parameters.iter().map(|values| (values, Some(density)));
    let mut found = BTreeSet::new();
    for (above, below) in plain.chain(ratios) {
        let value = |p: &usize| of(above, *p) / below.map_or(1.0, |below| of(below, *p));
        let by = |a: &usize, b: &usize| value(a).total_cmp(&value(b));
        let Some(least) = members.iter().copied().min_by(by) else { continue };
        let most = members.iter().copied().max_by(by).unwrap_or(least);
        // rounding alone makes no extremes
        if below.is_none() || (value(&most) - value(&least)).abs() > ALIKE * value(&most).abs() {
            found.extend([least, most]);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_substeps_climbs_in_few_steps_and_never_falls_short() {
        let world = World::new(0.02);
        let mut counts = Vec::new();
        for speed in 1..400 {
            let schedule = Schedule::stable(&world, 2, 1.0 / 24.0, f64::from(speed), 1.0, CFL);
            assert!(schedule.dt() * (f64::from(speed) + 1.0) <= CFL * world.dx * (1.0 + 1e-12));
            assert_eq!(schedule.halved().dt(), schedule.dt() / 2.0);
            counts.push(schedule.substeps);
        }
        assert!(counts.is_sorted());
        counts.dedup();
        assert!(counts.len() < 32, "{counts:?}");
    }

    #[test]
    fn the_fastest_of_many_particles_is_found() {
        let law = crate::physics::materials::find("neo_hookean").unwrap();
        let schedule = Schedule { frames: 2, frame_dt: 1e-3, substeps: 1 };
        let check = |young: Vec<f64>, density: Vec<f64>| {
            let parameters = [Values::Each(young), Values::Same(0.3)];
            schedule.check_waves(&World::new(0.02), &law, &Values::Each(density), &parameters, 5, |p| p != 4)
        };
        // 1e5 Pa and 1000 kg/m³ are 12 m/s
        check(vec![1e5; 5], vec![1000.0; 5]).unwrap();
        check(vec![1e5, 1e5, 1e5, 1e5, 1e9], vec![1000.0; 5]).unwrap();
        let error = check(vec![1e5, 1e5, 1e6, 1e5, 1e5], vec![1000.0; 5]).unwrap_err();
        assert!(error.to_string().contains("particle 2"), "{error}");
        // neither the stiffest nor the lightest
        let error = check(vec![1e5, 3e5, 1e4, 4e5, 1e5], vec![1000.0, 900.0, 100.0, 3000.0, 1000.0]).unwrap_err();
        assert!(error.to_string().contains("particle 1"), "{error}");
    }
}
