//! Contact of obstacles with nodes: velocity after contact, vjp and jvp.

use super::collider::{Collider, Contact, Region};
use crate::vector::{EYE, cross, dot, minus, plus, product, rotation, times};

/// An obstacle at one moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    collider: Collider,
    /// Rotation and displacement of the pivot; `None` if the obstacle is where its region says.
    pose: Option<([[f64; 3]; 3], [f64; 3])>,
}

/// The normals of the faces that act on a node; several in a corner of a container.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Normals {
    all: [[f64; 3]; 3],
    count: usize,
}

impl Normals {
    #[inline(always)]
    fn add(&mut self, normal: [f64; 3]) {
        self.all[self.count] = normal;
        self.count += 1;
    }
}

impl IntoIterator for Normals {
    type Item = [f64; 3];
    type IntoIter = std::iter::Take<std::array::IntoIter<[f64; 3], 3>>;

    fn into_iter(self) -> Self::IntoIter {
        self.all.into_iter().take(self.count)
    }
}

impl Placed {
    /// The obstacle at time `t` \[s\].
    pub fn new(collider: &Collider, t: f64) -> Self {
        let motion = &collider.motion;
        let pose = (!collider.is_at_rest())
            .then(|| (product(rotation(motion.spin.map(|w| w * t)), collider.turn), motion.velocity.map(|v| v * t)));
        Self { collider: *collider, pose }
    }

    /// The position of the pivot, and the rotation (row-major); zero and the identity without a pose.
    pub fn pose(&self) -> ([f64; 3], [[f64; 3]; 3]) {
        let pivot = self.collider.motion.pivot;
        self.pose.map_or(([0.0; 3], EYE), |(turn, shift)| (plus(pivot, shift), turn))
    }

    /// Maps a point from world coordinates to the coordinates of the region.
    #[inline]
    pub fn back(&self, x: [f64; 3]) -> [f64; 3] {
        let Some((turn, shift)) = &self.pose else { return x };
        let pivot = self.collider.motion.pivot;
        let from_pivot = minus(minus(x, pivot), *shift);
        std::array::from_fn(|j| (0..3).map(|i| turn[i][j] * from_pivot[i]).sum::<f64>() + pivot[j])
    }

    /// The inverse of [`Placed::back`].
    pub fn forth(&self, x: [f64; 3]) -> [f64; 3] {
        let Some((turn, shift)) = &self.pose else { return x };
        let pivot = self.collider.motion.pivot;
        plus(plus(pivot, *shift), times(turn, minus(x, pivot)))
    }

    /// The velocity at a point after contact with one face; the normal is in the coordinates of the region.
    pub fn touch(&self, normal: [f64; 3], x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let normal = self.pose.as_ref().map_or(normal, |(turn, _)| times(turn, normal));
        touch(self.collider.contact, normal, self.velocity(x), v)
    }

    /// The faces that act at a point.
    #[inline]
    pub fn normals(&self, x: [f64; 3]) -> Normals {
        let mut found = faces(&self.collider, self.back(x));
        if let Some((turn, _)) = &self.pose {
            found.all = found.all.map(|normal| times(turn, normal));
        }
        found
    }

    /// The velocity of the obstacle at a point.
    #[inline]
    fn velocity(&self, x: [f64; 3]) -> [f64; 3] {
        let Some((_, shift)) = self.pose else { return [0.0; 3] };
        let motion = &self.collider.motion;
        let turning = cross(motion.spin, minus(minus(x, motion.pivot), shift));
        std::array::from_fn(|axis| motion.velocity[axis] + turning[axis])
    }

    /// The velocity of a node after contact.
    #[inline]
    pub fn collide(&self, x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let normals = self.normals(x);
        if normals.count == 0 {
            return v;
        }
        let wall = self.velocity(x);
        normals.into_iter().fold(v, |v, n| touch(self.collider.contact, n, wall, v))
    }
}

