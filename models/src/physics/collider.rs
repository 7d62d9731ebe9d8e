//! Obstacles: analytic regions, at rest or moving as rigid bodies, acting on the velocities of grid nodes.

use super::contact::Placed;
use crate::vector::{EYE, dot, minus, product, rotation, times};
use gradreel::{Error, ErrorKind, Result};

/// How an obstacle acts on a node; `v` is the velocity of the node, `w` that of the obstacle at the node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Contact {
    /// `v = w`
    Sticky,
    /// `v −= n (n·(v−w))`: frictionless, without separation.
    Slip,
    /// `v −= n min(n·(v−w), 0)`: frictionless, separates freely.
    Separate,
    /// Coulomb friction with this coefficient µ; separates freely. With `r = v − w`, where `n·r < 0`:
    /// `v = w + t max(0, 1 + µ (n·r)/|t|)`, `t = r − n (n·r)`. Sticks while the tangential speed is at most µ times the
    /// normal speed.
    Friction(f64),
}

/// The region of an obstacle \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region {
    /// Everything below a plane: `(x − point) · normal ≤ 1e-6`.
    Plane {
        /// A point of the plane.
        point: [f64; 3],
        /// Its unit normal, towards the free side.
        normal: [f64; 3],
    },
    /// A cylinder with flat ends. As a solid it pushes radially, also at its ends.
    Cylinder {
        /// Centre of one end.
        start: [f64; 3],
        /// Centre of the other end.
        end: [f64; 3],
        /// Radius.
        radius: f64,
    },
    /// A ball.
    Sphere {
        /// Centre.
        centre: [f64; 3],
        /// Radius.
        radius: f64,
    },
    /// An axis-aligned box; a solid one pushes towards its nearest face. [`Collider::turned`] rotates it.
    Cuboid {
        /// Centre.
        centre: [f64; 3],
        /// Half of its edge lengths.
        half: [f64; 3],
    },
}

/// The motion of a rigid body: at time `t` the point `x` has moved to `pivot + v t + R(ω t) (x − pivot)`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigidMotion {
    /// Velocity `v` of the pivot \[m/s\].
    pub velocity: [f64; 3],
    /// Angular velocity `ω` about an axis through the pivot \[rad/s\].
    pub spin: [f64; 3],
    /// A point of that axis at time 0 \[m\].
    pub pivot: [f64; 3],
}

/// An obstacle: a region, a contact condition, and a rigid motion.
///
/// A [`Simulation`](super::Simulation) applies obstacles to grid nodes. A solid should therefore be at least two grid
/// cells thick: a thinner one may lie between the nodes, and its two sides share stencils. In scenes run by
/// [`Runner`](crate::scenes::Runner), the surfaces of solids also act on particles, and nothing passes through.
///
/// ```
/// use gradreel_models::physics::{Collider, Contact};
///
/// let ramp = Collider::plane([0.0; 3], [0.0, 2.0, 0.0], Contact::Slip); // the normal need not be a unit vector
/// assert_eq!(ramp.collide([0.3, -0.1, 0.0], [1.0, -2.0, 0.5]), [1.0, 0.0, 0.5]);
/// assert_eq!(ramp.collide([0.3, 0.1, 0.0], [1.0, -2.0, 0.5]), [1.0, -2.0, 0.5]);
///
/// // A tank that travels to the right; a piston in it would be another collider.
/// let tank = Collider::cuboid([0.0, 0.5, 0.0], [0.5; 3], Contact::Sticky).container().moving([0.2, 0.0, 0.0]);
/// assert_eq!(tank.collide([0.6, 0.5, 0.0], [0.0; 3]), [0.2, 0.0, 0.0]);
/// assert_eq!(tank.collide([0.0, 0.5, 0.0], [0.0; 3]), [0.0; 3]);
///
/// // A rough floor takes at most µ times the velocity of impact.
/// let floor = Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Friction(0.25));
/// assert_eq!(floor.collide([0.0; 3], [1.0, -2.0, 0.0]), [0.5, 0.0, 0.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collider {
    /// The region at time 0.
    pub region: Region,
    /// The contact condition.
    pub contact: Contact,
    /// Whether the particles are inside the region instead of outside.
    pub container: bool,
    /// Rotation at time 0 about the pivot of `motion`, row-major.
    pub turn: [[f64; 3]; 3],
    /// The motion.
    pub motion: RigidMotion,
}

impl Collider {
    /// A solid region at rest.
    pub fn new(region: Region, contact: Contact) -> Self {
        Self { region, contact, container: false, turn: EYE, motion: RigidMotion::default() }
    }

    /// The half-space below a plane; `normal` is scaled to unit length.
    ///
    /// # Panics
    ///
    /// If the normal has no direction.
    #[track_caller]
    pub fn plane(point: [f64; 3], normal: [f64; 3], contact: Contact) -> Self {
        let length = dot(normal, normal).sqrt();
        assert!(length.is_finite() && length > 0.0, "plane: the normal {normal:?} has no direction");
        Self::new(Region::Plane { point, normal: normal.map(|n| n / length) }, contact)
    }

    /// Sticky ground at this height \[m\].
    pub fn ground(height: f64) -> Self {
        Self::plane([0.0, height, 0.0], [0.0, 1.0, 0.0], Contact::Sticky)
    }

