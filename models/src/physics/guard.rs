//! Contact of particles with solid obstacles: nothing passes through a surface, however thin the solid or fast the
//! particle.
//!
//! On the grid, an obstacle acts only at nodes inside it. A plate thinner than two cells acts there as if it were two cells
//! thick, but only against approach, so that what passes beside it is not held. A rod or a small ball does not act on the
//! grid. The guard tests the path of each particle during a substep, so that
//! none enters the solid itself.

use rayon::prelude::*;

use super::collider::{Collider, Contact, Region};
use super::contact::Placed;
use super::row::Number;
use super::state::{BLOCK, State, V, widen};
use super::world::World;
use crate::vector::{dot, minus, plus};

/// Distance from the surface at which particles are placed, in cells; larger than rounding errors of positions.
const SKIN: f64 = 1e-4;
/// Passes over all obstacles, as one may push a particle into another.
const ROUNDS: usize = 3;

/// Whether an obstacle is too thin to act on a grid of this spacing \[m\]: thinner than two cells.
pub(crate) fn is_thin(collider: &Collider, dx: f64) -> bool {
    collider.thickness() < 2.0 * dx
}

/// The obstacle that acts on the grid. A thin plate is widened to two cells, so that it contains nodes wherever it lies, and
/// separates there, whatever its contact: nodes of the widened part lie outside it. `None` for a solid that is thin in two
/// directions.
fn on_grid(collider: &Collider, dx: f64) -> Option<Collider> {
    let wide = |half: f64| half >= dx;
    let region = match collider.region {
        _ if !is_thin(collider, dx) => return Some(*collider),
        Region::Cuboid { centre, half } if half.into_iter().filter(|half| wide(*half)).count() == 2 => {
            Region::Cuboid { centre, half: half.map(|half| half.max(dx)) }
        }
        Region::Cylinder { start, end, radius } if wide(radius) => {
            let axis = minus(end, start);
            let longer = axis.map(|a| a * 0.5 * ((2.0 * dx / dot(axis, axis).sqrt()).max(1.0) - 1.0));
            Region::Cylinder { start: minus(start, longer), end: plus(end, longer), radius }
        }
        _ => return None,
    };
    Some(Collider { region, contact: Contact::Separate, ..*collider })
}

/// The solid obstacles of a world.
#[derive(Debug)]
pub(crate) struct Guard {
    solids: Vec<Collider>,
    skin: f64,
}

impl Guard {
    /// The solids of a world, and the obstacles that act on the grid as well.
    pub fn of(world: &World) -> (Self, Vec<Collider>) {
        let solids = world.colliders.iter().filter(|collider| collider.thickness().is_finite()).copied().collect();
        let on_grid = world.colliders.iter().filter_map(|collider| on_grid(collider, world.dx)).collect();
        (Self { solids, skin: SKIN * world.dx }, on_grid)
    }

    /// Stops particles whose path from `now` to `next` enters a solid at its surface; their velocity becomes that after
    /// contact. `times` are start and end of the substep \[s\].
    ///
    /// A particle slides along the surface, or stays at the point of impact if the contact is sticky. Contact is
    /// evaluated anew in each substep.
    pub fn hold<T: Number>(&self, now: &State<T>, next: &mut State<T>, times: [f64; 2]) {
        if self.solids.is_empty() {
            return;
        }
        let placed: Vec<(&Collider, [Placed; 2])> =
            self.solids.iter().map(|solid| (solid, times.map(|t| Placed::new(solid, t)))).collect();
        let (len, stride) = (now.len(), now.stride());
        let blocks = now.values.par_chunks_exact(stride).zip(next.values.par_chunks_exact_mut(stride)).enumerate();
        let extents: Vec<[[T; 3]; 2]> = blocks
            .filter_map(|(block, (now, next))| {
                let mut extent: Option<[[T; 3]; 2]> = None;
                for lane in 0..(len - block * BLOCK).min(BLOCK) {
                    let read = |values: &[T], component: usize| -> [f64; 3] {
                        std::array::from_fn(|axis| values[(component + axis) * BLOCK + lane].to_f64())
                    };
                    let moved = (read(next, 0), read(next, V));
                    let Some((x, v)) = self.held(&placed, read(now, 0), moved) else { continue };
                    let mut write = |component: usize, value: [f64; 3]| {
                        let value = value.map(T::from_f64);
                        (0..3).for_each(|axis| next[(component + axis) * BLOCK + lane] = value[axis]);
                        value
                    };
                    write(V, v);
                    let x = write(0, x);
                    extent = Some(widen(extent.unwrap_or([x, x]), x));
                }
                extent
            })
            .collect();
        // the box must include the particles moved back
        for [low, high] in extents {
            next.extent = widen(widen(next.extent, low), high);
        }
    }

