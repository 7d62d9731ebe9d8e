//! Textured meshes from files, closed or not, and their intersection with rays.
//!
//! Lengths are relative to the longest side of the mesh's box, which is centred at the origin; axes are the
//! model's, z up. Files are y up: their (x, y, z) becomes (x, −z, y).

mod beside;
mod bvh;
mod gltf;
mod mtl;
mod obj;
mod paint;
mod surface;
mod turned;

use std::fmt::Display;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

pub(super) use turned::Turned;

use self::beside::Beside;
pub(crate) use self::bvh::Bvh;
use self::paint::Paint;
use crate::mesh_files;
use crate::vector::{cross, dot, minus};

/// Extensions of supported files.
pub(super) const ENDINGS: [&str; 3] = ["obj", "glb", "gltf"];
/// Tolerance beyond a triangle's edges, relative to its sides: a ray through a shared edge must not miss both
/// triangles.
const EDGE: f64 = 1e-9;

/// Triangles with colours, from an OBJ, GLB or glTF file.
pub struct TexturedMesh {
    vertices: Vec<Vertex>,
    triangles: Vec<Triangle>,
    paints: Vec<Paint>,
    tree: Bvh,
}

/// A vertex.
#[derive(Debug, Clone, Copy)]
struct Vertex {
    place: [f32; 3],
    /// Zero if the file has none.
    normal: [f32; 3],
    /// Texture coordinates in widths and heights of the picture, from its upper left corner.
    uv: [f32; 2],
    /// Factor of the picture's colour, in display (non-linear) values.
    colour: [f32; 3],
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corners: [u32; 3],
    paint: u32,
}

/// Intersection with a triangle: distance along the ray, and barycentric coordinates of the second and third
/// corner.
#[derive(Clone, Copy)]
struct Crossing {
    triangle: u32,
    t: f64,
    shares: [f64; 2],
}

