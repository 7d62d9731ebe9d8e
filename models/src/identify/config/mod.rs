//! The configuration of a reconstruction: every number that decides its outcome, with defaults.

pub(super) mod flowing;
pub(super) mod own_law;
pub(super) mod settings_file;

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::field::FitSettings;
use crate::identify::{FlowingConfig, GroundContact, LossConfig, OwnLaw, TemporalConfig};
use crate::nearest::{listed, nearest};
use crate::physics::materials::{self, AUTO, FAMILIES};
use crate::physics::{Law, Map};
use crate::published::PublishedConfig;
use crate::render::{Surface, Weights};
use crate::report::quantity::compact;
use crate::video::FilmSettings;

/// Everything a reconstruction can be told. A run stores the resolved values as `config.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What of the clip is used.
    pub clip: ClipConfig,
    /// Voxels and particles.
    pub geometry: GeometryConfig,
    /// The world that the object falls into.
    pub world: WorldConfig,
    /// The material and where its parameters start.
    pub material: MaterialConfig,
    /// What a pixel's residual counts.
    pub weights: Weights,
    /// What else counts in the loss, above all where views are imagined.
    pub loss: LossConfig,
    /// How occupancy becomes opacity.
    pub surface: Surface,
    /// What is done otherwise for fluid-like bodies.
    pub flowing: FlowingConfig,
    /// The temporal field, if the velocity is to start from it.
    pub temporal: TemporalConfig,
    /// The views of what a single camera did not see.
    pub imagine: ImagineConfig,
    /// The search for velocity and material.
    pub estimate: EstimateConfig,
    /// The published chain, if it is to be run in place of the project's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub published: Option<PublishedConfig>,
}

/// Where views of the first frame come from that nobody filmed, of what a single camera saw; without any, the object is taken to be
/// as deep as it is wide, part by part.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImagineConfig {
    /// Weights of the multi-view model that makes them.
    pub weights: Option<PathBuf>,
    /// A clip of one frame, whose first camera stands at the azimuth of the real one.
    pub views: Option<PathBuf>,
    /// Sampling steps; as the model is used to if not given.
    pub steps: Option<usize>,
    /// Strength of the guidance by the first frame, 1 being none; as the model is used to if not given.
    pub guidance: Option<f64>,
    /// Other seeds guess other backs.
    pub seed: u64,
}

/// What of the clip is used.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClipConfig {
    /// Camera numbers; all if empty.
    pub cameras: Vec<i64>,
    /// At most so many frames; all if 0.
    pub frames: usize,
    /// Numbers of the cameras that nobody filmed with; if not given, those that the clip's `clip.toml` names.
    pub imagined: Option<Vec<i64>>,
    /// Number of the first frame; that of the clip if not given.
    pub first_frame: Option<i64>,
    /// What is known of a film, if the clip is one.
    pub film: FilmSettings,
    /// Images are shrunk by this integer factor; 0 chooses one whose pixels are about a third of a grid cell.
    pub shrink: usize,
}

/// Voxels and particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GeometryConfig {
    /// Grid spacing of the simulation \[m\]; particles and voxels are half as far apart. 0 chooses 0.02 m, or a spacing
    /// that gives about ten thousand particles if 0.02 m gives fewer than 3 000 or more than 40 000.
    pub dx: f64,
    /// Coverage that every camera must see at a voxel of the visual hull; below ½ leaves room around the silhouettes.
    pub hull_coverage: f32,
    /// Voxels less opaque than this become no particle.
    #[serde(skip)]
    pub least_opacity: f64,
    /// Whether the surface of a body that several cameras filmed and that keeps its shape may be drawn sharpened, as `flowing.surface` has
    /// it, if its first frame is then fitted better by a third.
    pub sharpen: bool,
    /// The fit of the voxels.
    pub fit: FitSettings,
}

impl Default for GeometryConfig {
    fn default() -> Self {
        Self { dx: 0.0, hull_coverage: 0.3, least_opacity: 0.2, sharpen: true, fit: FitSettings::default() }
    }
}

