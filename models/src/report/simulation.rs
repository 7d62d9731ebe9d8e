//! The output folder of a simulation: frames, totals, restart data, animation and page.

use std::path::Path;
use std::time::{Duration, Instant};

use gradreel::io::npy;
use gradreel::{Error, ErrorKind, Result, Tensor};
use serde_json::{Value, json};

use super::animation::{Picture, gif};
use super::page::{Headline, Page, Scene};
use super::plot::{Plot, Series};
use super::ply::ply;
use super::png_file::png_with_alpha;
use crate::physics::Contact;
use crate::physics::law_file;
use crate::runtime::run_folder::RunFolder;
use crate::scenes::{Film, Frame, SceneFile, Setup, Snapshot, Totals, View, positions_of};

/// Minimum time between two saved states.
const BETWEEN_STATES: Duration = Duration::from_secs(20);
/// Maximum number of animation frames; longer runs are subsampled.
const MOST_PICTURES: usize = 240;
/// Maximum number of positions in the page's player; larger sets of particles are subsampled.
const MOST_POSITIONS: usize = 600_000;

/// A kind of file that each frame is written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Point clouds with colours.
    Ply,
    /// NumPy arrays `[n, 3]`.
    Npy,
}

/// Writer of a simulation's results.
#[derive(Debug)]
pub struct Record<'a> {
    folder: RunFolder,
    title: String,
    text: String,
    file: &'a SceneFile,
    setup: &'a Setup,
    formats: Vec<Format>,
    view: View,
    /// Stride of the frames that are rendered.
    every: usize,
    pictures: Vec<Picture>,
    /// Positions of the subsampled particles, per frame.
    shown: Vec<Vec<[f32; 3]>>,
    totals: Vec<Totals>,
    substeps: usize,
    saved: Instant,
    /// Whether to write an animation.
    pub animated: bool,
    /// Cameras that render a clip, if any.
    pub film: Option<Film>,
}

impl<'a> Record<'a> {
    /// Creates the writer without any input or output; call [`Record::begin`] or [`Record::resume`] next.
    pub fn new(
        folder: RunFolder,
        name: &str,
        text: &str,
        file: &'a SceneFile,
        setup: &'a Setup,
        formats: &[Format],
    ) -> Self {
        let title = if file.title.is_empty() { name } else { &file.title };
        Self {
            folder,
            title: title.into(),
            text: text.into(),
            file,
            setup,
            formats: formats.to_vec(),
            view: View::of(setup, &file.camera),
            every: setup.schedule.frames.div_ceil(MOST_PICTURES),
            pictures: Vec::new(),
            shown: Vec::new(),
            totals: Vec::new(),
            substeps: setup.schedule.substeps,
            saved: Instant::now(),
            animated: true,
            film: None,
        }
    }

