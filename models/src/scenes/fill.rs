//! Seeding: particles that fill a shape, one per cell of a grid with jitter.

use std::collections::HashSet;
use std::f64::consts::PI;
use std::path::Path;

use gradreel::io::npy;
use gradreel::{Error, ErrorKind, Key, Result};

use super::file::Shape;
use super::mesh::{BESIDE, Mesh, ply};
use crate::mesh_files;
use crate::text::unmarked;

/// Maximum number of grid cells scanned per shape.
const MOST_CELLS: f64 = 2e8;
/// Maximum offset of a particle from its cell's centre, in cells; bounded to keep neighbours apart.
const JITTER: f64 = 0.25;

/// Maximum number of cells scanned per shape on a refined grid; see [`sample`].
const MOST_FINE_CELLS: usize = 20_000_000;
/// Maximum number of grid refinements by two. The grid is refined while its volume deviates from the shape's by
/// more than a share of [`MISSED`].
const MOST_HALVINGS: usize = 3;
const MISSED: f64 = 0.25;
/// Minimum number of cells along each axis for counting a volume without a closed formula.
const COUNTED: usize = 48;

/// A shape made of particles.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Particle positions \[m\].
    pub positions: Vec<[f64; 3]>,
    /// Volume of each particle \[m³\]; the sum equals the volume of the shape.
    pub volume: f64,
    /// Refinement factor of the spacing along each axis, which gives small or thin shapes enough particles.
    pub finer: usize,
}

/// The particles of a shape \[m\] with a given `spacing` \[m\]; files are relative to `folder`, that of the scene.
///
/// ```
/// use gradreel_models::scenes::{Shape, fill};
///
/// let ball = Shape::Sphere { centre_m: [0.0, 1.0, 0.0], radius_m: 0.2 };
/// let particles = fill(&ball, 0.02, 7, std::path::Path::new("."))?;
/// let volume = particles.len() as f64 * 0.02_f64.powi(3);
/// assert!((volume / (4.0 / 3.0 * std::f64::consts::PI * 0.008) - 1.0).abs() < 0.02);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// As [`body`].
pub fn fill(shape: &Shape, spacing: f64, seed: u64, folder: &Path) -> Result<Vec<[f64; 3]>> {
    body(shape, spacing, seed, folder).map(|body| body.positions)
}

/// The particles of a shape as made by [`fill`], with their volume: an equal share of the shape's volume at any
/// grid spacing. If the grid is too coarse for the shape, a finer one is used.
///
/// Particles from a file have the volume `spacing³` each; where several occupy a cube of that size, they share its
/// volume.
///
/// ```
/// use gradreel_models::scenes::{Shape, body};
///
/// // much smaller than the spacing
/// let ball = Shape::Sphere { centre_m: [0.0, 1.0, 0.0], radius_m: 0.005 };
/// let body = body(&ball, 0.02, 7, std::path::Path::new("."))?;
/// let volume = body.positions.len() as f64 * body.volume;
/// assert!((volume / (4.0 / 3.0 * std::f64::consts::PI * 0.005_f64.powi(3)) - 1.0).abs() < 1e-12);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// [`ErrorKind::Input`] for a shape without volume, too small to hold a particle or too large for the grid, and for
/// unusable files.
pub fn body(shape: &Shape, spacing: f64, seed: u64, folder: &Path) -> Result<Body> {
    let body = match shape {
        Shape::Particles { file, scale, translate_m } => {
            check_sizes(&[*scale], "scale")?;
            let positions = read_particles(&folder.join(file), *scale, *translate_m)?;
            let volume = crowded(&positions, spacing) * spacing.powi(3);
            Body { positions, volume, finer: 1 }
        }
        Shape::Mesh { file, scale, translate_m } => {
            check_sizes(&[*scale], "scale")?;
            let mesh = Mesh::read(&folder.join(file))?.placed(*scale, *translate_m);
            let simple = std::cell::Cell::new(true);
            let cells = Cells::covering(mesh.bounds(), spacing)?;
            let inside = |cells: &Cells| {
                let (particles, plain) = fill_mesh(&mesh, cells, seed);
                simple.set(simple.get() && plain);
                particles
            };
            // overlapping parts would count twice
            let whole = || simple.get().then(|| mesh.volume().abs());
            sample(cells, &whole, &inside)?
        }
        primitive => {
            let (centre, half) = extent(primitive)?;
            let bounds = [-1.0, 1.0].map(|side| std::array::from_fn(|axis| centre[axis] + side * half[axis]));
            let cells = Cells::covering(bounds, spacing)?;
            sample(cells, &|| volume(primitive), &|cells| fill_primitive(primitive, centre, cells, seed))?
        }
    };
    if body.positions.is_empty() {
        return Err(Error::new(ErrorKind::Input, "the shape holds no particle")
            .found(format!("particles {spacing:.4e} m apart"))
            .wanted("a shape at least as large as that in every direction")
            .fix("make the shape larger, or grid.spacing_m smaller; a mesh may be in other units: see its scale"));
    }
    Ok(body)
}

