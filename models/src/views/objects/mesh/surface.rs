//! Mesh contents of a file, validated and prepared for ray casting.

use gradreel::Result;

use super::bvh::Bvh;
use super::paint::Paint;
use super::{TexturedMesh, Triangle, Vertex, damaged};
use crate::vector::{bounds, cross, dot, minus};

/// Maximum number of triangles of a mesh.
pub(super) const MOST_TRIANGLES: usize = 2_000_000;
/// Maximum coordinate, which keeps fourth powers of differences finite.
const FAR: f64 = 1e60;

/// Corners and faces in file coordinates, y up.
#[derive(Default)]
pub(super) struct Surface {
    pub corners: Vec<Corner>,
    pub triangles: Vec<Triangle>,
    pub paints: Vec<Paint>,
}

/// A [`Vertex`] before the transformation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub place: [f64; 3],
    pub normal: [f32; 3],
    pub uv: [f32; 2],
    pub colour: [f32; 3],
}

impl Surface {
    /// Rejects too many triangles.
    pub fn check_count(count: usize) -> Result<()> {
        match count <= MOST_TRIANGLES {
            true => Ok(()),
            false => Err(damaged("the mesh has too many triangles or corners")
                .found(format!("{count} or more"))
                .wanted(format!("at most {MOST_TRIANGLES}, with three corners each"))
                .fix("simplify the mesh (Blender: the Decimate modifier)")),
        }
    }

    /// The mesh in the model's axes, with its box centred at the origin and invisible triangles removed.
    pub fn into_mesh(self) -> Result<TexturedMesh> {
        Self::check_count(self.triangles.len())?;
        let Self { corners, mut triangles, paints } = self;
        let all = triangles.len();
        for (index, corner) in
            triangles.iter().enumerate().flat_map(|(index, t)| t.corners.map(|corner| (index, corner)))
        {
            let corner = corners.get(corner as usize).ok_or_else(|| {
                damaged("a face of the mesh names a corner that there is not")
                    .found(format!("corner {corner}"))
                    .wanted(format!("less than {}", corners.len()))
            });
            corner.and_then(Corner::check).map_err(|e| e.at(format!("triangle {index}")))?;
        }
        let transparent = |paint: &Paint| paint.picture.is_none() && paint.cutoff > 1.0;
        triangles.retain(|triangle| {
            let flat = !has_area(triangle.corners.map(|corner| corners[corner as usize].place));
            !flat && !transparent(&paints[triangle.paint as usize])
        });
        if triangles.is_empty() {
            return Err(damaged("the mesh has no faces that can be seen")
                .found(format!("{all} triangles, none with an area and a colour"))
                .wanted("at least one")
                .fix("export the surface of the object, not its points or curves alone"));
        }
        let (mut places, mut kept) = (vec![u32::MAX; corners.len()], Vec::new());
        for corner in triangles.iter_mut().flat_map(|triangle| &mut triangle.corners) {
            let place = &mut places[*corner as usize];
            if *place == u32::MAX {
                *place = kept.len() as u32;
                kept.push(corners[*corner as usize]);
            }
            *corner = *place;
        }
        let [low, high] = bounds(kept.iter().map(|corner| corner.place));
        let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        let middle = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        let moved = |corner: &Corner| -> Vertex {
            let place = [0, 1, 2].map(|axis| (corner.place[axis] - middle[axis]) / longest);
            let upright = |[x, y, z]: [f32; 3]| [x, -z, y];
            let Corner { normal, uv, colour, .. } = *corner;
            let colour = colour.map(|c| c.clamp(0.0, 1.0));
            // treated as missing
            let normal = if normal.iter().all(|x| x.is_finite()) { normal } else { [0.0; 3] };
            Vertex { place: upright(place.map(|x| x as f32)), normal: upright(normal), uv, colour }
        };
        let vertices: Vec<Vertex> = kept.iter().map(moved).collect();
        let places = |triangle: &Triangle| triangle.corners.map(|corner| vertices[corner as usize].place);
        let tree = Bvh::new(&triangles.iter().map(places).collect::<Vec<_>>());
        Ok(TexturedMesh { tree, vertices, triangles, paints })
    }
}

impl Corner {
    /// Rejects non-finite values, and coordinates so large that areas overflow.
    fn check(&self) -> Result<()> {
        let finite = |values: &[f32]| values.iter().all(|x| x.is_finite());
        let (what, found) = match self {
            _ if !self.place.iter().all(|x| x.abs() <= FAR) => ("place", format!("{:?}", self.place)),
            _ if !finite(&self.uv) => ("place in the texture", format!("{:?}", self.uv)),
            _ if !finite(&self.colour) => ("colour", format!("{:?}", self.colour)),
            _ => return Ok(()),
        };
        Err(damaged(format!("a corner of the mesh has no {what}")).found(found).wanted("finite numbers"))
    }
}

fn has_area([a, b, c]: [[f64; 3]; 3]) -> bool {
    let normal = cross(minus(b, a), minus(c, a));
    dot(normal, normal) > 0.0
}
