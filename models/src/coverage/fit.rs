//! One clip from its draw to its scores.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use gradreel::{ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::{Recipe, Score, Split, material, simulate, write};
use crate::identify::{Config, Run, Survey, reconstruct};
use crate::monocular;
use crate::physics::Law;
use crate::report::reconstruction::quantities;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Camera, Clip, FilmSettings, OpenOptions};

/// What came of one clip: a line of JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// The number of the clip in its split.
    pub clip: u64,
    /// The split.
    pub split: Split,
    /// How many cameras filmed it.
    pub cameras: usize,
    /// The family of its material.
    pub family: String,
    /// Whether the fit was told where the cameras are.
    pub calibrated: bool,
    /// Whether the pictures have a background.
    pub background: bool,
    /// How far down a single camera looks \[degrees\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<Looks>,
    /// Particles of the fit; 0 where there was none.
    pub particles: usize,
    /// The true values by name, in SI units.
    pub truth: BTreeMap<String, f64>,
    /// Scores by name; none where the clip was refused.
    pub scores: BTreeMap<String, Score>,
    /// Why there is no estimate, if there is none.
    pub refused: Option<String>,
    /// Wall-clock time of the fit \[s\].
    pub seconds: f64,
    /// What the clip says of each hypothesis that survived, where the fit is by a pool: what the error budget is measured from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) surveys: Vec<Survey>,
}

/// How far down a camera looks \[degrees\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Looks {
    /// In truth.
    pub truth: f64,
    /// As the fall suggests, or as it was told.
    pub fall: Option<f64>,
    /// As the fit found.
    pub found: Option<f64>,
}

/// Downward pitch \[degrees\].
fn pitch_of(camera: &Camera) -> f64 {
    camera.c2w[1][2].asin().to_degrees()
}

/// Draws, films and fits a clip with these settings, its law told (one's own, or that of a family), on the grid that the recipe has for it
/// unless the settings name another. Files are left in `folder`.
///
/// A clip that the fit refuses is a line without scores.
///
/// # Errors
/// What making the clip returns; [`ErrorKind::Interrupted`].
pub fn fit(
    split: Split,
    number: u64,
    cameras: usize,
    own: Option<&Law>,
    settings: &Config,
    folder: &Path,
) -> Result<Line> {
    let recipe = Recipe::draw(split, number, cameras, own)?;
    let mut truth = recipe.parameters.clone();
    for (axis, speed) in ["x", "y", "z"].into_iter().zip(recipe.velocity) {
        truth.insert(format!("velocity_{axis}"), speed);
    }
    let mut line = Line {
        clip: number,
        split,
        cameras,
        family: recipe.material.name.clone(),
        calibrated: recipe.calibrated,
        background: recipe.background,
        pitch: match &recipe.cameras[..] {
            [camera] => Some(Looks { truth: pitch_of(camera), fall: None, found: None }),
            _ => None,
        },
        particles: 0,
        truth,
        scores: BTreeMap::new(),
        refused: None,
        seconds: 0.0,
        surveys: Vec::new(),
    };
    let motion = match simulate(&recipe) {
        Err(error) if error.kind() != ErrorKind::Interrupted => {
            line.refused = Some(format!("the truth cannot be simulated: {error}"));
            return Ok(line);
        }
        found => found?,
    };
    let path = write(&recipe, &motion, folder)?;
    drop(motion);
    let since = Instant::now();
    match estimate(&recipe, settings, &path, &folder.join("run")) {
        Err(error) if error.kind() == ErrorKind::Interrupted => return Err(error),
        Err(error) => line.refused = Some(error.to_string()),
        Ok(Estimate { scores, particles, surveys, pitch: [fall, found] }) => {
            (line.scores, line.particles, line.surveys) = (scores, particles, surveys);
            line.pitch.iter_mut().for_each(|pitch| (pitch.fall, pitch.found) = (Some(fall), Some(found)));
        }
    }
    line.seconds = since.elapsed().as_secs_f64();
    Ok(line)
}

struct Estimate {
    scores: BTreeMap<String, Score>,
    particles: usize,
    surveys: Vec<Survey>,
    /// Of the first camera, as the fall suggests and as found \[degrees\].
    pitch: [f64; 2],
}

fn estimate(recipe: &Recipe, settings: &Config, path: &Path, out: &Path) -> Result<Estimate> {
    let mut config = Config { material: recipe.material.clone(), ..settings.clone() };
    if config.geometry.dx == 0.0 {
        config.geometry.dx = recipe.spacing();
    }
    let (gravity, options) = (config.world.gravity, OpenOptions::default());
    let clip = if recipe.calibrated {
        let mut clip = Clip::open(path, &options)?;
        monocular::sight(&mut clip, gravity)?;
        clip
    } else {
        let known = FilmSettings {
            frames_per_s: recipe.rate(),
            field_of_view: recipe.field_of_view(),
            ..FilmSettings::default()
        };
        config.clip.film = known.clone();
        monocular::clip_of_film(path, &known, &options, gravity)?
    };
    let mut run = Run::create(RunFolder::create(out)?, config, &clip)?;
    let found = reconstruct(&clip, &mut run, &Progress::new(true))?;
    let law = run.config.law()?;
    let mut scores = BTreeMap::new();
    for quantity in quantities(&found, &run).into_iter().filter(|quantity| quantity.source == "fitted") {
        let parameter = law.parameters().iter().find(|p| p.name == quantity.name);
        let scale = |x: f64| parameter.map_or(x, |parameter| material::scale(parameter, x));
        let axis = ["velocity_x", "velocity_y", "velocity_z"].iter().position(|name| *name == quantity.name);
        let truth = axis.map(|axis| recipe.velocity[axis]).or(recipe.parameters.get(&quantity.name).copied());
        let (Some(truth), Some(interval), Some(log_prior)) =
            (truth, quantity.interval_90, recipe.log_prior.get(&quantity.name))
        else {
            continue;
        };
        let determined = quantity.determined != Some(false);
        let error = scale(quantity.value) - scale(truth);
        let score = match run.known(&law, &quantity.name, truth) {
            // the density on the scale of the fit
            Some((rank, log_density)) => {
                let per_unit = parameter.map_or(1.0, |parameter| material::slope(parameter, truth));
                Score::of_posterior(error, rank, log_density - per_unit.ln(), determined, *log_prior)
            }
            None => Score::normal(scale(quantity.value), interval.map(scale), determined, scale(truth), *log_prior),
        };
        scores.insert(quantity.name, score);
    }
    let fall = pitch_of(&clip.cameras[0]);
    let moved = run.state.unknowns.as_ref().map_or(0.0, |unknowns| unknowns.depth_modes()[3]);
    Ok(Estimate {
        scores,
        particles: found.particles.len(),
        surveys: run.surveys().to_vec(),
        pitch: [fall, fall + moved.to_degrees()],
    })
}