    /// Position and velocity after contact, if there is any.
    fn held(
        &self,
        solids: &[(&Collider, [Placed; 2])],
        from: [f64; 3],
        (mut x, mut v): ([f64; 3], [f64; 3]),
    ) -> Option<([f64; 3], [f64; 3])> {
        let mut touched = false;
        for _ in 0..ROUNDS {
            let before = x;
            for (solid, [start, end]) in solids {
                let way = [start.back(from), end.back(x)];
                let Some(Entry { at, normal }) = entry(&solid.region, way, self.skin) else { continue };
                let sunk = dot(normal, minus(way[1], at));
                let slid: [f64; 3] = std::array::from_fn(|axis| way[1][axis] - normal[axis] * sunk);
                let place = if solid.contact == Contact::Sticky { at } else { slid };
                let place = end.forth(plus(place, normal.map(|n| n * self.skin)));
                v = end.touch(normal, x, v);
                x = place;
                touched = true;
            }
            if x == before {
                break;
            }
        }
        touched.then_some((x, v))
    }
}

/// The point where a path enters a region, and the unit normal there.
struct Entry {
    at: [f64; 3],
    normal: [f64; 3],
}

/// Where a straight path enters a region, if it does. A path that begins inside enters at the face nearest to its
/// start, unless it leaves through that face.
fn entry(region: &Region, [from, to]: [[f64; 3]; 2], skin: f64) -> Option<Entry> {
    let way = minus(to, from);
    // the interval of the path inside all bounds so far, and the normal of the bound entered last
    let mut inside = [f64::NEG_INFINITY, f64::INFINITY];
    let mut last = [0.0; 3];
    let mut depth = (f64::INFINITY, [0.0; 3]);
    let mut bound = |[enters, leaves]: [f64; 2], normal: [f64; 3], (below, outwards): (f64, [f64; 3])| {
        if enters > inside[0] {
            (inside[0], last) = (enters, normal);
        }
        inside[1] = inside[1].min(leaves);
        if below < depth.0 {
            depth = (below, outwards);
        }
    };
    // a slab |p| ≤ half, with p the coordinate along a unit vector
    let mut slab = |p: f64, d: f64, half: f64, axis: [f64; 3]| {
        let turned = |sign: f64| axis.map(|a| sign * a);
        let near = (half - p.abs(), turned(p.signum()));
        match d {
            0.0 if p.abs() <= half => bound([f64::NEG_INFINITY, f64::INFINITY], [0.0; 3], near),
            0.0 => bound([f64::INFINITY, f64::NEG_INFINITY], [0.0; 3], near),
            _ => bound([(-half * d.signum() - p) / d, (half * d.signum() - p) / d], turned(-d.signum()), near),
        }
    };
    match *region {
        Region::Plane { .. } => return None,
        Region::Cuboid { centre, half } => {
            let p = minus(from, centre);
            for axis in 0..3 {
                let mut along = [0.0; 3];
                along[axis] = 1.0;
                slab(p[axis], way[axis], half[axis], along);
            }
        }
        Region::Sphere { centre, radius } => round(minus(from, centre), way, radius, &mut bound),
        Region::Cylinder { start, end, radius } => {
            let axis = minus(end, start);
            let length = dot(axis, axis).sqrt();
            let axis = axis.map(|a| a / length);
            let p: [f64; 3] = std::array::from_fn(|i| from[i] - 0.5 * (start[i] + end[i]));
            slab(dot(p, axis), dot(way, axis), 0.5 * length, axis);
            let across = |x: [f64; 3]| {
                let along = dot(x, axis);
                std::array::from_fn(|i| x[i] - along * axis[i])
            };
            round(across(p), across(way), radius, &mut bound);
        }
    }
    let (below, outwards) = depth;
    if below > 0.0 {
        let at = plus(from, outwards.map(|n| n * below));
        return (dot(way, outwards) < 0.0).then_some(Entry { at, normal: outwards });
    }
    let [enters, leaves] = inside;
    let hit = enters < leaves && (0.0..=1.0).contains(&enters);
    // a path that starts on the surface and leads inwards
    let hit = hit || (below > -skin && enters <= 0.0 && leaves > 0.0 && dot(way, last) < 0.0);
    hit.then(|| Entry { at: std::array::from_fn(|axis| from[axis] + enters.max(0.0) * way[axis]), normal: last })
}

/// A ball, or an infinite cylinder, of this radius around the origin of `p`.
fn round(p: [f64; 3], d: [f64; 3], radius: f64, bound: &mut impl FnMut([f64; 2], [f64; 3], (f64, [f64; 3]))) {
    let distance = dot(p, p).sqrt();
    let outwards = if distance > 0.0 { p.map(|p| p / distance) } else { [0.0, 1.0, 0.0] };
    let near = (radius - distance, outwards);
    let (a, b, c) = (dot(d, d), dot(p, d), (distance - radius) * (distance + radius));
    let root = b * b - a * c;
    if a == 0.0 || root <= 0.0 {
        let always = c <= 0.0;
        let ends = if always { [f64::NEG_INFINITY, f64::INFINITY] } else { [f64::INFINITY, f64::NEG_INFINITY] };
        return bound(ends, [0.0; 3], near);
    }
    let ends = [-1.0, 1.0].map(|sign| (-b + sign * root.sqrt()) / a);
    let at: [f64; 3] = std::array::from_fn(|axis| p[axis] + ends[0] * d[axis]);
    bound(ends, at.map(|x| x / radius), near);
}