/// Volume factor of particles from a file: below one where cubes hold more than two particles on average.
fn crowded(positions: &[[f64; 3]], spacing: f64) -> f64 {
    let cubes: HashSet<[i64; 3]> = positions.iter().map(|x| x.map(|x| (x / spacing).floor() as i64)).collect();
    let share = cubes.len() as f64 / positions.len().max(1) as f64;
    if share < 0.5 { share } else { 1.0 }
}

/// Particles inside a shape of this volume, which is counted on a fine grid if unknown: one per cell, on a refined
/// grid where the given one is too coarse for the shape.
fn sample(
    mut cells: Cells,
    volume: &dyn Fn() -> Option<f64>,
    inside: &dyn Fn(&Cells) -> Vec<[f64; 3]>,
) -> Result<Body> {
    let mut positions = inside(&cells);
    let whole = volume().unwrap_or_else(|| {
        let counted = Cells { counts: cells.counts.map(|n| n * COUNTED.div_ceil(n)), ..cells };
        inside(&counted).len() as f64 * counted.volume()
    });
    if !(whole > 0.0 && whole.is_finite()) {
        return Err(Error::new(ErrorKind::Input, "the shape has no volume")
            .found(format!("{whole:?} m³"))
            .wanted("a positive number")
            .fix(
                "make the shape larger, or put it nearer to the origin; a mesh may be in other units: see its scale",
            ));
    }
    let mut finer = 1;
    for _ in 0..MOST_HALVINGS {
        let found = positions.len() as f64 * cells.volume();
        if (found / whole - 1.0).abs() <= MISSED || 8 * cells.len() > MOST_FINE_CELLS {
            break;
        }
        cells.counts = cells.counts.map(|n| 2 * n);
        finer *= 2;
        positions = inside(&cells);
    }
    let volume = whole / positions.len() as f64;
    Ok(Body { positions, volume, finer })
}

/// A box of cells.
#[derive(Clone, Copy)]
struct Cells {
    bounds: [[f64; 3]; 2],
    counts: [usize; 3],
}

impl Cells {
    /// Cells that cover `bounds`: each axis is divided into equal parts of about `spacing`.
    fn covering(bounds: [[f64; 3]; 2], spacing: f64) -> Result<Self> {
        let [low, high] = bounds;
        let counts: [f64; 3] = std::array::from_fn(|axis| ((high[axis] - low[axis]) / spacing).round().max(1.0));
        let cells: f64 = counts.iter().product();
        if cells > MOST_CELLS {
            return Err(Error::new(ErrorKind::Input, "the shape is too large for this grid")
                .found(format!("{cells:.2e} cells of {spacing:.4e} m in the box around it"))
                .wanted(format!("at most {MOST_CELLS:.0e}"))
                .fix("raise grid.spacing_m, or make the shape smaller; a mesh may be in other units: see its scale"));
        }
        Ok(Self { bounds, counts: counts.map(|n| n as usize) })
    }

    /// The length of a cell along an axis \[m\].
    fn edge(&self, axis: usize) -> f64 {
        let [low, high] = self.bounds;
        (high[axis] - low[axis]) / self.counts[axis] as f64
    }

