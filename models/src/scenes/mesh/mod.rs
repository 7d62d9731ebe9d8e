//! Closed surfaces from files, and their interior.

mod obj;
pub(super) mod ply;
mod stl;

use std::collections::HashMap;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use crate::mesh_files;
use crate::vector::bounds;

/// A triangle mesh that encloses a volume: every edge is traversed equally often in both directions.
#[derive(Debug, Clone)]
pub struct Mesh {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Vertices and faces as read from a file; faces have three or more vertices.
#[derive(Debug, Clone, Default)]
pub(super) struct Surface {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

/// Maximum number of triangles of a mesh; each may have three vertices of its own.
const MOST_TRIANGLES: usize = 1 << 24;

impl Surface {
    /// Adds a vertex.
    fn add_vertex(&mut self, place: [f64; 3]) -> Result<()> {
        self.vertices.push(place);
        Self::check_count(self.vertices.len() / 3)
    }

    /// Adds a face of three or more vertices as a triangle fan.
    fn add_face(&mut self, corners: &[u32]) -> Result<()> {
        Self::check_count(self.triangles.len() + corners.len())?;
        for pair in corners[1..].windows(2) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
        Ok(())
    }

    /// Adds a triangle strip: each vertex forms a triangle with the two before it, with alternating orientation.
    fn add_strip(&mut self, corners: &[u32]) -> Result<()> {
        Self::check_count(self.triangles.len() + corners.len())?;
        for (index, three) in corners.windows(3).enumerate() {
            let [a, b, c] = [three[0], three[1], three[2]];
            self.triangles.push(if index % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
        Ok(())
    }

    fn check_count(count: usize) -> Result<()> {
        match count <= MOST_TRIANGLES {
            true => Ok(()),
            false => Err(damaged("the mesh has too many triangles or corners")
                .found(format!("{count} triangles or more, or three corners for each"))
                .wanted(format!("at most {MOST_TRIANGLES}"))
                .fix("simplify the mesh (Blender: the Decimate modifier)")),
        }
    }
}

/// An [`ErrorKind::Input`] about the contents of a file.
pub(super) fn damaged(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Input, what).fix("export the file again")
}

/// Hint on how file paths are resolved, for errors.
pub(super) const BESIDE: &str = "the path is relative to the scene file";

impl Mesh {
    /// Reads a file whose format follows from its extension: `.obj`, `.ply` or `.stl`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a missing or damaged file, an unknown format, or a surface that is not closed.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = mesh_files::read(path, "the mesh", BESIDE)?;
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        Self::from_bytes(&bytes, &ending).map_err(|e| e.within(path.display()))
    }

    /// Reads a file in memory; `ending` is `obj`, `ply` or `stl`.
    ///
    /// # Errors
    /// As [`Mesh::read`].
    pub fn from_bytes(bytes: &[u8], ending: &str) -> Result<Self> {
        let surface = match ending {
            "obj" => obj::read(bytes)?,
            "ply" => ply::solid(bytes)?,
            "stl" => stl::read(bytes)?,
            other => {
                return Err(Error::new(ErrorKind::Input, "this is no kind of mesh that can be read")
                    .found(format!("the ending `.{other}`"))
                    .wanted("`.obj`, `.ply` or `.stl`")
                    .fix("export the mesh in one of these formats"));
            }
        };
        Self::of_surface(&surface)
    }

    /// Merges coincident vertices, drops degenerate triangles, and checks that the surface is closed.
    pub(super) fn of_surface(surface: &Surface) -> Result<Self> {
        let finite = |x: &[f64; 3]| x.iter().all(|x| x.is_finite());
        if let Some(at) = surface.vertices.iter().position(|x| !finite(x)) {
            let found = format!("{:?}", surface.vertices[at]);
            return Err(damaged("a corner of the mesh has no place").at(format!("vertex {at}")).found(found));
        }
        let mut places: HashMap<[u64; 3], u32> = HashMap::new();
        let mut vertices = Vec::new();
        let joined: Vec<u32> = surface
            .vertices
            .iter()
            .map(|x| {
                // adding zero merges −0 and +0
                *places.entry(x.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                    vertices.push(*x);
                    vertices.len() as u32 - 1
                })
            })
            .collect();
        let mut triangles = Vec::with_capacity(surface.triangles.len());
        for (index, triangle) in surface.triangles.iter().enumerate() {
            if let Some(&corner) = triangle.iter().find(|&&corner| corner as usize >= joined.len()) {
                return Err(damaged("a face of the mesh names a corner that there is not")
                    .at(format!("triangle {index}"))
                    .found(format!("corner {corner}"))
                    .wanted(format!("less than {}", joined.len())));
            }
            let [a, b, c] = triangle.map(|corner| joined[corner as usize]);
            if a != b && b != c && c != a {
                triangles.push([a, b, c]);
            }
        }
        let mesh = Self { vertices, triangles };
        mesh.check_closed()?;
        Ok(mesh)
    }

