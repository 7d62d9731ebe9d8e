//! Obstacles: analytic, immovable, acting on the velocities of grid nodes.

/// How an obstacle acts on what touches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contact {
    /// `v = 0`
    Sticky,
    /// `v −= n (n·v)`: frictionless, but nothing lifts off.
    Slip,
    /// `v −= n min(n·v, 0)`: frictionless, lifts off freely.
    Separate,
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
    /// A cylinder with flat ends.
    Cylinder {
        /// Centre of one end.
        start: [f64; 3],
        /// Centre of the other end.
        end: [f64; 3],
        /// Radius.
        radius: f64,
    },
}

/// An obstacle: a region and what happens there.
///
/// ```
/// use gradreel_models::physics::{Collider, Contact};
///
/// let ramp = Collider::plane([0.0; 3], [0.0, 2.0, 0.0], Contact::Slip); // the normal need not be a unit vector
/// assert_eq!(ramp.collide([0.3, -0.1, 0.0], [1.0, -2.0, 0.5]), [1.0, 0.0, 0.5]);
/// assert_eq!(ramp.collide([0.3, 0.1, 0.0], [1.0, -2.0, 0.5]), [1.0, -2.0, 0.5]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collider {
    /// Where it is.
    pub region: Region,
    /// How it acts.
    pub contact: Contact,
}

impl Collider {
    /// The half-space below a plane; `normal` is scaled to unit length.
    ///
    /// # Panics
    ///
    /// If the normal has no direction.
    #[track_caller]
    pub fn plane(point: [f64; 3], normal: [f64; 3], contact: Contact) -> Self {
        let length = dot(normal, normal).sqrt();
        assert!(length.is_finite() && length > 0.0, "plane: the normal {normal:?} has no direction");
        Self { region: Region::Plane { point, normal: normal.map(|n| n / length) }, contact }
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
        Self { region: Region::Cylinder { start, end, radius }, contact }
    }

    /// The unit normal at a point inside, `None` outside. Near a cylinder's axis it shrinks to zero:
    /// `n = r/√(r·r + 1e-8)`.
    #[inline]
    pub fn normal(&self, x: [f64; 3]) -> Option<[f64; 3]> {
        match self.region {
            Region::Plane { point, normal } => (dot(minus(x, point), normal) <= 1e-6).then_some(normal),
            Region::Cylinder { start, end, radius } => {
                let axis = minus(end, start);
                let length = dot(axis, axis).sqrt();
                let axis = axis.map(|a| a / length);
                let from_start = minus(x, start);
                let along = dot(from_start, axis);
                let radial: [f64; 3] = std::array::from_fn(|i| from_start[i] - along * axis[i]);
                let distance = (dot(radial, radial) + 1e-8).sqrt();
                let inside = (0.0..=length).contains(&along) && distance <= radius;
                inside.then(|| radial.map(|r| r / distance))
            }
        }
    }

    /// The velocity \[m/s\] a node at `x` \[m\] has after contact.
    #[inline]
    pub fn collide(&self, x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        match (self.normal(x), self.contact) {
            (None, _) => v,
            (Some(_), Contact::Sticky) => [0.0; 3],
            (Some(n), Contact::Slip) => without(v, n, dot(n, v)),
            (Some(n), Contact::Separate) => without(v, n, dot(n, v).min(0.0)),
        }
    }

    /// The cotangent of the velocity before contact, given it and the cotangent of the velocity after contact.
    #[inline]
    pub fn collide_vjp(&self, x: [f64; 3], v: [f64; 3], g: [f64; 3]) -> [f64; 3] {
        match (self.normal(x), self.contact) {
            (None, _) => g,
            (Some(_), Contact::Sticky) => [0.0; 3],
            (Some(n), Contact::Slip) => without(g, n, dot(n, g)),
            (Some(n), Contact::Separate) => without(g, n, if dot(n, v) < 0.0 { dot(n, g) } else { 0.0 }),
        }
    }
}

/// All obstacles in order: the velocity after contact.
#[inline]
pub(crate) fn collide(colliders: &[Collider], x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    colliders.iter().fold(v, |v, collider| collider.collide(x, v))
}

/// All obstacles in order: the velocity after contact, and the cotangent of the one before.
pub(crate) fn collide_vjp(colliders: &[Collider], x: [f64; 3], v: [f64; 3], g: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    match colliders.split_first() {
        None => (v, g),
        Some((first, rest)) => {
            let (after, g) = collide_vjp(rest, x, first.collide(x, v), g);
            (after, first.collide_vjp(x, v, g))
        }
    }
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `v − n·amount`
#[inline(always)]
fn without(v: [f64; 3], n: [f64; 3], amount: f64) -> [f64; 3] {
    [v[0] - n[0] * amount, v[1] - n[1] * amount, v[2] - n[2] * amount]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A node inside all of them, one after the other.
    fn pile(contact: Contact) -> Vec<Collider> {
        vec![
            Collider::plane([0.0; 3], [0.3, 1.0, -0.2], contact),
            Collider::cylinder([-1.0, 0.0, 0.0], [1.0, 0.1, 0.0], 0.5, contact),
        ]
    }

    #[test]
    fn adjoints_agree_with_central_differences() {
        let (x, g) = ([0.1, -0.1, 0.05], [0.7, -0.4, 0.9]);
        for contact in [Contact::Sticky, Contact::Slip, Contact::Separate] {
            for v in [[0.3, -1.0, 0.2], [0.3, 1.0, -0.2], [-1.0, 0.1, 0.8]] {
                let colliders = pile(contact);
                assert!(colliders.iter().all(|collider| collider.normal(x).is_some()));
                let (after, before) = collide_vjp(&colliders, x, v, g);
                assert_eq!(after, collide(&colliders, x, v));
                for axis in 0..3 {
                    let along = |by: f64| {
                        let mut v = v;
                        v[axis] += by;
                        dot(g, collide(&colliders, x, v))
                    };
                    let difference = (along(1e-6) - along(-1e-6)) / 2e-6;
                    assert!(
                        (before[axis] - difference).abs() < 1e-8,
                        "{contact:?}: {before:?}, axis {axis}: {difference}"
                    );
                }
            }
        }
    }

    #[test]
    fn only_separate_contact_lets_go() {
        let (x, away) = ([0.0, -0.1, 0.0], [0.5, 1.0, 0.0]);
        let ground = |contact| Collider::plane([0.0; 3], [0.0, 1.0, 0.0], contact).collide(x, away);
        assert_eq!(ground(Contact::Sticky), [0.0; 3]);
        assert_eq!(ground(Contact::Slip), [0.5, 0.0, 0.0]);
        assert_eq!(ground(Contact::Separate), away);
    }

    #[test]
    fn a_cylinder_ends_where_it_ends() {
        let rod = Collider::cylinder([0.0; 3], [1.0, 0.0, 0.0], 0.1, Contact::Sticky);
        assert!(rod.normal([0.5, 0.09, 0.0]).is_some());
        assert!(rod.normal([0.5, 0.11, 0.0]).is_none());
        assert!(rod.normal([1.01, 0.0, 0.0]).is_none());
        let n = rod.normal([0.5, 0.0, 0.05]).unwrap();
        approx::assert_abs_diff_eq!(n[2], 1.0, epsilon = 1e-5);
    }
}