/// The world that the object falls into.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorldConfig {
    /// Gravity \[m/s²\]. On ground that is not level it does not point along −y, which is the ground's normal downwards.
    pub gravity: [f64; 3],
    /// Height of the ground \[m\].
    pub ground: f64,
    /// What the ground does to a body that touches it.
    pub ground_contact: GroundContact,
    /// Whether the height is not known and is to be found: where the object lands.
    pub find_ground: bool,
    /// Density of the object \[kg/m³\]. Motion shows stiffness per density only: a wrong density scales E alike.
    pub density: f64,
    /// Share of a grid cell that waves and particles may cross in a substep; stable up to about 1.
    pub cfl: f64,
    /// Waves and particles are taken to be at least so fast when the substep is chosen \[m/s\]. Every substep damps the motion
    /// a little, by passing it to the grid and back; with this floor the number of substeps does not hang on how soft a
    /// material is. The default makes 1/4800 s of a grid of 0.02 m, the published step.
    pub least_speed: f64,
    /// Memory for the states of a rollout \[MiB\].
    pub memory_mib: usize,
}

impl Default for WorldConfig {
    fn default() -> Self {
        Self {
            gravity: [0.0, -9.8, 0.0],
            ground: 0.0,
            ground_contact: GroundContact::default(),
            find_ground: false,
            density: 1000.0,
            cfl: 0.55,
            least_speed: 52.8,
            memory_mib: 512,
        }
    }
}

/// The material and where its parameters start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialConfig {
    /// Name of the material: `elastic`, `plasticine`, `newtonian`, `non_newtonian`, `sand`, or the name of a law; `auto` lets
    /// each of the five try.
    pub name: String,
    /// A file in WGSL with a law of one's own, in place of a name; in a file of settings a relative path begins at its folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<std::path::PathBuf>,
    /// The law itself, once it is known ([`Config::with_law`]).
    #[serde(skip)]
    pub own: OwnLaw,
    /// Starting values by parameter name, in SI units; the law's own for those not named.
    pub start: std::collections::BTreeMap<String, f64>,
    /// Parameters that stay where they start; if not given, all of sand's but its angle of friction.
    pub held: Option<Vec<String>>,
}

impl Default for MaterialConfig {
    fn default() -> Self {
        Self {
            name: "elastic".to_owned(),
            law: None,
            own: OwnLaw::default(),
            start: std::collections::BTreeMap::new(),
            held: None,
        }
    }
}

/// The law of a family, or of that name.
pub fn law_of(name: &str) -> Option<Law> {
    let family = FAMILIES.iter().find(|(family, _)| *family == name);
    materials::find(family.map_or(name, |(_, law)| law))
}

/// Things that people name in place of a family.
const EVERYDAY: [(&str, &[&str]); 5] = [
    ("elastic", &["rubber", "foam", "jelly", "gelatin", "gelatine", "silicone", "sponge", "solid", "soft"]),
    ("plasticine", &["clay", "putty", "dough", "wax", "metal", "plastic", "plasticin"]),
    ("newtonian", &["water", "honey", "oil", "milk", "syrup", "fluid", "liquid"]),
    ("non_newtonian", &["toothpaste", "ketchup", "cream", "mayonnaise", "paste", "mud", "yoghurt", "yogurt"]),
    ("sand", &["soil", "gravel", "grains", "granular", "sugar", "salt", "rice"]),
];

/// Says that a law has no parameter of this name, which ones it has, and which was probably meant.
pub(crate) fn no_such_parameter(law: &Law, name: &str, at: &str) -> Error {
    let known = || law.parameters().iter().map(|p| p.name);
    let wanted = law.parameters().iter().map(|p| match p.unit {
        "-" => p.name.to_owned(),
        unit => format!("{} [{unit}]", p.name),
    });
    Error::new(ErrorKind::Input, format!("the material {} has no parameter of this name", law.name()))
        .at(at)
        .found(format!("`{name}`"))
        .wanted(format!("one of {}", wanted.collect::<Vec<_>>().join(", ")))
        .fix(match nearest(name, known()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "choose one of these, or another material".to_owned(),
        })
}

/// The first number of some settings that is not finite, by its path.
fn not_finite(path: &str, value: &toml::Value) -> Option<(String, f64)> {
    let below = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
    match value {
        toml::Value::Float(number) => (!number.is_finite()).then(|| (path.to_owned(), *number)),
        toml::Value::Table(table) => table.iter().find_map(|(name, value)| not_finite(&below(name), value)),
        toml::Value::Array(list) => {
            list.iter().enumerate().find_map(|(k, value)| not_finite(&below(&k.to_string()), value))
        }
        _ => None,
    }
}

/// What of sand is held unless told otherwise, and at which value, as published: grains hardly deform, and how far sand can be
/// pulled is next to nothing; any sign of either drowns in the shape's error.
const SAND: [(&str, f64); 3] = [("young", 1e6), ("poisson", 0.3), ("cohesion", 0.0)];

