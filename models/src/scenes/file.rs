//! The scene file: its keys, and errors that name the offending key.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::film::FilmSettings;
use crate::nearest::suggestion;
use crate::text;

/// The contents of a scene file. Keys with a unit carry it in their name; material parameters are in the SI units
/// of the law's own table (Pa, Pa s; degrees for angles of friction).
///
/// ```
/// use gradreel_models::scenes::SceneFile;
///
/// let scene = SceneFile::parse(
///     r#"
///     [time]
///     duration_s = 0.5
///     [grid]
///     spacing_m = 0.04
///     [ground]
///     [materials.rubber]
///     law = "neo_hookean"
///     density_kg_m3 = 1000.0
///     young = 1e5     # Pa
///     poisson = 0.3
///     [[objects]]
///     material = "rubber"
///     shape.sphere = { centre_m = [0.0, 0.3, 0.0], radius_m = 0.1 }
///     "#,
/// )?;
/// assert_eq!(scene.objects.len(), 1);
/// let error = SceneFile::parse("[time]\nduration_s = 1.0\nframes_per_second = 24").unwrap_err();
/// assert!(error.to_string().contains("frames_per_s"), "{error}");
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// One-line description.
    #[serde(default)]
    pub title: String,
    /// Duration, frames and substeps.
    pub time: Time,
    /// The background grid and the particles.
    pub grid: Grid,
    /// Gravity and bounds.
    #[serde(default)]
    pub world: Surroundings,
    /// A horizontal floor, if there is one.
    #[serde(default)]
    pub ground: Option<Ground>,
    /// Other obstacles.
    #[serde(default)]
    pub colliders: Vec<Obstacle>,
    /// Materials by the names used in `objects`.
    #[serde(default)]
    pub materials: BTreeMap<String, Substance>,
    /// The simulated bodies.
    #[serde(default)]
    pub objects: Vec<Object>,
    /// Viewpoint of the rendered picture.
    #[serde(default)]
    pub camera: Camera,
    /// A ring of cameras that render a clip, if any.
    #[serde(default)]
    pub film: Option<FilmSettings>,
}

/// Duration, frames and substeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Simulated time \[s\].
    pub duration_s: f64,
    /// Frames written per second.
    #[serde(default = "defaults::frames_per_s")]
    pub frames_per_s: f64,
    /// Substeps between two frames; derived from the speeds of sound and of the particles if omitted.
    #[serde(default)]
    pub substeps_per_frame: Option<usize>,
    /// CFL number of derived substeps: the share of a cell that sound and particles may cross per substep.
    #[serde(default = "defaults::cfl")]
    pub cfl: f64,
}

/// The background grid and the particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Distance between grid nodes \[m\].
    pub spacing_m: f64,
    /// Particles per cell: 1, 8, 27 or 64.
    #[serde(default = "defaults::particles_per_cell")]
    pub particles_per_cell: usize,
    /// FLIP blending: 0 for APIC (more dissipative), 1 for FLIP (less dissipative).
    #[serde(default)]
    pub flip: f64,
    /// `f32` or `f64`.
    #[serde(default)]
    pub precision: Precision,
    /// Seed of the particles' jitter.
    #[serde(default)]
    pub seed: u64,
    /// Maximum number of nodes in the box around the particles.
    #[serde(default = "defaults::node_limit")]
    pub node_limit: usize,
}

/// Floating-point type of the simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// Double precision.
    F64,
}

/// Gravity and bounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surroundings {
    /// Gravity \[m/s²\]; y points up.
    #[serde(default = "defaults::gravity")]
    pub gravity_m_s2: [f64; 3],
    /// Lower and upper corner of the admissible region \[m\]; a particle outside stops the run.
    #[serde(default)]
    pub bounds_m: Option<[[f64; 3]; 2]>,
}

impl Default for Surroundings {
    fn default() -> Self {
        Self { gravity_m_s2: defaults::gravity(), bounds_m: None }
    }
}

/// A horizontal floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// Its height \[m\].
    #[serde(default)]
    pub height_m: f64,
    /// Contact condition.
    #[serde(default)]
    pub contact: Touch,
    /// Friction coefficient for `contact = "friction"`.
    #[serde(default)]
    pub friction: Option<f64>,
}

/// Contact condition of an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Touch {
    /// No slip, no separation.
    #[default]
    Sticky,
    /// Frictionless, no separation.
    Slip,
    /// Frictionless, separates freely.
    Separate,
    /// Coulomb friction, separates freely.
    Friction,
}

/// An obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// Its region.
    pub shape: Barrier,
    /// Contact condition.
    #[serde(default)]
    pub contact: Touch,
    /// Friction coefficient for `contact = "friction"`.
    #[serde(default)]
    pub friction: Option<f64>,
    /// Whether particles live inside it.
    #[serde(default)]
    pub container: bool,
    /// Initial rotation about its centre: axis times angle \[°\].
    #[serde(default)]
    pub turn_deg: [f64; 3],
    /// Velocity \[m/s\].
    #[serde(default)]
    pub velocity_m_s: [f64; 3],
    /// Angular velocity about its pivot: axis times rate \[rad/s\].
    #[serde(default)]
    pub spin_rad_s: [f64; 3],
    /// Pivot of the rotation \[m\]; defaults to its centre.
    #[serde(default)]
    pub pivot_m: Option<[f64; 3]>,
}