    /// The volume of a cell \[m³\].
    fn volume(&self) -> f64 {
        (0..3).map(|axis| self.edge(axis)).product()
    }

    fn at(&self, axis: usize, index: usize, jitter: f64) -> f64 {
        self.bounds[0][axis] + (index as f64 + 0.5 + jitter) * self.edge(axis)
    }

    fn len(&self) -> usize {
        self.counts.iter().product()
    }
}

/// One jitter vector per cell.
fn offsets(seed: u64, cells: usize) -> impl Iterator<Item = [f64; 3]> {
    let mut numbers = Key::new(seed).uniform(3 * cells).map(|u| 2.0 * JITTER * (u - 0.5));
    std::iter::from_fn(move || Some([numbers.next()?, numbers.next()?, numbers.next()?]))
}

fn fill_primitive(shape: &Shape, centre: [f64; 3], cells: &Cells, seed: u64) -> Vec<[f64; 3]> {
    let [_, ny, nz] = cells.counts;
    let places = offsets(seed, cells.len()).enumerate().map(|(cell, jitter)| {
        let index = [cell / (ny * nz), cell / nz % ny, cell % nz];
        std::array::from_fn(|axis| cells.at(axis, index[axis], jitter[axis]))
    });
    places.filter(|&x: &[f64; 3]| holds(shape, std::array::from_fn(|axis| x[axis] - centre[axis]))).collect()
}

/// The volume of a primitive \[m³\]; `None` for a self-intersecting torus.
fn volume(shape: &Shape) -> Option<f64> {
    match *shape {
        Shape::Box { size_m: [x, y, z], .. } => Some(x * y * z),
        Shape::Sphere { radius_m, .. } => Some(4.0 / 3.0 * PI * radius_m.powi(3)),
        Shape::Cylinder { radius_m, height_m, .. } => Some(PI * radius_m * radius_m * height_m),
        Shape::Cone { radius_m, height_m, .. } => Some(PI * radius_m * radius_m * height_m / 3.0),
        Shape::Torus { ring_radius_m, tube_radius_m, .. } => {
            (tube_radius_m <= ring_radius_m).then_some(2.0 * PI * PI * ring_radius_m * tube_radius_m * tube_radius_m)
        }
        Shape::Mesh { .. } | Shape::Particles { .. } => None,
    }
}

/// Centre and half edge lengths of the bounding box of a primitive.
fn extent(shape: &Shape) -> Result<([f64; 3], [f64; 3])> {
    Ok(match *shape {
        Shape::Box { centre_m, size_m } => {
            check_sizes(&size_m, "size_m")?;
            (centre_m, size_m.map(|s| s / 2.0))
        }
        Shape::Sphere { centre_m, radius_m } => {
            check_sizes(&[radius_m], "radius_m")?;
            (centre_m, [radius_m; 3])
        }
        Shape::Cylinder { centre_m, radius_m, height_m } | Shape::Cone { centre_m, radius_m, height_m } => {
            check_sizes(&[radius_m, height_m], "radius_m and height_m")?;
            (centre_m, [radius_m, height_m / 2.0, radius_m])
        }
        Shape::Torus { centre_m, ring_radius_m, tube_radius_m } => {
            check_sizes(&[ring_radius_m, tube_radius_m], "ring_radius_m and tube_radius_m")?;
            let outer = ring_radius_m + tube_radius_m;
            (centre_m, [outer, tube_radius_m, outer])
        }
        Shape::Mesh { .. } | Shape::Particles { .. } => ([0.0; 3], [0.0; 3]),
    })
}