/// The published value of a parameter that the motion does not show, at which it is held unless told otherwise.
pub(super) fn published(law: &Law, parameter: &crate::physics::Parameter) -> Option<f64> {
    let known = SAND.iter().find(|(name, _)| law.name() == "drucker_prager" && *name == parameter.name);
    known.map(|(_, value)| *value)
}

/// The search for velocity and material, by a pool of hypotheses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimateConfig {
    /// Gauss–Newton steps at most for the velocity before contact, each time.
    pub velocity: usize,
    /// Whether the object may spin: its initial angular velocity is searched with the velocity.
    pub spin: bool,
    /// Points of the prior for each parameter and mode of the body that is free, besides the one to start from. More find narrow
    /// valleys, and take as much longer.
    pub points: usize,
    /// Hypotheses of a family at most that are searched with the full forward model.
    pub survivors: usize,
    /// Gauss–Newton steps at most of each of these searches.
    pub steps: usize,
    /// How far derivatives reach, as a share of the longest step of a search: differences of rollouts side by side cost less than
    /// forward mode, and see past the jumps of thin rims. 0 for those of an infinitesimal step, in forward mode.
    #[serde(skip)]
    pub reach: f64,
    /// Rounds of fitting the shape to the whole motion and the material to the new shape.
    pub rounds: usize,
}

impl Default for EstimateConfig {
    fn default() -> Self {
        Self { velocity: 10, spin: false, points: 32, survivors: 2, steps: 3, reach: 0.1, rounds: 1 }
    }
}

/// A setting whose value makes no sense.
pub(crate) fn outside_range(name: &str, wanted: &str) -> Error {
    Error::new(ErrorKind::Input, format!("the setting {name} is outside its range"))
        .at(name)
        .wanted(wanted)
        .fix("correct it in the file of --config or on the command line, or leave it out")
}

/// Whether the values of a surface make sense; `table` names their settings.
pub(super) fn check_surface(surface: &Surface, table: &str) -> Result<()> {
    let positive = |x: f64| x > 0.0 && x.is_finite();
    let fraction = |x: f64| (0.0..=1.0).contains(&x);
    let rules = [
        ((0.5..=4.0).contains(&surface.spacing), "spacing", "0.5 to 4 spacings of the particles"),
        (positive(surface.step) && surface.step <= 2.0, "step", "above 0, at most 2 cells"),
        (positive(surface.depth), "depth", "a positive optical depth"),
        (positive(surface.width) && fraction(surface.low), "low/width", "within 0 to 1"),
        (fraction(surface.sharpening), "sharpening", "0 to 1"),
    ];
    match rules.iter().find(|(holds, ..)| !holds) {
        Some((_, name, wanted)) => Err(outside_range(&format!("{table}.{name}"), wanted)),
        None => Ok(()),
    }
}

impl Config {
    /// Reads a configuration; what it does not name keeps its default.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for text that is not TOML, names an unknown setting, or holds a value outside its range.
    pub fn parse(text: &str) -> Result<Self> {
        let config = Self::read(text)?;
        config.check()?;
        Ok(config)
    }

    /// Reads a configuration that something else completes, such as the command line with the material whose parameters it
    /// holds; what belongs together is for [`Config::check`] to say then.
    ///
    /// ```
    /// use gradreel_models::identify::Config;
    ///
    /// let text = "[material]\nheld = [\"yield_stress\"]";
    /// assert!(Config::parse(text).is_err(), "rubber has none");
    /// let mut config = Config::read(text)?;
    /// config.material.name = "plasticine".to_owned();
    /// config.check()?;
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for text that is not TOML, or names an unknown setting.
    pub fn read(text: &str) -> Result<Self> {
        toml::from_str(text).map_err(|e| {
            Error::new(ErrorKind::Input, "the configuration cannot be read")
                .found(e.to_string().trim())
                .fix("compare with the config.toml of any run, which names every setting")
        })
    }

