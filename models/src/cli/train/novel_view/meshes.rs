//! The folder of meshes for training or evaluation.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gradreel::{Error, ErrorKind, Key, Result};
use serde::{Deserialize, Serialize};

use super::settings::Settings;
use crate::cli::source::whole;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::views::objects::{FolderSettings, MeshFile, MeshFolder, Object, Sample};

/// Maximum number of unusable files named on the terminal; the table lists all.
const NAMED: usize = 8;
const TABLE: &str = "meshes.csv";

/// The table `objects` of the settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Meshes {
    pub folder: String,
    /// Share of the files held out from training.
    pub held_out: f64,
    /// Share of the training samples that show procedural objects instead.
    pub procedural: f64,
    /// Size of the mesh cache in megabytes.
    pub memory_mb: u64,
    /// Fingerprint of the folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    mark: Option<String>,
}

impl Default for Meshes {
    fn default() -> Self {
        let FolderSettings { held_out, memory } = FolderSettings::default();
        Self { folder: String::new(), held_out, procedural: 0.0, memory_mb: memory as u64 >> 20, mark: None }
    }
}

/// Source of the samples' objects.
#[derive(Clone)]
pub(super) enum Objects {
    /// Procedural.
    Made,
    /// From files, except for a share of the training samples.
    Meshes { folder: Arc<MeshFolder>, procedural: f64 },
}

/// Key fold that decides between a mesh and a procedural object.
const MADE: u64 = 104;

impl Meshes {
    /// Sets the folder.
    pub fn set(&mut self, folder: &Path) {
        self.folder = whole(folder).display().to_string();
    }

    /// Prepares for a new run, with another folder if one is given.
    pub fn begin(&mut self, folder: Option<&Path>) {
        let own = self.folder.clone();
        if let Some(folder) = folder.or((!own.is_empty()).then_some(Path::new(&own))) {
            self.set(folder);
        }
        self.mark = None;
    }

    /// The first invalid setting and its valid range.
    pub fn wrong(&self) -> Option<(&'static str, &'static str)> {
        [
            ("objects.folder", !self.folder.is_empty(), "a folder with meshes"),
            ("objects.held_out", (0.0..=1.0).contains(&self.held_out), "a share, 0 to 1"),
            ("objects.procedural", (0.0..=1.0).contains(&self.procedural), "a share, 0 to 1"),
            ("objects.memory_mb", self.memory_mb <= 1 << 30, "megabytes, at most 2^30"),
        ]
        .into_iter()
        .find_map(|(name, fits, wanted)| (!fits).then_some((name, wanted)))
    }
}

impl Objects {
    /// Opens the objects given by the settings, which store the folder's fingerprint so that a resumed run uses the
    /// same files.
    pub fn open(settings: &mut Settings, progress: &Progress) -> Result<Self> {
        let Some(meshes) = &mut settings.objects else { return Ok(Self::Made) };
        let root = Path::new(&meshes.folder);
        let stage = progress.stage("reading meshes", 0);
        let read = AtomicU64::new(0);
        let memory = usize::try_from(meshes.memory_mb << 20).unwrap_or(usize::MAX);
        let folder = MeshFolder::open(root, FolderSettings { held_out: meshes.held_out, memory }, &|| {
            stage.set(read.fetch_add(1, Ordering::Relaxed) + 1, "");
        })?;
        stage.finish("");
        let found = folder.mark();
        if meshes.mark.as_ref().is_some_and(|mark| *mark != found) {
            return Err(Error::new(ErrorKind::Input, "the meshes changed since the run was begun")
                .at(root.display())
                .found("other files, or files of other lengths")
                .wanted("those that are listed in meshes.csv")
                .fix(
                    "bring them back, give the folder that has them to --objects, or begin again with another --out",
                ));
        }
        meshes.mark = Some(found);
        Ok(Self::Meshes { folder: Arc::new(folder), procedural: meshes.procedural })
    }

    /// Rejects a folder without training files.
    pub fn can_train(&self) -> Result<()> {
        match self {
            Self::Meshes { folder, .. } if folder.trained().len() == 0 => {
                Err(Error::new(ErrorKind::Input, "no mesh is left to train on")
                    .at("objects.held_out")
                    .found(format!("all of {} held out", folder.unseen().len()))
                    .wanted("less than 1")
                    .fix("lower it in the file of --config"))
            }
            _ => Ok(()),
        }
    }

    /// The training sample of a key.
    pub fn sample(&self, key: Key, settings: &Settings) -> Result<Sample> {
        let made = || Object::new(Sample::object_key(key), settings.data.nodes);
        let object = match self {
            Self::Made => made(),
            Self::Meshes { procedural, .. } if key.fold(MADE).uniform(1).all(|chance| chance < *procedural) => made(),
            Self::Meshes { folder, .. } => folder.object(Sample::object_key(key))?,
        };
        Ok(self.filmed(&object, key, settings))
    }

    /// The held-out sample of a key and an index.
    pub fn unseen(&self, number: usize, key: Key, settings: &Settings) -> Result<Sample> {
        match self {
            Self::Made => self.sample(key, settings),
            Self::Meshes { folder, .. } => {
                Ok(self.filmed(&folder.unseen_object(number, Sample::object_key(key))?, key, settings))
            }
        }
    }

    fn filmed(&self, object: &Object, key: Key, settings: &Settings) -> Sample {
        Sample::of(object, key, &settings.model.denoiser.ring, settings.model.image, &settings.data)
    }

    /// Writes a table of all files and their use into the folder of a run.
    pub fn list(&self, run: &RunFolder) -> Result<()> {
        let Self::Meshes { folder, .. } = self else { return Ok(()) };
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut table = "file,trained,shown,triangles,why_not\n".to_owned();
        for file in folder.files() {
            let triangles = file.triangles.as_ref().map_or(String::new(), ToString::to_string);
            let why = file.why().map_or(String::new(), |why| quoted(&why));
            table += &format!("{},{},{},{triangles},{why}\n", quoted(&file.name), file.trained, file.shown);
        }
        run.write(TABLE, table.as_bytes())
    }

    /// Counts of usable and omitted meshes, for display.
    pub fn described(&self) -> Option<String> {
        let Self::Meshes { folder, .. } = self else { return None };
        let (trained, unseen) = (folder.trained().len(), folder.unseen().len());
        let mut told = match folder.is_divided() {
            true => format!("{} meshes: {trained} to train on, {unseen} never trained on", trained + unseen),
            false => format!(
                "{trained} mesh{} to train on; none is held out, so that the objects that are called unseen are the same",
                if trained == 1 { "" } else { "es" }
            ),
        };
        let broken: Vec<_> = folder.files().iter().filter_map(MeshFile::why).collect();
        if !broken.is_empty() {
            told += &format!("\n{} files cannot be used and are left out (all are in {TABLE}):", broken.len());
        }
        for why in broken.iter().take(NAMED) {
            told += &format!("\n  {why}");
        }
        Some(told)
    }
}