impl TexturedMesh {
    /// Reads a file whose format follows from its extension: `.obj` (with its `.mtl` and textures), `.glb` or
    /// `.gltf`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is missing, damaged, without faces or too large, or that refers to a
    /// file that is missing or outside its own folder.
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_inside(path, path.display())
    }

    /// As [`TexturedMesh::read`], with another name of the file for errors.
    pub(super) fn read_inside(path: &Path, name: impl Display) -> Result<Self> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        let bytes = mesh_files::read(path, "the mesh", "check the path").map_err(|e| e.at(&name))?;
        Self::from_bytes(&bytes, &ending, folder).map_err(|e| e.within(name))
    }

    /// Reads a file in memory; `ending` is `obj`, `glb` or `gltf`, and `folder` contains the files that it refers
    /// to.
    ///
    /// # Errors
    /// As [`TexturedMesh::read`].
    pub fn from_bytes(bytes: &[u8], ending: &str, folder: &Path) -> Result<Self> {
        let beside = Beside::of(folder);
        match ending {
            "obj" => obj::read(bytes, &beside)?,
            "glb" | "gltf" => gltf::read(bytes, &beside)?,
            other => {
                return Err(Error::new(ErrorKind::Input, "this is no kind of textured mesh that can be read")
                    .found(format!("the ending `.{other}`"))
                    .wanted("`.obj`, `.glb` or `.gltf`")
                    .fix("export the object in one of these formats"));
            }
        }
        .into_mesh()
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Approximate memory \[bytes\].
    pub fn bytes(&self) -> usize {
        let pictures: usize = self.paints.iter().map(Paint::bytes).sum();
        size_of_val(&*self.vertices) + size_of_val(&*self.triangles) + self.tree.bytes() + pictures
    }

    /// Places of the corners of all triangles, three for each, and their colours as a screen shows them, 0 to 1.
    pub(crate) fn corners(&self) -> impl Iterator<Item = ([f32; 3], [f32; 3])> {
        self.triangles.iter().flat_map(move |triangle| {
            triangle.corners.map(|corner| {
                let Vertex { place, uv, colour, .. } = self.vertices[corner as usize];
                let picture = self.paints[triangle.paint as usize].colour(uv.map(f64::from));
                (place, std::array::from_fn(|c| colour[c] * picture[c] as f32))
            })
        })
    }

    fn places(&self, triangle: Triangle) -> [[f64; 3]; 3] {
        triangle.corners.map(|corner| self.vertices[corner as usize].place.map(f64::from))
    }

    /// The first opaque intersection of a ray; of several at the same distance, that with the first triangle in the
    /// file.
    fn first(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Crossing> {
        let mut best: Option<Crossing> = None;
        self.tree.visit(origin, along, |index| {
            let triangle = self.triangles[index as usize];
            if let Some((t, shares)) = crossed(self.places(triangle), origin, along) {
                let sooner = best.is_none_or(|best| t < best.t || (t == best.t && index < best.triangle));
                let found = Crossing { triangle: index, t, shares };
                if sooner && self.paints[triangle.paint as usize].covers(self.uv(found)) {
                    best = Some(found);
                }
            }
            best.map_or(f64::INFINITY, |best| best.t)
        });
        best
    }

    /// A vertex attribute, interpolated at an intersection.
    fn mean<const N: usize>(&self, at: Crossing, of: impl Fn(&Vertex) -> [f32; N]) -> [f64; N] {
        let corners = self.triangles[at.triangle as usize].corners.map(|corner| of(&self.vertices[corner as usize]));
        let [second, third] = at.shares;
        let shares = [1.0 - second - third, second, third];
        std::array::from_fn(|i| (0..3).map(|corner| shares[corner] * f64::from(corners[corner][i])).sum())
    }

    fn uv(&self, at: Crossing) -> [f64; 2] {
        self.mean(at, |vertex| vertex.uv)
    }

    /// The colour at an intersection.
    fn colour(&self, at: Crossing) -> [f64; 3] {
        let picture = self.paints[self.triangles[at.triangle as usize].paint as usize].colour(self.uv(at));
        let own = self.mean(at, |vertex| vertex.colour);
        std::array::from_fn(|c| own[c] * picture[c])
    }

    /// Unit normal at an intersection, facing the ray's origin; interpolated if the file has vertex normals.
    fn normal(&self, at: Crossing, along: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.places(self.triangles[at.triangle as usize]);
        let flat = turned_against(along, cross(minus(b, a), minus(c, a)));
        let smooth = self.mean(at, |vertex| vertex.normal);
        let chosen = if dot(smooth, smooth) > 1e-6 { turned_against(flat.map(|x| -x), smooth) } else { flat };
        let norm = dot(chosen, chosen).sqrt().max(f64::MIN_POSITIVE);
        chosen.map(|x| x / norm)
    }
}

/// `x` or `−x`, whichever points against `other`.
fn turned_against(other: [f64; 3], x: [f64; 3]) -> [f64; 3] {
    if dot(other, x) > 0.0 { x.map(|x| -x) } else { x }
}

/// Two-sided ray–triangle intersection (Möller and Trumbore 1997): distance, and barycentric coordinates of the
/// second and third corner.
pub(crate) fn crossed([a, b, c]: [[f64; 3]; 3], origin: [f64; 3], along: [f64; 3]) -> Option<(f64, [f64; 2])> {
    let (to_b, to_c) = (minus(b, a), minus(c, a));
    let across = cross(along, to_c);
    let volume = dot(to_b, across);
    if volume == 0.0 {
        return None;
    }
    let from = minus(origin, a);
    let second = dot(from, across) / volume;
    let over = cross(from, to_b);
    let third = dot(along, over) / volume;
    let t = dot(to_c, over) / volume;
    let inside = second >= -EDGE && third >= -EDGE && second + third <= 1.0 + EDGE;
    (inside && t > 0.0).then_some((t, [second, third]))
}

/// An [`ErrorKind::Input`] about the contents of a file.
fn damaged(what: impl Into<String>) -> Error {
    Error::new(ErrorKind::Input, what).fix("export the object again")
}