    /// Starts a new run: writes its scene.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn begin(&self) -> Result<()> {
        if let Some(film) = &self.film {
            self.folder.write("clip/all_data.json", film.list().as_bytes())?;
        }
        for stuff in &self.setup.materials {
            if let Some(text) = stuff.law.text() {
                self.folder.write(&law_file(stuff.law.name()), text.as_bytes())?;
            }
        }
        self.folder.write("scene.toml", self.text.as_bytes())
    }

    /// Reads the frames written by an interrupted run; returns its restart data.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if nothing was saved, or for another scene; an error if a file cannot be read.
    pub fn resume(&mut self) -> Result<Snapshot> {
        let (folder, setup) = (&self.folder, self.setup);
        let place = folder.root().display().to_string();
        if !folder.has("state.npy") {
            return Err(Error::new(ErrorKind::Input, "there is nothing to go on from")
                .at(place)
                .found("no saved state: the run finished, or has not begun")
                .fix("start a new run in another folder"));
        }
        if folder.read("scene.toml")? != self.text.as_bytes() {
            return Err(Error::new(ErrorKind::Input, "the run in this folder is of another scene")
                .at(place)
                .fix("give the scene and the options that it was begun with, or start a new run"));
        }
        let damaged = |what: String| {
            Error::new(ErrorKind::Input, "the saved state cannot be read").at(&place).found(what).fix("start a new run")
        };
        let state = npy::from_bytes(&folder.read("state.npy")?).and_then(|state| state.to_vec())?;
        let about: Value = serde_json::from_slice(&folder.read("state.json")?).map_err(|e| damaged(e.to_string()))?;
        let number = |key: &str| {
            let number = about[key].as_u64().and_then(|n| usize::try_from(n).ok());
            number.ok_or_else(|| damaged(format!("no number `{key}`")))
        };
        let snapshot = Snapshot { frame: number("frame")?, substeps: number("substeps_per_frame")?, state };
        self.totals = serde_json::from_value(about["totals"].clone()).map_err(|e| damaged(e.to_string()))?;
        for index in 0..=snapshot.frame {
            let (ply, npy) = (frame_name(index, Format::Ply), frame_name(index, Format::Npy));
            let bytes = self.folder.read(if self.folder.has(&ply) { &ply } else { &npy })?;
            let positions = positions_of(&bytes).map_err(|e| e.within(format!("frame {index}")))?;
            if positions.len() != setup.len() {
                return Err(damaged(format!("{} particles in frame {index}, not {}", positions.len(), setup.len())));
            }
            let positions: Vec<[f32; 3]> = positions.iter().map(|x| x.map(|x| x as f32)).collect();
            self.show(index, &positions);
        }
        Ok(snapshot)
    }

    /// Path of the folder.
    pub fn root(&self) -> &Path {
        self.folder.root()
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn add(&mut self, frame: &Frame) -> Result<()> {
        for &format in &self.formats {
            let bytes = match format {
                Format::Ply => {
                    let colours: Vec<[u8; 3]> =
                        self.setup.object_of.iter().map(|&object| self.setup.colours[object as usize]).collect();
                    ply(&frame.positions, Some(&colours))?
                }
                Format::Npy => {
                    let numbers = frame.positions.as_flattened().to_vec();
                    npy::to_bytes(&Tensor::from_vec(numbers, [frame.positions.len(), 3]))?
                }
            };
            self.folder.write(&frame_name(frame.index, format), &bytes)?;
        }
        if let Some(film) = &self.film {
            for (camera, shot) in film.cameras().iter().zip(film.shots(&frame.positions)?) {
                let name = format!("clip/{}", Film::name(camera.id, frame.index));
                self.folder.write(&name, &png_with_alpha(shot.width, shot.height, &shot.rgba)?)?;
            }
        }
        self.totals.push(frame.totals.clone());
        self.substeps = frame.substeps;
        self.show(frame.index, &frame.positions);
        Ok(())
    }

    /// Renders a picture, and stores positions for the player.
    fn show(&mut self, index: usize, positions: &[[f32; 3]]) {
        if !index.is_multiple_of(self.every) {
            return;
        }
        let time = index as f64 * self.setup.schedule.frame_dt;
        if self.animated {
            self.pictures.push(self.view.picture(self.setup, positions, time));
        }
        self.shown.push(positions.iter().copied().step_by(self.thinning()).collect());
    }

    /// Stride of the particles in the player.
    fn thinning(&self) -> usize {
        let frames = self.setup.schedule.frames.div_ceil(self.every);
        (frames * self.setup.len()).div_ceil(MOST_POSITIONS).max(1)
    }

    /// Saves restart data.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn save(&mut self, snapshot: &Snapshot) -> Result<()> {
        let state = Tensor::from_vec(snapshot.state.clone(), [snapshot.state.len()]);
        self.folder.write("state.npy", &npy::to_bytes(&state)?)?;
        let about = json!({
            "frame": snapshot.frame,
            "substeps_per_frame": snapshot.substeps,
            "totals": &self.totals[..self.totals.len().min(snapshot.frame + 1)],
        });
        self.folder.write("state.json", about.to_string().as_bytes())?;
        self.saved = Instant::now();
        Ok(())
    }

    /// Saves restart data, at most every twenty seconds.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn save_now_and_then(&mut self, snapshot: impl FnOnce() -> Snapshot) -> Result<()> {
        if self.saved.elapsed() < BETWEEN_STATES { Ok(()) } else { self.save(&snapshot()) }
    }

    /// Removes the restart data of a finished run.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn forget_state(&self) -> Result<()> {
        for name in ["state.npy", "state.json"].map(|name| self.folder.path(name)) {
            if name.is_file() {
                std::fs::remove_file(&name).map_err(|e| Error::io(&name, "remove the saved state", &e))?;
            }
        }
        Ok(())
    }

    /// Writes totals, animation and page for the frames so far.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn publish(&self, seconds: f64) -> Result<()> {
        let schedule = self.setup.schedule;
        let totals = json!({
            "units": "SI",
            "particles": self.setup.len(),
            "frame_dt_s": schedule.frame_dt,
            "substeps_per_frame": self.substeps,
            "frames": self.totals,
        });
        let totals = serde_json::to_string_pretty(&totals)
            .map_err(|e| Error::new(ErrorKind::Io, "the totals cannot be written").at("totals.json").found(e))?;
        self.folder.write("totals.json", totals.as_bytes())?;
        let rate = 1.0 / (schedule.frame_dt * self.every as f64);
        let animation = if self.animated && !self.pictures.is_empty() {
            let bytes = gif(&self.pictures, rate)?;
            self.folder.write("motion.gif", &bytes)?;
            Some(bytes)
        } else {
            None
        };
        self.folder.write("index.html", self.page(animation.as_deref(), seconds).html().as_bytes())
    }

    fn page<'b>(&'b self, animation: Option<&'b [u8]>, seconds: f64) -> Page<'b> {
        let setup = self.setup;
        let thinning = self.thinning();
        let colours = setup.object_of.iter().step_by(thinning).map(|&object| setup.colours[object as usize]).collect();
        let lowest = setup.positions.iter().map(|x| x[1] as f32).fold(f32::INFINITY, f32::min);
        let scene = Scene {
            frames: self.shown.clone(),
            colours,
            frame_dt: setup.schedule.frame_dt * self.every as f64,
            ground: setup.floor().map_or(lowest, |floor| floor as f32),
            cameras: Vec::new(),
        };
        let total = self.totals.last();
        let headline = |symbol: &str, label: &str, value: f64, unit: &str, note: &str| Headline {
            symbol: symbol.into(),
            label: label.into(),
            readable: format!("{value:.4} {unit}"),
            exact: format!("{value:.9e} {unit}"),
            note: note.into(),
        };
        let headlines = total.map_or_else(Vec::new, |total| {
            vec![
                headline("m", "Mass", total.mass_kg, "kg", &format!("{} particles", setup.len())),
                headline("t", "Simulated", total.time_s, "s", &format!("{} frames", self.totals.len() - 1)),
                headline("E", "Kinetic energy", total.kinetic_j, "J", "at the end"),
            ]
        });
        let curve = |label: &str, of: &dyn Fn(&Totals) -> f64| Series {
            label: label.into(),
            points: self.totals.iter().map(|total| (total.time_s, of(total))).collect(),
        };
        let plot = |title: &str, y_label: &str, series: Vec<Series>| Plot {
            title: title.into(),
            x_label: "time [s]".into(),
            y_label: y_label.into(),
            log_y: false,
            series,
            reference: None,
        };
        let start = self.totals.first().map_or(0.0, |total| total.potential_j);
        let plots = vec![
            plot(
                "Energy",
                "energy [J]",
                vec![
                    curve("kinetic", &|t| t.kinetic_j),
                    curve("potential, from the start", &|t| t.potential_j - start),
                ],
            ),
            plot("Centre of mass", "height [m]", vec![curve("height", &|t| t.centre_m[1])]),
        ];
        let mut notes: Vec<(String, String)> = setup
            .materials
            .iter()
            .map(|stuff| {
                let values = stuff.law.parameters().iter().zip(&stuff.parameters);
                let values: Vec<String> = values.map(|(p, value)| format!("{} {value} {}", p.name, p.unit)).collect();
                let text = format!("{}, {} kg/m³, {}", stuff.law.name(), stuff.density, values.join(", "));
                (stuff.name.clone(), text)
            })
            .collect();
        notes.push((
            "substeps".into(),
            format!("{} per frame, {:.3e} s", self.substeps, setup.schedule.frame_dt / self.substeps as f64),
        ));
        let rough = setup.world.colliders.iter().filter(|c| matches!(c.contact, Contact::Friction(_))).count();
        notes.push(("obstacles".into(), format!("{}, {rough} with friction", setup.world.colliders.len())));
        if thinning > 1 {
            notes.push(("player".into(), format!("shows one particle of {thinning}; the files hold all")));
        }
        let mut files = vec![
            ("totals.json".into(), "mass, momentum and energy of every frame".into()),
            ("scene.toml".into(), "the scene, with everything that was assumed".into()),
        ];
        if self.film.is_some() {
            files.push(("clip/all_data.json".into(), "the cameras of the clip in this folder".into()));
        }
        if animation.is_some() {
            files.push(("motion.gif".into(), "the animation above".into()));
        }
        for &format in &self.formats {
            files.push((frame_name(0, format), "the first of the frames".into()));
        }
        Page {
            title: &self.title,
            subtitle: format!(
                "{} particles, grid of {} m, {} frames",
                setup.len(),
                self.file.grid.spacing_m,
                self.totals.len().saturating_sub(1)
            ),
            headlines,
            animation,
            animation_caption: String::new(),
            drawings: vec![],
            scene: Some(scene),
            plots,
            notes,
            timings: vec![("simulation and pictures".into(), seconds)],
            config_toml: self.text.clone(),
            files,
        }
    }
}

fn frame_name(index: usize, format: Format) -> String {
    let ending = if format == Format::Ply { "ply" } else { "npy" };
    format!("frames/frame_{index:04}.{ending}")
}
