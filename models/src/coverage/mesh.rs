//! The surface of a solid as a mesh that its particles carry, where rays meet it.

use super::Recipe;
use crate::scenes::Hit;
use crate::vector::{cross, dot, minus, norm, unit};
use crate::views::objects::{Bvh, crossed};

/// A mesh at rest, and which particles carry each of its corners.
pub(super) struct Skin {
    corners: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    colours: Vec<[f64; 3]>,
    /// Particles and weights of each corner.
    carriers: Vec<Vec<(u32, f64)>>,
}

/// The mesh in one frame.
pub(super) struct Mesh<'a> {
    skin: &'a Skin,
    corners: Vec<[f64; 3]>,
    tree: Bvh,
}

/// Radius within which particles carry a corner, in their spacings.
const REACH: f64 = 2.5;
/// Below this share of the mean second moment, a direction of the neighbourhood is taken to be rigid.
const FLAT: f64 = 0.02;

impl Skin {
    /// The mesh of a body whose particles are here at rest \[m\], so far apart \[m\].
    pub fn of(recipe: &Recipe, rest: &[[f32; 3]], spacing: f64) -> Self {
        let (places, triangles) = recipe.body.field().net();
        let colours = places.iter().map(|place| recipe.body.colour(*place)).collect();
        let corners: Vec<[f64; 3]> = places
            .iter()
            .map(|place| std::array::from_fn(|axis| recipe.start[axis] + recipe.size * place[axis]))
            .collect();
        let carriers = corners.iter().map(|corner| carriers(*corner, rest, spacing)).collect();
        Self { corners, triangles, colours, carriers }
    }

    /// The mesh where its particles have gone from `rest` to `now` \[m\]: each corner follows the affine motion of its
    /// neighbourhood (moving least squares; Müller et al., *Meshless deformations based on shape matching*, 2005).
    pub fn carried(&self, rest: &[[f32; 3]], now: &[[f32; 3]]) -> Mesh<'_> {
        let wide = |x: [f32; 3]| x.map(f64::from);
        let moved = |(corner, carriers): (&[f64; 3], &Vec<(u32, f64)>)| -> [f64; 3] {
            let total: f64 = carriers.iter().map(|(_, w)| w).sum();
            let mean = |all: &[[f32; 3]]| -> [f64; 3] {
                std::array::from_fn(|axis| {
                    carriers.iter().map(|(p, w)| w * f64::from(all[*p as usize][axis])).sum::<f64>() / total
                })
            };
            let (before, after) = (mean(rest), mean(now));
            let (mut spread, mut turned) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
            for (p, w) in carriers {
                let from = minus(wide(rest[*p as usize]), before);
                let to = minus(wide(now[*p as usize]), after);
                for i in 0..3 {
                    for j in 0..3 {
                        spread[i][j] += w * from[i] * from[j];
                        turned[i][j] += w * to[i] * from[j];
                    }
                }
            }
            // where the neighbourhood is flat, what lies across it moves as if nothing were stretched
            let rigid = FLAT * (0..3).map(|k| spread[k][k]).sum::<f64>() / 3.0;
            for k in 0..3 {
                spread[k][k] += rigid;
                turned[k][k] += rigid;
            }
            let offset = solved(spread, minus(*corner, before));
            std::array::from_fn(|i| after[i] + dot(turned[i], offset))
        };
        let corners: Vec<[f64; 3]> = self.corners.iter().zip(&self.carriers).map(moved).collect();
        let places: Vec<[[f32; 3]; 3]> =
            self.triangles.iter().map(|t| t.map(|c| corners[c as usize].map(|x| x as f32))).collect();
        Mesh { skin: self, corners, tree: Bvh::new(&places) }
    }
}

