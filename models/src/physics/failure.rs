//! Error messages of substeps that break down.

use gradreel::{Element, Error, ErrorKind};

use super::row::Number;
use super::state::{F, State, V};
use super::world::World;

/// The substep of a failure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment<'a> {
    /// Substeps since the start.
    pub substep: usize,
    /// Substep \[s\].
    pub dt: f64,
    /// The caller's index of each particle; empty if the order is the same.
    pub labels: &'a [u32],
}

/// The error of a substep in which `particle` broke a limit. `next` holds the state after it; `source` finds the first
/// particle that scattered a non-finite value.
pub(crate) fn failure<T: Number>(
    world: &World,
    moment: Moment<'_>,
    particle: usize,
    now: &State<T>,
    next: &State<T>,
    source: impl FnOnce() -> Option<usize>,
) -> Error {
    let v = next.read(particle, V).map(Element::to_f64);
    let x = next.read(particle, 0).map(Element::to_f64);
    if v.iter().any(|v| !v.is_finite()) {
        return not_finite(moment, particle, now, next, source());
    }
    let Moment { dt, .. } = moment;
    let speed = v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if speed * dt > world.dx {
        return Error::new(
            ErrorKind::Physics,
            "the simulation became unstable: a particle crosses a cell in one substep",
        )
        .at(place(moment, particle, now))
        .found(format!("a velocity component of {speed:.4e} m/s, {:.4e} m per substep of {dt:.4e} s", speed * dt))
        .wanted(format!("at most {} m (the grid spacing) per substep", world.dx))
        .fix("use more substeps per frame; halving the step is a good first try");
    }
    let [low, high] = world.bounds.unwrap_or([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]);
    Error::new(ErrorKind::Physics, "a particle left the world's bounds")
        .at(place(moment, particle, now))
        .found(format!("position {x:.4?} m"))
        .wanted(format!("between {low:?} and {high:?} m"))
        .fix("widen World::bounds, or add a collider that keeps the particles inside")
}

/// NaN spreads over the grid within one substep; its source is the particle with a non-finite stress.
fn not_finite<T: Number>(
    moment: Moment<'_>,
    particle: usize,
    now: &State<T>,
    next: &State<T>,
    source: Option<usize>,
) -> Error {
    let culprit = source.unwrap_or(particle);
    let f: [[f64; 3]; 3] = std::array::from_fn(|row| next.read(culprit, F + 3 * row).map(Element::to_f64));
    let volume = f[0][0] * (f[1][1] * f[2][2] - f[1][2] * f[2][1]) - f[0][1] * (f[1][0] * f[2][2] - f[1][2] * f[2][0])
        + f[0][2] * (f[1][0] * f[2][1] - f[1][1] * f[2][0]);
    let found = match source {
        Some(_) => format!("a stress that is not finite; the particle's volume ratio det F is {volume:.4e}"),
        None => format!("velocity {:?} m/s", next.read(particle, V).map(Element::to_f64)),
    };
    Error::new(ErrorKind::Physics, "the simulation became unstable: a velocity is not finite")
        .at(place(moment, culprit, now))
        .found(found)
        .wanted("finite velocities, and a positive volume of every particle")
        .fix("use more substeps per frame, or a softer material")
}

fn place<T: Number>(moment: Moment<'_>, particle: usize, now: &State<T>) -> String {
    let x = now.read(particle, 0).map(Element::to_f64);
    let Moment { substep, dt, labels } = moment;
    let label = labels.get(particle).map_or(particle, |&label| label as usize);
    format!("particle {label}, substep {substep}, t = {:.6} s, position {x:.4?} m", substep as f64 * dt)
}