/// The faces of an obstacle at rest that act at a point.
#[inline]
fn faces(collider: &Collider, x: [f64; 3]) -> Normals {
    let mut found = Normals::default();
    match (collider.region, collider.container) {
        (Region::Plane { point, normal }, false) => {
            if dot(minus(x, point), normal) <= 1e-6 {
                found.add(normal);
            }
        }
        (Region::Plane { point, normal }, true) => {
            if dot(minus(x, point), normal) >= -1e-6 {
                found.add(normal.map(|n| -n));
            }
        }
        (Region::Cylinder { start, end, radius }, container) => {
            let axis = minus(end, start);
            let length = dot(axis, axis).sqrt();
            let axis = axis.map(|a| a / length);
            let from_start = minus(x, start);
            let along = dot(from_start, axis);
            let radial: [f64; 3] = std::array::from_fn(|i| from_start[i] - along * axis[i]);
            let distance = (dot(radial, radial) + 1e-8).sqrt();
            if !container {
                if (0.0..=length).contains(&along) && distance <= radius {
                    found.add(radial.map(|r| r / distance));
                }
                return found;
            }
            if distance >= radius {
                found.add(radial.map(|r| -r / distance));
            }
            if along <= 0.0 {
                found.add(axis);
            } else if along >= length {
                found.add(axis.map(|a| -a));
            }
        }
        (Region::Sphere { centre, radius }, container) => {
            let from_centre = minus(x, centre);
            let distance = (dot(from_centre, from_centre) + 1e-8).sqrt();
            match container {
                false if distance <= radius => found.add(from_centre.map(|r| r / distance)),
                true if distance >= radius => found.add(from_centre.map(|r| -r / distance)),
                _ => {}
            }
        }
        (Region::Cuboid { centre, half }, container) => {
            let from_centre = minus(x, centre);
            let depth: [f64; 3] = std::array::from_fn(|axis| half[axis] - from_centre[axis].abs());
            let face = |axis: usize, outwards: f64| {
                let mut normal = [0.0; 3];
                normal[axis] = outwards * from_centre[axis].signum();
                normal
            };
            if container {
                (0..3).filter(|&axis| depth[axis] <= 0.0).for_each(|axis| found.add(face(axis, -1.0)));
            } else if depth.iter().all(|&depth| depth >= 0.0) {
                let nearest = (1..3).fold(0, |best, axis| if depth[axis] < depth[best] { axis } else { best });
                found.add(face(nearest, 1.0));
            }
        }
    }
    found
}

/// The velocity after contact with one face.
#[inline(always)]
fn touch(contact: Contact, n: [f64; 3], wall: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    match contact {
        Contact::Sticky => wall,
        Contact::Slip => without(v, n, dot(n, minus(v, wall))),
        Contact::Separate => without(v, n, dot(n, minus(v, wall)).min(0.0)),
        Contact::Friction(mu) => match Slide::of(mu, n, wall, v) {
            Slide::Free => v,
            Slide::Stuck => wall,
            Slide::Sliding { impact, direction, speed } => {
                let kept = speed + mu * impact;
                std::array::from_fn(|axis| wall[axis] + direction[axis] * kept)
            }
        },
    }
}

/// Friction states of a node.
enum Slide {
    /// It separates.
    Free,
    /// Friction stops it.
    Stuck,
    /// It slides: normal velocity (negative), direction and speed along the face.
    Sliding { impact: f64, direction: [f64; 3], speed: f64 },
}

impl Slide {
    #[inline(always)]
    fn of(mu: f64, n: [f64; 3], wall: [f64; 3], v: [f64; 3]) -> Self {
        let relative = minus(v, wall);
        let impact = dot(n, relative);
        // The comparison fails for NaN, which must not count as free.
        if impact >= 0.0 {
            return Self::Free;
        }
        let along = without(relative, n, impact);
        let speed = dot(along, along).sqrt();
        if speed <= -mu * impact {
            return Self::Stuck;
        }
        Self::Sliding { impact, direction: along.map(|t| t / speed), speed }
    }
}