/// Whether a primitive contains a point, given relative to its centre.
fn holds(shape: &Shape, x: [f64; 3]) -> bool {
    let from_axis = x[0].hypot(x[2]);
    match *shape {
        Shape::Box { size_m, .. } => (0..3).all(|axis| x[axis].abs() <= size_m[axis] / 2.0),
        Shape::Sphere { radius_m, .. } => from_axis.hypot(x[1]) <= radius_m,
        Shape::Cylinder { radius_m, height_m, .. } => from_axis <= radius_m && x[1].abs() <= height_m / 2.0,
        Shape::Cone { radius_m, height_m, .. } => {
            let up = x[1] / height_m + 0.5;
            (0.0..=1.0).contains(&up) && from_axis <= radius_m * (1.0 - up)
        }
        Shape::Torus { ring_radius_m, tube_radius_m, .. } => (from_axis - ring_radius_m).hypot(x[1]) <= tube_radius_m,
        Shape::Mesh { .. } | Shape::Particles { .. } => false,
    }
}

/// Cells whose centres have a nonzero winding number, counted along vertical lines, and whether the winding number
/// took no more than two adjacent values, which excludes overlapping parts.
fn fill_mesh(mesh: &Mesh, cells: &Cells, seed: u64) -> (Vec<[f64; 3]>, bool) {
    let [nx, ny, nz] = cells.counts;
    let first = [cells.at(0, 0, 0.0), cells.at(2, 0, 0.0)];
    let columns = mesh.columns(first, [cells.edge(0), cells.edge(2)], [nx, nz]);
    let mut jitter = offsets(seed, cells.len());
    let (mut particles, mut lowest, mut highest) = (Vec::new(), 0, 0);
    for (column, triangles) in columns.iter().enumerate() {
        let (i, k) = (column / nz, column % nz);
        let crossings = mesh.crossings(cells.at(0, i, 0.0), cells.at(2, k, 0.0), triangles);
        let (mut passed, mut winding) = (0, 0);
        for j in 0..ny {
            let offset = jitter.next().unwrap_or_default();
            while passed < crossings.len() && crossings[passed].0 <= cells.at(1, j, 0.0) {
                winding += crossings[passed].1;
                passed += 1;
            }
            if winding != 0 {
                particles.push([(0, i), (1, j), (2, k)].map(|(axis, n)| cells.at(axis, n, offset[axis])));
            }
            (lowest, highest) = (lowest.min(winding), highest.max(winding));
        }
    }
    (particles, highest - lowest <= 1)
}

fn read_particles(path: &Path, scale: f64, translate: [f64; 3]) -> Result<Vec<[f64; 3]>> {
    let bytes = mesh_files::read(path, "the particles", BESIDE)?;
    let positions = positions_of(&bytes).map_err(|e| e.within(path.display()))?;
    Ok(positions.iter().map(|x| std::array::from_fn(|axis| scale * x[axis] + translate[axis])).collect())
}

/// The positions in a PLY file, or in an npy file of shape `[n, 3]`.
///
/// # Errors
/// [`ErrorKind::Input`] for another or a damaged file, [`ErrorKind::NonFinite`] for a position that is not finite.
pub fn positions_of(bytes: &[u8]) -> Result<Vec<[f64; 3]>> {
    let positions = if unmarked(bytes).starts_with(b"ply") {
        ply::read(bytes)?.vertices
    } else if bytes.starts_with(b"\x93NUMPY") {
        let array = npy::from_bytes(bytes)?;
        if array.dims().len() != 2 || array.dims()[1] != 3 {
            return Err(Error::new(ErrorKind::Input, "the array has the wrong shape")
                .found(array.shape())
                .wanted("[n, 3]"));
        }
        array.to_vec()?.as_chunks().0.to_vec()
    } else {
        return Err(
            Error::new(ErrorKind::Input, "this is no particle file").wanted("a PLY file, or npy of shape [n, 3]")
        );
    };
    if let Some(p) = positions.iter().position(|x| !x.iter().all(|x| x.is_finite())) {
        let error = Error::new(ErrorKind::NonFinite, "a particle of the file has no place").at(format!("particle {p}"));
        return Err(error.found(format!("{:?}", positions[p])).wanted("finite coordinates"));
    }
    Ok(positions)
}

fn check_sizes(sizes: &[f64], name: &str) -> Result<()> {
    if sizes.iter().all(|&size| size > 0.0 && size.is_finite()) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "a shape has no size")
        .at(name)
        .found(format!("{sizes:?}"))
        .wanted("positive numbers"))
}
