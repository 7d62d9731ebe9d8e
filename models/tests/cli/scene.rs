//! Runs of the program, and small copies of the bundled clip in a folder of their own.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use gradreel::Tensor;
use gradreel::io::TensorFile;
use serde_json::Value;
use tempfile::TempDir;

/// Settings of a run of a second or two: few iterations on few pixels.
pub const QUICK: &str = "[clip]\nshrink = 5\n[geometry]\ndx = 0.05\n[geometry.fit]\niterations = 6\nin_motion = 2\n\
                         [estimate]\nvelocity = 2\npoints = 1\nsurvivors = 1\nsteps = 1\n";

/// A folder of the test's own that goes away with it.
pub struct Scene(TempDir);

impl Scene {
    pub fn new() -> Self {
        let scene = Self(TempDir::new().unwrap());
        scene.write("quick.toml", QUICK);
        scene
    }

    /// A scene with a folder `clip`: these cameras and so many frames of the bundled clip, with background plates.
    pub fn with_clip(cameras: &[i64], frames: i64) -> Self {
        let scene = Self::new();
        scene.copy_clip("clip", cameras, frames);
        scene
    }

    pub fn copy_clip(&self, name: &str, cameras: &[i64], frames: i64) {
        let (from, to) = (bundled(), self.path(name));
        fs::create_dir_all(to.join("data")).unwrap();
        let list: Vec<Value> = serde_json::from_slice(&fs::read(from.join("all_data.json")).unwrap()).unwrap();
        let wanted: Vec<String> = cameras
            .iter()
            .flat_map(|camera| (-1..frames).map(move |frame| format!("./data/r_{camera}_{frame}.png")))
            .collect();
        for file in &wanted {
            fs::copy(from.join(file), to.join(file)).unwrap();
        }
        let kept: Vec<Value> =
            list.into_iter().filter(|e| wanted.iter().any(|file| e["file_path"] == file.as_str())).collect();
        assert_eq!(kept.len(), wanted.len(), "the bundled clip has every image");
        fs::write(to.join("all_data.json"), Value::from(kept).to_string()).unwrap();
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    /// The program in this folder, not yet started.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gradreel"));
        command.args(arguments.split_whitespace()).current_dir(&self.0);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs the program, which must finish; returns its standard output.
    #[track_caller]
    pub fn succeeds(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments}: {}", text(&output.stderr));
        text(&output.stdout)
    }

    /// Runs the program, which must refuse its input, say all of `parts` and a way out, and change nothing here.
    #[track_caller]
    pub fn refuses(&self, arguments: &str, parts: &[&str]) {
        let before = contents(self.0.path());
        let output = self.run(arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {message}");
        for part in parts.iter().chain(&["error: ", "fix: "]) {
            assert!(message.contains(part), "{arguments}: no {part:?} in: {message}");
        }
        assert!(!message.contains("panicked"), "{message}");
        assert!(before == contents(self.0.path()), "{arguments}: a refused run leaves everything as it was");
    }

    /// The estimates of a run.
    pub fn parameters(&self, out: &str) -> Value {
        let file = fs::read(self.path(out).join("parameters.json")).unwrap();
        serde_json::from_slice::<Value>(&file).unwrap()["parameters"].take()
    }

    /// The state of a run.
    pub fn state(&self, out: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(out).join("state.json")).unwrap()).unwrap()
    }
}

/// The clip that comes with the sources.
pub fn bundled() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/clips/bird")
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Every file below a folder with its bytes; folders have none.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
            found.insert(path, None);
        } else {
            found.insert(path.clone(), Some(fs::read(&path).unwrap()));
        }
    }
    found
}

/// Asserts that two folders of trainings hold the same files, bit for bit; the order of a file's metadata is any.
#[track_caller]
pub fn same_runs(ours: &Path, theirs: &Path) {
    let files = |root: &Path| -> Vec<(PathBuf, Option<Vec<u8>>)> {
        let all = contents(root).into_iter();
        all.map(|(path, bytes)| (path.strip_prefix(root).unwrap().to_owned(), bytes)).collect()
    };
    let bits = |file: &TensorFile| -> Vec<(String, Vec<u32>)> {
        let of = |value: &Tensor| value.slice::<f32>().iter().map(|v| v.to_bits()).collect();
        file.tensors.iter().map(|(name, value)| (name.clone(), of(value))).collect()
    };
    let same = |ours: &Option<Vec<u8>>, theirs: &Option<Vec<u8>>| match (ours, theirs) {
        (Some(ours), Some(theirs)) if ours != theirs => {
            let [ours, theirs] = [ours, theirs].map(|bytes| TensorFile::from_bytes(bytes).unwrap());
            ours.metadata == theirs.metadata && bits(&ours) == bits(&theirs)
        }
        (ours, theirs) => ours == theirs,
    };
    let (ours, theirs) = (files(ours), files(theirs));
    assert_eq!(ours.len(), theirs.len());
    for ((path, ours), (other, theirs)) in ours.iter().zip(&theirs) {
        assert!(path == other && same(ours, theirs), "{} differs", path.display());
    }
}