/// The vjp of [`touch`]: the cotangent of the velocity before contact. Adds to the cotangent of the friction
/// coefficient.
fn touch_vjp(contact: Contact, n: [f64; 3], wall: [f64; 3], v: [f64; 3], g: [f64; 3], friction: &mut f64) -> [f64; 3] {
    match contact {
        Contact::Sticky => [0.0; 3],
        Contact::Slip => without(g, n, dot(n, g)),
        Contact::Separate => without(g, n, if dot(n, minus(v, wall)) < 0.0 { dot(n, g) } else { 0.0 }),
        Contact::Friction(mu) => match Slide::of(mu, n, wall, v) {
            Slide::Free => g,
            Slide::Stuck => [0.0; 3],
            Slide::Sliding { impact, direction, speed } => {
                let along = dot(g, direction);
                *friction += impact * along;
                let share = mu * impact / speed;
                let on_along: [f64; 3] = std::array::from_fn(|i| g[i] + share * (g[i] - direction[i] * along));
                without(on_along, n, dot(n, on_along) - mu * along)
            }
        },
    }
}

/// The jvp of [`touch`], for tangents of the velocity and of the friction coefficient.
fn touch_jvp(contact: Contact, n: [f64; 3], wall: [f64; 3], v: [f64; 3], dv: [f64; 3], friction: f64) -> [f64; 3] {
    match contact {
        Contact::Sticky => [0.0; 3],
        Contact::Slip => without(dv, n, dot(n, dv)),
        Contact::Separate => without(dv, n, if dot(n, minus(v, wall)) < 0.0 { dot(n, dv) } else { 0.0 }),
        Contact::Friction(mu) => match Slide::of(mu, n, wall, v) {
            Slide::Free => dv,
            Slide::Stuck => [0.0; 3],
            Slide::Sliding { impact, direction, speed } => {
                let down = dot(n, dv);
                let along = without(dv, n, down);
                let share = mu * impact / speed;
                let forward = dot(along, direction);
                let braked = mu * down + friction * impact;
                std::array::from_fn(|i| along[i] + share * (along[i] - direction[i] * forward) + direction[i] * braked)
            }
        },
    }
}

/// The velocity after contact with all obstacles in order.
#[inline]
pub(crate) fn collide(obstacles: &[Placed], x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    obstacles.iter().fold(v, |v, obstacle| obstacle.collide(x, v))
}

/// The vjp of [`collide`]: the velocity after contact, and the cotangent of the velocity before. Adds to the cotangents
/// of the friction coefficients, one per obstacle.
pub(crate) fn collide_vjp(
    obstacles: &[Placed],
    x: [f64; 3],
    v: [f64; 3],
    g: [f64; 3],
    friction: &mut [f64],
) -> ([f64; 3], [f64; 3]) {
    let Some((first, rest)) = obstacles.split_first() else { return (v, g) };
    let normals = first.normals(x);
    if normals.count == 0 {
        return collide_vjp(rest, x, v, g, &mut friction[1..]);
    }
    let (wall, contact) = (first.velocity(x), first.collider.contact);
    let mut before = [v; 4];
    for (k, n) in normals.into_iter().enumerate() {
        before[k + 1] = touch(contact, n, wall, before[k]);
    }
    let (after, mut g) = collide_vjp(rest, x, before[normals.count], g, &mut friction[1..]);
    for k in (0..normals.count).rev() {
        g = touch_vjp(contact, normals.all[k], wall, before[k], g, &mut friction[0]);
    }
    (after, g)
}

/// The jvp of [`collide`]; `friction` holds the tangents of the friction coefficients, one per obstacle.
pub(crate) fn collide_jvp(
    obstacles: &[Placed],
    x: [f64; 3],
    mut v: [f64; 3],
    mut dv: [f64; 3],
    friction: &[f64],
) -> [f64; 3] {
    for (obstacle, &friction) in obstacles.iter().zip(friction) {
        let normals = obstacle.normals(x);
        if normals.count == 0 {
            continue;
        }
        let (wall, contact) = (obstacle.velocity(x), obstacle.collider.contact);
        for n in normals {
            dv = touch_jvp(contact, n, wall, v, dv, friction);
            v = touch(contact, n, wall, v);
        }
    }
    dv
}

