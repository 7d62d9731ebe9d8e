//! The particles of a scene between its pictures.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::scenes::{Film, FilmSettings, Runner, SceneFile, Setup};
use crate::video::Camera;

/// Least number of states a second, and between two pictures.
const STATES: (f64, f64) = (480.0, 4.0);
/// Most bytes of all states.
const BYTES: usize = 1 << 30;

/// A simulated scene.
pub(super) struct Motion {
    /// Time between states \[s\].
    dt: f64,
    /// Positions \[m\] in each state, by particle.
    states: Vec<Vec<[f32; 3]>>,
    /// Particles of each object.
    pub objects: Vec<std::ops::Range<usize>>,
    pub colours: Vec<[f32; 3]>,
    pub spacings: Vec<f64>,
    pub floor: f64,
    pub camera: Camera,
    /// Downward acceleration \[m/s²\].
    pub gravity: f64,
}

impl Motion {
    /// Simulates a scene; files that it names are relative to `folder`.
    pub fn simulate(file: &SceneFile, folder: &Path, settings: &FilmSettings, progress: &Progress) -> Result<Self> {
        let mut file = file.clone();
        let rate = file.time.frames_per_s;
        file.time.frames_per_s = rate * (STATES.0 / rate).ceil().max(STATES.1);
        // the substeps that a file gives are those of its own frames
        let share = rate / file.time.frames_per_s;
        file.time.substeps_per_frame =
            file.time.substeps_per_frame.map(|count| ((count as f64 * share).ceil() as usize).max(1));
        let setup = Setup::of(&file, folder)?;
        let film = Film::of(&setup, settings)?;
        let Some(floor) = setup.floor() else {
            return Err(Error::new(ErrorKind::Input, "a scene without a floor makes no film of a phone")
                .at("ground")
                .wanted("[ground] in the scene file")
                .fix("add it"));
        };
        let bytes = setup.len() * setup.schedule.frames * size_of::<[f32; 3]>();
        if bytes > BYTES {
            return Err(Error::new(ErrorKind::Input, "the scene is too long, or too finely divided, for such a film")
                .at("time.duration_s")
                .found(format!("{} particles in {} states", setup.len(), setup.schedule.frames))
                .wanted(format!("{} MiB of positions at most", BYTES >> 20))
                .fix("shorten it, or widen grid.spacing_m"));
        }
        let mut runner = Runner::<f32>::new(&setup)?;
        let stage = progress.stage("simulating", setup.schedule.frames as u64 - 1);
        let mut states = vec![runner.frame().positions];
        while states.len() < setup.schedule.frames {
            if !runner.advance(|| !interrupt::requested())? {
                super::go_on()?;
            }
            states.push(runner.frame().positions);
            stage.set(states.len() as u64 - 1, "");
        }
        stage.finish("");
        let mut objects = Vec::new();
        let mut from = 0;
        for part in setup.object_of.chunk_by(|a, b| a == b) {
            objects.push(from..from + part.len());
            from += part.len();
        }
        let (camera, colours, spacings) = film.of_one_camera();
        let gravity = -setup.world.gravity[1];
        Ok(Self { dt: setup.schedule.frame_dt, states, objects, colours, spacings, floor, camera, gravity })
    }

    /// Positions at a time \[m\]: at rest before the beginning, and after the end.
    pub fn at(&self, seconds: f64) -> Vec<[f32; 3]> {
        let last = self.states.len() - 1;
        let at = (seconds / self.dt).clamp(0.0, last as f64);
        let before = (at as usize).min(last.saturating_sub(1));
        let share = (at - before as f64) as f32;
        let [a, b] = [before, (before + 1).min(last)].map(|k| &self.states[k]);
        a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis]))).collect()
    }

    /// Number of the particles of the first object, which come first.
    pub fn first(&self) -> usize {
        self.objects[0].len()
    }

    /// Height of the first object's centre in each state \[m\], and the time between states \[s\].
    pub fn heights(&self) -> (Vec<f64>, f64) {
        let mean = |state: &Vec<[f32; 3]>| {
            state[..self.first()].iter().map(|x| f64::from(x[1])).sum::<f64>() / self.first() as f64
        };
        (self.states.iter().map(mean).collect(), self.dt)
    }

    /// Centre of the first object at a time \[m\].
    pub fn centre(&self, seconds: f64) -> [f64; 3] {
        let positions = self.at(seconds);
        [0, 1, 2]
            .map(|axis| positions[..self.first()].iter().map(|x| f64::from(x[axis])).sum::<f64>() / self.first() as f64)
    }
}