    /// Checks that every edge is traversed equally often in both directions, so that every point is either inside
    /// or outside.
    fn check_closed(&self) -> Result<()> {
        if self.triangles.is_empty() {
            return Err(damaged("the mesh has no faces").wanted("a closed surface of triangles"));
        }
        let mut balance: HashMap<(u32, u32), (i32, u32)> = HashMap::new();
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let entry = balance.entry((a.min(b), a.max(b))).or_default();
                entry.0 += if a < b { 1 } else { -1 };
                entry.1 += 1;
            }
        }
        let mut open: Vec<(u32, u32)> = balance.iter().filter(|(_, e)| e.0 != 0).map(|(&edge, _)| edge).collect();
        open.sort_unstable();
        let Some(&(a, b)) = open.first() else { return Ok(()) };
        let flipped = balance[&(a, b)].1.is_multiple_of(2);
        let place = |v: u32| format!("{:.4?}", self.vertices[v as usize]);
        let what = if flipped { "faces of the mesh look different ways" } else { "the mesh has holes" };
        let kind = if flipped { "edges between such faces" } else { "open edges" };
        Err(Error::new(ErrorKind::Input, what)
            .at(format!("the edge from {} to {}", place(a), place(b)))
            .found(format!("{} {kind}", open.len()))
            .wanted("a closed surface: every edge between two faces that are wound the same way")
            .fix("close the holes and recalculate the normals in the modelling program (Blender: 3D Print Toolbox, Make Manifold)"))
    }

    /// The mesh scaled and then translated \[m\].
    #[must_use]
    pub fn placed(mut self, scale: f64, translate: [f64; 3]) -> Self {
        for x in &mut self.vertices {
            *x = std::array::from_fn(|axis| scale * x[axis] + translate[axis]);
        }
        self
    }

    /// Minimum and maximum coordinates \[m\].
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        bounds(self.triangles.iter().flatten().map(|&corner| self.vertices[corner as usize]))
    }

    /// The enclosed volume \[m³\]; negative if the faces point inwards.
    pub fn volume(&self) -> f64 {
        let corner = |v: u32| self.vertices[v as usize];
        let six: f64 = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(corner);
                a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            })
            .sum();
        six / 6.0
    }

    /// Intersections of the vertical line through `(x, z)` with the surface: heights \[m\] in ascending order, each
    /// with the change of the winding number.
    ///
    /// A line through an edge or vertex crosses exactly one of the adjacent triangles: edges belong to the side of
    /// greater x, and both triangles compute the same position on the edge.
    pub fn crossings(&self, x: f64, z: f64, triangles: &[u32]) -> Vec<(f64, i32)> {
        let mut found = Vec::new();
        for &index in triangles {
            let corners = self.triangles[index as usize].map(|corner| self.vertices[corner as usize]);
            let mut winding = 0;
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if (a[2] <= z) != (b[2] <= z) {
                    // the same arithmetic for both directions of the edge
                    let (low, high) = if a[2] <= b[2] { (a, b) } else { (b, a) };
                    let at = low[0] + (z - low[2]) / (high[2] - low[2]) * (high[0] - low[0]);
                    if x < at {
                        winding += if b[2] > a[2] { 1 } else { -1 };
                    }
                }
            }
            if winding != 0 {
                found.push((height(corners, x, z), winding));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }

    /// For each vertical line of the raster `first + k·step` in x and z, the triangles that may intersect it.
    pub(super) fn columns(&self, first: [f64; 2], step: [f64; 2], counts: [usize; 2]) -> Vec<Vec<u32>> {
        let mut columns = vec![Vec::new(); counts[0] * counts[1]];
        for (index, triangle) in self.triangles.iter().enumerate() {
            let corners = triangle.map(|corner| self.vertices[corner as usize]);
            let span = |axis: usize| {
                let (first, step, count) = (first[axis / 2], step[axis / 2], counts[axis / 2]);
                let low = corners.iter().map(|x| x[axis]).fold(f64::INFINITY, f64::min);
                let high = corners.iter().map(|x| x[axis]).fold(f64::NEG_INFINITY, f64::max);
                // A float to integer cast saturates.
                let from = (((low - first) / step).floor().max(0.0) as usize).min(count);
                from..(((high - first) / step).ceil().max(0.0) as usize + 1).min(count)
            };
            for i in span(0) {
                for k in span(2) {
                    columns[i * counts[1] + k].push(index as u32);
                }
            }
        }
        columns
    }
}

/// Height of a triangle's plane on the vertical line through `(x, z)`.
fn height([a, b, c]: [[f64; 3]; 3], x: f64, z: f64) -> f64 {
    let (u, v) = ([b[0] - a[0], b[2] - a[2]], [c[0] - a[0], c[2] - a[2]]);
    let area = u[0] * v[1] - u[1] * v[0];
    let p = [x - a[0], z - a[2]];
    let (s, t) = ((p[0] * v[1] - p[1] * v[0]) / area, (u[0] * p[1] - u[1] * p[0]) / area);
    a[1] + s * (b[1] - a[1]) + t * (c[1] - a[1])
}
