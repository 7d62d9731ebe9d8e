//! The way of an object through several flights and hits, in units of its depth in the first sight.
//!
//! Axes of the world: to the right, up along gravity, and towards the camera. The ground is a plane that may slope to
//! the right: `y = h + s x` for the object's centre. At a hit the velocity along its normal turns round and shrinks by
//! the restitution `e`; that along it becomes another one:
//!
//! ```text
//! x(t) = x₀ + v t − γ t² ŷ/2      v⁺ = −e (v⁻·n) n + w₁ t₁ + w₂ t₂
//! ```

use super::dual::Dual;

/// Numbers of the unknowns that all flights share: the logarithm of gravity \[1/s²\], pitch and roll of the camera \[rad\],
/// slope and height of the ground, and the logarithm of the object's diameter.
pub(super) const GRAVITY: usize = 0;
pub(super) const PITCH: usize = 1;
pub(super) const ROLL: usize = 2;
pub(super) const SLOPE: usize = 3;
pub(super) const GROUND: usize = 4;
pub(super) const SIZE: usize = 5;
pub(super) const SHARED: usize = 6;

/// How a flight begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Begin {
    /// The first one, whose depth is 1: two coordinates and the velocity.
    First,
    /// Somewhere: place and velocity.
    Anywhere,
    /// At the hit that ends the flight before: the restitution, and the velocity along the ground.
    Hit,
}

impl Begin {
    /// Number of its unknowns.
    pub fn unknowns(self) -> usize {
        match self {
            Self::First => 5,
            Self::Anywhere => 6,
            Self::Hit => 3,
        }
    }
}

/// A vector.
pub(super) type Vector = [Dual; 3];