/// The region of an obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Barrier {
    /// The half-space below a plane.
    Plane {
        /// A point on the plane \[m\].
        point_m: [f64; 3],
        /// Normal towards the free side, of any length.
        normal: [f64; 3],
    },
    /// A box along the axes.
    Box {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Edge lengths \[m\].
        size_m: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Radius \[m\].
        radius_m: f64,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Centre of one end \[m\].
        start_m: [f64; 3],
        /// Centre of the other end \[m\].
        end_m: [f64; 3],
        /// Radius \[m\].
        radius_m: f64,
    },
}

/// A material: a law, a density and the law's parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Substance {
    /// Name of the law, or a file with one in WGSL, whose name ends in `.wgsl`.
    pub law: String,
    /// Density \[kg/m³\].
    pub density_kg_m3: f64,
    /// Parameters of the law by name, in its units.
    #[serde(flatten)]
    pub parameters: BTreeMap<String, f64>,
}

/// A body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Name of its material.
    pub material: String,
    /// Its shape.
    pub shape: Shape,
    /// Initial rotation about its centre: axis times angle \[°\].
    #[serde(default)]
    pub turn_deg: [f64; 3],
    /// Velocity \[m/s\].
    #[serde(default)]
    pub velocity_m_s: [f64; 3],
    /// Angular velocity about its centre of mass: axis times rate \[rad/s\].
    #[serde(default)]
    pub spin_rad_s: [f64; 3],
    /// Colour in pictures, as `#rrggbb`.
    #[serde(default)]
    pub colour: Option<String>,
}

/// The shape of a body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A box along the axes.
    Box {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Edge lengths \[m\].
        size_m: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Radius \[m\].
        radius_m: f64,
    },
    /// An upright cylinder.
    Cylinder {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Radius \[m\].
        radius_m: f64,
        /// Height \[m\].
        height_m: f64,
    },
    /// An upright cone with its tip at the top.
    Cone {
        /// Midpoint between base and tip \[m\].
        centre_m: [f64; 3],
        /// Radius of the base \[m\].
        radius_m: f64,
        /// Height \[m\].
        height_m: f64,
    },
    /// A torus with a vertical axis.
    Torus {
        /// Centre \[m\].
        centre_m: [f64; 3],
        /// Distance between the centre of the tube and that of the torus \[m\].
        ring_radius_m: f64,
        /// Radius of the tube \[m\].
        tube_radius_m: f64,
    },
    /// A closed surface from a file: OBJ, PLY or STL.
    Mesh {
        /// Path relative to the scene file.
        file: PathBuf,
        /// Factor from the file's unit to metres.
        #[serde(default = "defaults::one")]
        scale: f64,
        /// Translation after scaling \[m\].
        #[serde(default)]
        translate_m: [f64; 3],
    },
    /// Particles from a file: PLY, or npy of shape `[n, 3]`.
    Particles {
        /// Path relative to the scene file.
        file: PathBuf,
        /// Factor from the file's unit to metres.
        #[serde(default = "defaults::one")]
        scale: f64,
        /// Translation after scaling \[m\].
        #[serde(default)]
        translate_m: [f64; 3],
    },
}

/// Viewpoint of the picture. Omitted values are chosen such that the whole scene is visible.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position \[m\].
    #[serde(default)]
    pub eye_m: Option<[f64; 3]>,
    /// Target point \[m\].
    #[serde(default)]
    pub target_m: Option<[f64; 3]>,
    /// Vertical field of view \[°\].
    #[serde(default)]
    pub field_of_view_deg: Option<f64>,
    /// Width and height of the picture \[pixels\].
    #[serde(default)]
    pub pixels: Option<[usize; 2]>,
}

/// Default values of omitted keys.
mod defaults {
    pub fn frames_per_s() -> f64 {
        24.0
    }
    pub fn cfl() -> f64 {
        crate::physics::CFL
    }
    pub fn particles_per_cell() -> usize {
        8
    }
    pub fn node_limit() -> usize {
        1 << 24
    }
    pub fn gravity() -> [f64; 3] {
        [0.0, -9.8, 0.0]
    }
    pub fn one() -> f64 {
        1.0
    }
}

impl SceneFile {
    /// Reads a scene.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for invalid TOML or an unknown key, shape or contact; the message gives the line and
    /// the nearest valid name.
    pub fn parse(text: &str) -> Result<Self> {
        toml::from_str(text).map_err(|e| {
            let message = e.to_string();
            let error = Error::new(ErrorKind::Input, "the scene cannot be read").found(message.trim());
            match suggestion(&message) {
                Some(fix) => error.fix(fix),
                None => error.fix("compare with the scenes in examples/scenes, or see `gradreel simulate --help`"),
            }
        })
    }

    /// Reads a scene file.
    ///
    /// # Errors
    /// As [`SceneFile::parse`], and if the file cannot be read.
    pub fn read(path: &Path) -> Result<Self> {
        let fix = "give the path of a TOML file, such as examples/scenes/rubber.toml";
        let text = text::read(path, "the scene", fix, text::SETTINGS)?;
        Self::parse(&text).map_err(|e| e.within(path.display()))
    }
}