impl Mesh<'_> {
    /// The first point of a ray on the mesh.
    pub fn hit(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Hit> {
        let mut best: Option<(f64, u32, [f64; 2])> = None;
        self.tree.visit(origin, along, |index| {
            let corners = self.skin.triangles[index as usize].map(|c| self.corners[c as usize]);
            if let Some((t, shares)) = crossed(corners, origin, along)
                && best.is_none_or(|(sooner, other, _)| t < sooner || (t == sooner && index < other))
            {
                best = Some((t, index, shares));
            }
            best.map_or(f64::INFINITY, |best| best.0)
        });
        let (_, index, [second, third]) = best?;
        let [a, b, c] = self.skin.triangles[index as usize].map(|c| c as usize);
        let [x, y, z] = [a, b, c].map(|corner| self.corners[corner]);
        let normal = unit(cross(minus(y, x), minus(z, x)));
        let colours = [a, b, c].map(|corner| self.skin.colours[corner]);
        let colour =
            [0, 1, 2].map(|k| (1.0 - second - third) * colours[0][k] + second * colours[1][k] + third * colours[2][k]);
        // a mesh is lit from both sides
        let towards = if dot(normal, along) > 0.0 { normal.map(|n| -n) } else { normal };
        Some(Hit { colour, normal: towards })
    }
}

/// The particles around a corner with their weights `(1 − r²/R²)³`; the nearest one at least.
fn carriers(corner: [f64; 3], rest: &[[f32; 3]], spacing: f64) -> Vec<(u32, f64)> {
    let away = |x: &[f32; 3]| norm(minus(x.map(f64::from), corner)) / (REACH * spacing);
    let near = rest.iter().enumerate().filter_map(|(p, x)| {
        let left = 1.0 - away(x).powi(2);
        (left > 0.0).then_some((p as u32, left.powi(3)))
    });
    let found: Vec<(u32, f64)> = near.collect();
    if found.len() > 3 {
        return found;
    }
    let nearest = (0..rest.len()).min_by(|a, b| away(&rest[*a]).total_cmp(&away(&rest[*b])));
    nearest.map(|p| vec![(p as u32, 1.0)]).unwrap_or_default()
}

/// Solves a symmetric positive system of three equations by Cramer's rule.
fn solved(m: [[f64; 3]; 3], b: [f64; 3]) -> [f64; 3] {
    let whole = dot(m[0], cross(m[1], m[2]));
    if whole == 0.0 {
        return [0.0; 3];
    }
    // rows and columns are alike
    let column = |k: usize| std::array::from_fn::<[f64; 3], 3, _>(|row| if row == k { b } else { m[row] });
    [0, 1, 2].map(|k| {
        let with = column(k);
        dot(with[0], cross(with[1], with[2])) / whole
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::Split;

    /// A closed mesh: its volume is that of the field, and every edge belongs to two triangles that run along it both ways.
    #[test]
    fn the_net_is_closed_and_holds_the_volume() {
        for number in [2, 7, 12] {
            let recipe = Recipe::draw(Split::Development, number, 7, None).unwrap();
            let (corners, triangles) = recipe.body.field().net();
            let volume: f64 = triangles
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|corner| corners[corner as usize]);
                    dot(a, cross(b, c)) / 6.0
                })
                .sum();
            let wanted = super::super::draw::volume(&recipe.body);
            assert!((volume / wanted - 1.0).abs() < 0.03, "{volume} of {wanted}");
            let mut edges = std::collections::BTreeMap::new();
            for [a, b, c] in triangles {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *edges.entry((from.min(to), from.max(to))).or_insert(0i32) += if from < to { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|sum| *sum == 0), "an edge is open");
        }
    }

    #[test]
    fn a_mesh_turns_and_stretches_with_its_particles() {
        let recipe = Recipe::draw(Split::Development, 2, 7, None).unwrap();
        let motion = super::super::motion::simulate(&recipe).unwrap();
        let rest = &motion.positions[0];
        let skin = Skin::of(&recipe, rest, motion.spacing);
        // a shear with a shift: affine, so that it is followed exactly
        let moved = |x: [f64; 3]| [x[0] + 0.3 * x[1] + 0.2, 1.1 * x[1] - 0.1 * x[2], x[2] - 0.4];
        let now: Vec<[f32; 3]> = rest.iter().map(|x| moved(x.map(f64::from)).map(|x| x as f32)).collect();
        let mesh = skin.carried(rest, &now);
        let off = skin.corners.iter().zip(&mesh.corners).map(|(from, to)| norm(minus(moved(*from), *to)));
        let far: Vec<f64> = off.collect();
        let mean = far.iter().sum::<f64>() / far.len() as f64;
        assert!(mean < 0.05 * motion.spacing, "{mean} m of {} m", motion.spacing);
    }
}