    /// The configuration as TOML.
    ///
    /// # Errors
    /// Never for values that passed [`Config::check`].
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string_pretty(self)
            .map_err(|e| Error::new(ErrorKind::Io, "the configuration cannot be written").found(e))
    }

    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let fraction = |x: f64| (0.0..=1.0).contains(&x);
        let dx = self.geometry.dx;
        let fit = &self.geometry.fit;
        let rules = [
            (dx == 0.0 || (1e-5..=10.0).contains(&dx), "geometry.dx", "0, or 0.00001 to 10 m"),
            (positive(fit.density_rate), "geometry.fit.density_rate", "a positive number"),
            (positive(fit.density_rate_in_motion), "geometry.fit.density_rate_in_motion", "a positive number"),
            ((0.0..=1.0).contains(&fit.material_rate), "geometry.fit.material_rate", "0 to 1"),
            (fit.smoothness >= 0.0 && fit.smoothness.is_finite(), "geometry.fit.smoothness", "0 or a positive number"),
            (positive(fit.colour_rate), "geometry.fit.colour_rate", "a positive number"),
            (fraction(f64::from(self.geometry.hull_coverage)), "geometry.hull_coverage", "0 to 1"),
            ((0.0..1.0).contains(&self.geometry.least_opacity), "geometry.least_opacity", "at least 0, below 1"),
            (self.world.gravity.iter().all(|g| g.is_finite()), "world.gravity", "three finite numbers in m/s²"),
            (self.world.ground.is_finite(), "world.ground", "a height in metres"),
            ((0.1..=1e5).contains(&self.world.density), "world.density", "0.1 to 100000 kg/m³"),
            ((0.01..=1.0).contains(&self.world.cfl), "world.cfl", "0.01 to 1"),
            ((0.0..=1e4).contains(&self.world.least_speed), "world.least_speed", "0 to 10000 m/s"),
            (self.world.memory_mib >= 16, "world.memory_mib", "at least 16 MiB"),
            (self.estimate.survivors > 0, "estimate.survivors", "1 or more"),
            (fraction(self.estimate.reach), "estimate.reach", "0 to 1"),
            (self.imagine.steps.is_none_or(|n| (1..=1000).contains(&n)), "imagine.steps", "1 to 1000"),
            (self.imagine.guidance.is_none_or(f64::is_finite), "imagine.guidance", "a number"),
            (self.weights.colour >= 0.0 && positive(self.weights.coverage), "weights", "not negative"),
            (self.weights.imagined_colour >= 0.0, "weights.imagined_colour", "0 or a positive number"),
        ];
        for (holds, name, wanted) in rules {
            if !holds {
                return Err(outside_range(name, wanted));
            }
        }
        check_surface(&self.surface, "surface")?;
        self.flowing.check()?;
        self.clip.film.check()?;
        self.loss.check()?;
        self.temporal.check()?;
        self.published.as_ref().map_or(Ok(()), PublishedConfig::check)?;
        let twice = |(index, camera): (usize, &i64)| self.clip.cameras[..index].contains(camera);
        if let Some((_, camera)) = self.clip.cameras.iter().enumerate().find(|camera| twice(*camera)) {
            return Err(outside_range("clip.cameras", "each camera once").found(format!("camera {camera} twice")));
        }
        let law = self.law()?;
        self.held(&law)?;
        self.starting_values(&law)?;
        if let (true, false) = (self.chooses_family(), self.material.start.is_empty() && self.material.held.is_none()) {
            return Err(Error::new(ErrorKind::Input, "parameters of a material whose family is still to be chosen")
                .at("material.start and material.held")
                .found("the material `auto`")
                .fix("leave them out, or name the family"));
        }
        // whatever a rule above does not speak of
        let settings =
            toml::Value::try_from(self).map_err(|e| outside_range("settings", "what TOML can hold").found(e))?;
        match not_finite("", &settings) {
            Some((name, found)) => Err(outside_range(&name, "a finite number").found(found)),
            None => Ok(()),
        }
    }

    /// The names of the parameters that stay where they start.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a parameter that the law does not have.
    pub fn held<'a>(&'a self, law: &'a Law) -> Result<Vec<&'a str>> {
        let Some(held) = &self.material.held else {
            let grains = SAND.iter().map(|(name, _)| *name).filter(|_| law.name() == "drucker_prager");
            return Ok(grains.collect());
        };
        if let Some(unknown) = held.iter().find(|name| law.parameters().iter().all(|p| p.name != name.as_str())) {
            return Err(no_such_parameter(law, unknown, "material.held"));
        }
        Ok(held.iter().map(String::as_str).collect())
    }

    /// Whether the family of the material is still to be chosen.
    pub fn chooses_family(&self) -> bool {
        self.material.name == AUTO && self.material.law.is_none() && self.material.own.law().is_none()
    }

    /// The name of the material's family on its kind of ground, among hypotheses.
    pub fn hypothesis(&self) -> String {
        self.world.ground_contact.named(&self.material.name)
    }

    /// The law of the material.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is no material of this name.
    pub fn law(&self) -> Result<Law> {
        if let Some(own) = self.material.own.law() {
            return Ok(own.clone());
        }
        if let Some(path) = &self.material.law {
            return Law::read(path);
        }
        let name = &self.material.name;
        // until a family is chosen nothing depends on it: free flight
        let name = if self.chooses_family() { FAMILIES[0].0 } else { name };
        law_of(name).ok_or_else(|| {
            let laws = materials::all();
            let families = || FAMILIES.iter().map(|(family, _)| *family).chain([AUTO]);
            let names = || laws.iter().map(|law| law.name()).filter(|name| families().all(|family| family != *name));
            let everyday = EVERYDAY.iter().find(|(_, things)| things.contains(&name.to_lowercase().as_str()));
            let near = everyday.map(|(family, _)| *family).or_else(|| nearest(name, families().chain(names())));
            Error::new(ErrorKind::Input, "there is no material of this name")
                .at("material.name")
                .found(name)
                .wanted(format!("a family ({}), or a law ({})", listed(families()), listed(names())))
                .fix(match near {
                    Some(near) => format!("did you mean `{near}`? Give it with --material, or in the file of --config"),
                    None => "choose one of these with --material, or in the file of --config".to_owned(),
                })
        })
    }

    /// Where the parameters of a law start, in its order.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a parameter that the law does not have, or a value that it cannot take or that is more
    /// than a hundred times beyond what is plausible.
    pub fn starting_values(&self, law: &Law) -> Result<Vec<f64>> {
        let start = &self.material.start;
        let parameters = law.parameters();
        if let Some(unknown) = start.keys().find(|name| parameters.iter().all(|p| p.name != name.as_str())) {
            return Err(no_such_parameter(law, unknown, "material.start"));
        }
        let value = |p: &crate::physics::Parameter| {
            let value = start.get(p.name).copied().or_else(|| published(law, p)).unwrap_or(p.start);
            let (low, high) = match p.map {
                Map::Log10 => (p.prior[0] / 100.0, p.prior[1] * 100.0),
                Map::Linear => (100.0 * p.prior[0], 100.0 * p.prior[1]),
                Map::Bounded { low, high } => (low, high),
            };
            if (low..=high).contains(&value) && p.map.raw(value).is_finite() {
                return Ok(value);
            }
            Err(Error::new(ErrorKind::Input, format!("the parameter {} cannot start there", p.name))
                .at(format!("material.start.{}", p.name))
                .found(format!("{} {}", compact(value), p.unit))
                .wanted(format!("between {} and {} {}", compact(low), compact(high), p.unit))
                .fix(format!(
                    "start for example from {0} {1} (`--start {2}={0}`, or in the file of --config)",
                    p.start, p.unit, p.name
                )))
        };
        parameters.iter().map(value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Settings that describe the clip, the world or the material, or name files: nothing is traded by them.
    const DESCRIBE: [&str; 8] = [
        "clip",
        "material",
        "imagine",
        "world.g",
        "world.find_ground",
        "world.density",
        "loss.ranges.ranges",
        "flowing.laws",
    ];

    /// Paths of all settings.
    fn paths(path: &str, value: &toml::Value, found: &mut Vec<String>) {
        match value {
            toml::Value::Table(table) if !table.is_empty() => {
                let below = |name: &String| if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                table.iter().for_each(|(name, value)| paths(&below(name), value, found));
            }
            _ => found.push(path.to_owned()),
        }
    }

    #[test]
    fn there_are_few_knobs() {
        let config = Config { published: Some(PublishedConfig::default()), ..Config::default() };
        let mut all = Vec::new();
        paths("", &toml::Value::try_from(&config).unwrap(), &mut all);
        let knobs: Vec<&String> = all.iter().filter(|path| !DESCRIBE.iter().any(|of| path.starts_with(of))).collect();
        assert!((20..=40).contains(&knobs.len()), "{} knobs: {knobs:?}", knobs.len());
    }

    #[test]
    fn what_is_no_setting_keeps_its_value() {
        let config = Config::parse("[surface]\nlow = 0.3\n[geometry]\ndx = 0.01\n[weights]\ncolour = 0.1").unwrap();
        let (surface, default) = (&config.surface, Surface::default());
        assert_eq!((surface.low, surface.spacing, surface.depth), (0.3, default.spacing, default.depth));
        assert_eq!(config.geometry.least_opacity, GeometryConfig::default().least_opacity);
        assert_eq!((config.weights.coverage, config.flowing), (1.0, FlowingConfig::default()));
        assert!(Config::parse("[geometry]\nleast_opacity = 0.1").is_err());
    }
}