fn dot(a: &Vector, b: &Vector) -> Dual {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A flight.
#[derive(Debug, Clone)]
pub(super) struct Arc {
    /// Time at which place and velocity are these \[s\].
    pub time: Dual,
    pub place: Vector,
    pub velocity: Vector,
}

/// A hit between two flights.
#[derive(Debug, Clone)]
pub(super) struct Struck {
    pub time: Dual,
    /// Speed towards the ground before it.
    pub speed: Dual,
    pub restitution: Dual,
    /// Velocities along the ground before and after, to the right and towards the camera.
    pub along: [Dual; 2],
    pub after: [Dual; 2],
}

/// Flights and hits.
#[derive(Debug, Clone)]
pub(super) struct Way {
    /// Axes of the world in those of the camera (x right, y up, looking along −z): to the right, up, towards it.
    axes: [Vector; 3],
    pub gravity: Dual,
    slope: Dual,
    ground: Dual,
    pub size: Dual,
    pub arcs: Vec<Arc>,
    pub hits: Vec<Struck>,
}

impl Arc {
    fn at(&self, time: Dual, gravity: Dual) -> Vector {
        let t = time - self.time;
        let [x, y, z] = [0, 1, 2].map(|c| self.place[c] + self.velocity[c] * t);
        [x, y - gravity * t * t * 0.5, z]
    }

    fn velocity_at(&self, time: Dual, gravity: Dual) -> Vector {
        let [x, y, z] = self.velocity;
        [x, y - gravity * (time - self.time), z]
    }
}

impl Way {
    /// The way for some unknowns: the shared ones, and those of each flight; `times` are those of the flights' first
    /// sights.
    pub fn of(begins: &[Begin], times: &[f64], values: &[f64]) -> Self {
        let unknown = |k: usize| Dual::unknown(values[k], k);
        let ((s, c), (sr, cr)) =
            ((unknown(PITCH).sin(), unknown(PITCH).cos()), (unknown(ROLL).sin(), unknown(ROLL).cos()));
        let zero = Dual::of(0.0);
        let axes = [[cr, sr, zero], [-(sr * c), cr * c, s], [sr * s, -(cr * s), c]];
        let mut way = Self {
            axes,
            gravity: unknown(GRAVITY).exp(),
            slope: unknown(SLOPE),
            ground: unknown(GROUND),
            size: unknown(SIZE).exp(),
            arcs: vec![],
            hits: vec![],
        };
        let mut next = SHARED;
        for (begin, time) in begins.iter().zip(times) {
            let own: Vec<Dual> = (next..next + begin.unknowns()).map(unknown).collect();
            next += begin.unknowns();
            let arc = match begin {
                Begin::First => {
                    // where the depth −(s y + c z) is 1
                    let z = (Dual::of(-1.0) - own[1] * s) / c;
                    Arc { time: Dual::of(*time), place: [own[0], own[1], z], velocity: [own[2], own[3], own[4]] }
                }
                Begin::Anywhere => {
                    Arc { time: Dual::of(*time), place: [own[0], own[1], own[2]], velocity: [own[3], own[4], own[5]] }
                }
                Begin::Hit => way.struck([own[0], own[1], own[2]]),
            };
            way.arcs.push(arc);
        }
        way
    }

    /// The flight after the hit that ends the last one.
    fn struck(&mut self, [restitution, right, near]: Vector) -> Arc {
        let before = self.arcs.last().expect("a flight before the hit").clone();
        let time = self.lands(&before);
        let (place, velocity) = (before.at(time, self.gravity), before.velocity_at(time, self.gravity));
        let length = (self.slope * self.slope + Dual::of(1.0)).sqrt();
        let zero = Dual::of(0.0);
        let normal = [-(self.slope / length), Dual::of(1.0) / length, zero];
        let level = [Dual::of(1.0) / length, self.slope / length, zero];
        let speed = -dot(&velocity, &normal);
        self.hits.push(Struck {
            time,
            speed,
            restitution,
            along: [dot(&velocity, &level), velocity[2]],
            after: [right, near],
        });
        let up = restitution * speed;
        let after = [0, 1, 2].map(|c| normal[c] * up + level[c] * right);
        Arc { time, place, velocity: [after[0], after[1], near] }
    }

    /// When a flight reaches the ground.
    fn lands(&self, arc: &Arc) -> Dual {
        let above = arc.place[1] - self.ground - self.slope * arc.place[0];
        let rate = arc.velocity[1] - self.slope * arc.velocity[0];
        arc.time + (rate + (rate * rate + self.gravity * above * 2.0).sqrt()) / self.gravity
    }

    /// When the last flight reaches the ground, and its speed downwards then.
    pub fn arrives(&self) -> Option<(f64, f64)> {
        let arc = self.arcs.last()?;
        let time = self.lands(arc);
        Some((time.value, -arc.velocity_at(time, self.gravity)[1].value))
    }

    /// Place of the centre in the camera's axes in a flight.
    pub fn seen_from(&self, flight: usize, time: f64) -> Vector {
        let place = self.arcs[flight].at(Dual::of(time), self.gravity);
        [0, 1, 2].map(|c| self.axes[0][c] * place[0] + self.axes[1][c] * place[1] + self.axes[2][c] * place[2])
    }

    /// The flight at a time: the first one before all.
    pub fn flight_at(&self, time: f64) -> usize {
        self.arcs.iter().rposition(|arc| arc.time.value <= time).unwrap_or(0)
    }

    /// Place in the camera's axes at a time; on the ground once the last flight has ended.
    pub fn at(&self, time: f64) -> [f64; 3] {
        let flight = self.flight_at(time);
        let ends = match flight + 1 < self.arcs.len() {
            true => f64::INFINITY,
            false => self.lands(&self.arcs[flight]).value,
        };
        self.seen_from(flight, time.min(ends)).map(|x| x.value)
    }

    /// Velocity along the axes of the world at a time \[1/s\].
    pub fn velocity_at(&self, time: f64) -> Vector {
        self.arcs[self.flight_at(time)].velocity_at(Dual::of(time), self.gravity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_bounces_as_it_should() {
        // straight ahead, gravity 10, from 0.2 above the ground, restitution 0.5
        let values = [10f64.ln(), 0.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.3, 0.0, 0.1, 0.5, 0.2, 0.05];
        let way = Way::of(&[Begin::First, Begin::Hit], &[1.0, 1.5], &values);
        assert!((way.hits[0].time.value - 1.2).abs() < 1e-9 && (way.hits[0].speed.value - 2.0).abs() < 1e-9);
        let [x, y, z] = way.at(1.3);
        // up with 1 for 0.1 s
        assert!((x - 0.08).abs() < 1e-9 && (y - (-0.2 + 0.1 - 0.05)).abs() < 1e-9, "{x}, {y}");
        assert!((z - (-1.0 + 0.02 + 0.005)).abs() < 1e-9, "{z}");
        // it lies where the last flight ends
        assert!((way.at(9.0)[1] + 0.2).abs() < 1e-9);
        assert_eq!([0.5, 1.1, 1.21].map(|t| way.flight_at(t)), [0, 0, 1]);
    }

    #[test]
    fn a_slope_turns_the_way_aside() {
        let slope = 0.3f64;
        let values = [10f64.ln(), 0.1, 0.05, slope, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let way = Way::of(&[Begin::First, Begin::Hit], &[0.0, 0.5], &values);
        // without friction, the mirror image of what falls: w₁ is the velocity along the ground before
        let mut values = values;
        values[12] = way.hits[0].along[0].value;
        let way = Way::of(&[Begin::First, Begin::Hit], &[0.0, 0.5], &values);
        let velocity = way.arcs[1].velocity.map(|v| v.value);
        let (fell, twice) = (2.0, 2.0 * slope.atan());
        assert!((velocity[0] + fell * twice.sin()).abs() < 1e-9, "{velocity:?}");
        assert!((velocity[1] - fell * twice.cos()).abs() < 1e-9, "{velocity:?}");
    }
}