/// `v − n·amount`
#[inline(always)]
fn without(v: [f64; 3], n: [f64; 3], amount: f64) -> [f64; 3] {
    [v[0] - n[0] * amount, v[1] - n[1] * amount, v[2] - n[2] * amount]
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTACTS: [Contact; 5] =
        [Contact::Sticky, Contact::Slip, Contact::Separate, Contact::Friction(0.3), Contact::Friction(3.0)];

    /// Obstacles that all contain the test node, at rest and in motion.
    fn pile(contact: Contact, t: f64) -> Vec<Placed> {
        let colliders = [
            Collider::plane([0.0; 3], [0.3, 1.0, -0.2], contact),
            Collider::cylinder([-1.0, 0.0, 0.0], [1.0, 0.1, 0.0], 0.5, contact),
            Collider::sphere([0.0, -0.3, 0.1], 0.4, contact).moving([0.05, 0.1, 0.0]),
            Collider::cuboid([0.0; 3], [0.3, 0.4, 0.2], contact).spinning([0.1, 0.2, -0.1], [0.1, 0.0, 0.0]),
            Collider::cuboid([5.0; 3], [0.3, 0.4, 0.2], contact).container(),
            Collider::sphere([0.0, 2.0, 0.0], 0.5, contact).container(),
        ];
        colliders.iter().map(|collider| Placed::new(collider, t)).collect()
    }

    const X: [f64; 3] = [0.1, -0.1, 0.05];

    #[test]
    fn both_derivatives_agree_with_central_differences() {
        let (x, g) = (X, [0.7, -0.4, 0.9]);
        for (contact, last) in CONTACTS.iter().flat_map(|&contact| (1..=6).map(move |last| (contact, last))) {
            for v in [[0.3, -1.0, 0.2], [0.3, 1.0, -0.2], [-1.0, 0.1, 0.8]] {
                let obstacles = &pile(contact, 0.7)[last - 1..last];
                assert!(obstacles.iter().all(|obstacle| obstacle.normals(x).count > 0));
                let mut on_friction = [0.0];
                let (after, before) = collide_vjp(obstacles, x, v, g, &mut on_friction);
                assert_eq!(after, collide(obstacles, x, v));
                for axis in 0..3 {
                    let moved = |by: f64| {
                        let mut v = v;
                        v[axis] += by;
                        collide(obstacles, x, v)
                    };
                    let slope = minus(moved(1e-6), moved(-1e-6)).map(|d| d / 2e-6);
                    let difference = dot(g, slope);
                    let place = format!("{contact:?}, obstacle {last}, axis {axis}");
                    assert!((before[axis] - difference).abs() < 1e-8, "{place}: {before:?}, {difference}");
                    let mut dv = [0.0; 3];
                    dv[axis] = 1.0;
                    let tangent = collide_jvp(obstacles, x, v, dv, &[0.0]);
                    assert!(minus(tangent, slope).iter().all(|d| d.abs() < 1e-8), "{place}: {tangent:?}, {slope:?}");
                }
                if let Contact::Friction(mu) = contact {
                    let with = |mu: f64| collide(&pile(Contact::Friction(mu), 0.7)[last - 1..last], x, v);
                    let slope = minus(with(mu + 1e-6), with(mu - 1e-6)).map(|d| d / 2e-6);
                    assert!((on_friction[0] - dot(g, slope)).abs() < 1e-8, "{contact:?}: {on_friction:?}, {slope:?}");
                    let tangent = collide_jvp(obstacles, x, v, [0.0; 3], &[1.0]);
                    assert!(minus(tangent, slope).iter().all(|d| d.abs() < 1e-8), "{contact:?}: {tangent:?}");
                }
            }
        }
    }

    #[test]
    fn a_chain_of_obstacles_has_the_derivatives_of_a_chain() {
        let (g, v) = ([0.7, -0.4, 0.9], [0.3, -1.0, 0.2]);
        for contact in [Contact::Slip, Contact::Separate, Contact::Friction(0.1)] {
            let obstacles = &pile(contact, 0.7)[..4];
            let (_, before) = collide_vjp(obstacles, X, v, g, &mut [0.0; 4]);
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut v = v;
                    v[axis] += by;
                    collide(obstacles, X, v)
                };
                let difference = dot(g, minus(moved(1e-6), moved(-1e-6))) / 2e-6;
                approx::assert_abs_diff_eq!(before[axis], difference, epsilon = 1e-8);
                let mut dv = [0.0; 3];
                dv[axis] = 1.0;
                approx::assert_abs_diff_eq!(
                    dot(g, collide_jvp(obstacles, X, v, dv, &[0.0; 4])),
                    difference,
                    epsilon = 1e-8
                );
            }
        }
    }

    #[test]
    fn only_separate_contact_and_friction_let_go() {
        let (x, away) = ([0.0, -0.1, 0.0], [0.5, 1.0, 0.0]);
        let ground = |contact| Collider::plane([0.0; 3], [0.0, 1.0, 0.0], contact).collide(x, away);
        assert_eq!(ground(Contact::Sticky), [0.0; 3]);
        assert_eq!(ground(Contact::Slip), [0.5, 0.0, 0.0]);
        assert_eq!(ground(Contact::Separate), away);
        assert_eq!(ground(Contact::Friction(0.5)), away);
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

    #[test]
    fn containers_push_inwards_and_hold_their_corners() {
        let tank = Collider::cuboid([0.0; 3], [1.0, 2.0, 3.0], Contact::Separate).container();
        assert_eq!(tank.collide([1.1, -2.1, 0.0], [1.0, -1.0, 0.5]), [0.0, 0.0, 0.5]);
        assert_eq!(tank.collide([1.1, -2.1, 0.0], [-1.0, 1.0, 0.5]), [-1.0, 1.0, 0.5]);
        let can = Collider::cylinder([0.0; 3], [0.0, 1.0, 0.0], 0.2, Contact::Slip).container();
        let v = can.collide([0.3, -0.1, 0.0], [1.0, -1.0, 0.5]);
        assert!(v[0].abs() < 1e-6 && v[1] == 0.0 && v[2] == 0.5, "{v:?}");
        assert_eq!(can.normal([0.1, 0.5, 0.0]), None);
        let bowl = Collider::sphere([0.0; 3], 1.0, Contact::Separate).container();
        assert!(bowl.normal([0.0, -1.2, 0.0]).unwrap()[1] > 0.99);
    }

    #[test]
    fn a_turning_obstacle_carries_along() {
        use std::f64::consts::FRAC_PI_2;
        let plate = Collider::cuboid([0.5, 0.0, 0.0], [0.5, 0.1, 0.1], Contact::Sticky);
        let plate = plate.spinning([0.0, 0.0, 2.0], [0.0; 3]);
        // After a quarter turn it points upwards and moves to the left.
        let later = Placed::new(&plate, FRAC_PI_2 / 2.0);
        let v = later.collide([0.0, 0.5, 0.0], [0.0; 3]);
        assert!((v[0] + 1.0).abs() < 1e-12 && v[1].abs() < 1e-12, "{v:?}");
        assert_eq!(later.collide([0.5, 0.0, 0.0], [0.3; 3]), [0.3; 3]);
        // Rotated at the start about the same axis, it is in that pose at rest.
        let tilted = Collider::cuboid([0.5, 0.0, 0.0], [0.5, 0.1, 0.1], Contact::Separate);
        let tilted = tilted.turned([0.0, 0.0, FRAC_PI_2], [0.0; 3]);
        assert_eq!(tilted.normal([0.5, 0.0, 0.0]), None);
        let n = tilted.normal([0.08, 0.5, 0.0]).unwrap();
        assert!((n[0] - 1.0).abs() < 1e-12, "{n:?}");
    }
}