    /// A cylinder with flat ends from `start` to `end`.
    ///
    /// # Panics
    ///
    /// If the two ends coincide.
    #[track_caller]
    pub fn cylinder(start: [f64; 3], end: [f64; 3], radius: f64, contact: Contact) -> Self {
        let axis = minus(end, start);
        assert!(dot(axis, axis) > 0.0, "cylinder: both ends lie at {start:?}");
        Self::new(Region::Cylinder { start, end, radius }, contact)
    }

    /// A ball.
    pub fn sphere(centre: [f64; 3], radius: f64, contact: Contact) -> Self {
        Self::new(Region::Sphere { centre, radius }, contact)
    }

    /// An axis-aligned box, from its centre and half edge lengths.
    pub fn cuboid(centre: [f64; 3], half: [f64; 3], contact: Contact) -> Self {
        Self::new(Region::Cuboid { centre, half }, contact)
    }

    /// Turns the region into a container, with the particles inside.
    #[must_use]
    pub fn container(self) -> Self {
        Self { container: true, ..self }
    }

    /// Adds a translation at this velocity \[m/s\].
    #[must_use]
    pub fn moving(self, velocity: [f64; 3]) -> Self {
        Self { motion: RigidMotion { velocity, ..self.motion }, ..self }
    }

    /// Adds a rotation at this angular velocity \[rad/s\] about an axis through `pivot` \[m\].
    #[must_use]
    pub fn spinning(self, spin: [f64; 3], pivot: [f64; 3]) -> Self {
        Self { motion: RigidMotion { spin, pivot, ..self.motion }, ..self }
    }

    /// Rotates the obstacle at time 0 by `|turn|` radians about the axis `turn` through `pivot`, which becomes the
    /// pivot of its motion.
    #[must_use]
    pub fn turned(self, turn: [f64; 3], pivot: [f64; 3]) -> Self {
        Self { turn: product(rotation(turn), self.turn), motion: RigidMotion { pivot, ..self.motion }, ..self }
    }

    /// The smallest extent of a solid \[m\]; infinite for planes and containers.
    pub(crate) fn thickness(&self) -> f64 {
        match self.region {
            _ if self.container => f64::INFINITY,
            Region::Plane { .. } => f64::INFINITY,
            Region::Sphere { radius, .. } => 2.0 * radius,
            Region::Cuboid { half, .. } => 2.0 * half.into_iter().fold(f64::INFINITY, f64::min),
            Region::Cylinder { start, end, radius } => {
                let axis = minus(end, start);
                dot(axis, axis).sqrt().min(2.0 * radius)
            }
        }
    }

    /// The position of a point of the region at time `t` \[s\].
    pub(crate) fn place(&self, x: [f64; 3], t: f64) -> [f64; 3] {
        let RigidMotion { velocity, spin, pivot } = self.motion;
        let turned = times(&product(rotation(spin.map(|w| w * t)), self.turn), minus(x, pivot));
        std::array::from_fn(|axis| pivot[axis] + velocity[axis] * t + turned[axis])
    }

    /// Whether the obstacle neither moves nor is rotated.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.turn == EYE && self.motion.velocity == [0.0; 3] && self.motion.spin == [0.0; 3]
    }

    /// The unit normal, towards the free side, where the obstacle acts at time 0; `None` elsewhere. In a corner of a
    /// container it is the first one. Near the axis of a cylinder and the centre of a ball it shrinks to zero:
    /// `n = r/√(r·r + 1e-8)`.
    #[inline]
    pub fn normal(&self, x: [f64; 3]) -> Option<[f64; 3]> {
        Placed::new(self, 0.0).normals(x).into_iter().next()
    }

    /// The velocity \[m/s\] of a node at `x` \[m\] after contact at time 0.
    #[inline]
    pub fn collide(&self, x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        Placed::new(self, 0.0).collide(x, v)
    }

    /// The vjp of [`Collider::collide`]: the cotangent of the velocity before contact, from that of the velocity after
    /// it.
    #[inline]
    pub fn collide_vjp(&self, x: [f64; 3], v: [f64; 3], g: [f64; 3]) -> [f64; 3] {
        super::contact::collide_vjp(&[Placed::new(self, 0.0)], x, v, g, &mut [0.0]).1
    }

    /// Validates the geometry and motion.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`] naming the first invalid value.
    pub(crate) fn check(&self) -> Result<()> {
        let fault = |what: &str, found: String, wanted: &str| {
            Err(Error::new(ErrorKind::Input, what).at("collider").found(found).wanted(wanted))
        };
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
        let (places, sizes): (Vec<f64>, Vec<f64>) = match self.region {
            Region::Plane { point, normal } => ([point, normal].concat(), vec![]),
            Region::Cylinder { start, end, radius } => ([start, end].concat(), vec![radius]),
            Region::Sphere { centre, radius } => (centre.to_vec(), vec![radius]),
            Region::Cuboid { centre, half } => (centre.to_vec(), half.to_vec()),
        };
        let RigidMotion { velocity, spin, pivot } = self.motion;
        if !finite(&places) || !finite(&[velocity, spin, pivot].concat()) || !finite(self.turn.as_flattened()) {
            return fault("an obstacle has no place or motion", format!("{self:?}"), "finite numbers");
        }
        if sizes.iter().any(|&size| !(size > 0.0 && size.is_finite())) {
            return fault("an obstacle has no size", format!("{sizes:?} m"), "positive lengths in metres");
        }
        match self.contact {
            Contact::Friction(mu) if !(mu >= 0.0 && mu.is_finite()) => {
                fault("the coefficient of friction cannot be used", mu.to_string(), "0 or more")
            }
            _ => Ok(()),
        }
    }
}
