//! Films whose object a network tells, and networks that are none.

use std::fs;
use std::path::PathBuf;

use gradreel::{Error, ErrorKind};
use gradreel_models::video::{Film, FilmSettings, Foreground, MattingSettings, OpenOptions};
use tempfile::TempDir;

use super::onnx_file::{Network, field};

const SIDE: usize = 48;
const FRAMES: usize = 4;

/// How far a pixel is inside a disc that falls \[pixels\].
fn inside(frame: usize, i: usize) -> f64 {
    let (x, y) = ((i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5);
    12.0 - (x - 24.0).hypot(y - 16.0 - 3.0 * frame as f64)
}

/// A dark red disc with a soft edge before a light, mottled background.
fn colour(frame: usize, i: usize) -> [u8; 3] {
    let share = (0.5 + inside(frame, i) / 6.0).clamp(0.0, 1.0);
    let light = 210.0 + (i * 7 % 23) as f64;
    [180.0, 40.0, 30.0].map(|dark| (share * dark + (1.0 - share) * light).round() as u8)
}

/// A folder with the film and what a test puts there.
struct Scene(TempDir);

impl Scene {
    fn new() -> Self {
        let scene = Self(TempDir::new().unwrap());
        fs::create_dir(scene.path("film")).unwrap();
        for frame in 0..FRAMES {
            let file = fs::File::create(scene.path(&format!("film/{frame}.png"))).unwrap();
            let mut encoder = png::Encoder::new(file, SIDE as u32, SIDE as u32);
            encoder.set_color(png::ColorType::Rgb);
            let pixels: Vec<u8> = (0..SIDE * SIDE).flat_map(|i| colour(frame, i)).collect();
            encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        }
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, matting: MattingSettings) -> Result<Film, Error> {
        let settings = FilmSettings { frames_per_s: 24.0, matting: Some(matting), ..FilmSettings::default() };
        Film::read(&self.path("film"), &settings, &OpenOptions::default())
    }

    /// The film by a network with these bytes.
    fn told_by(&self, bytes: &[u8], settings: MattingSettings) -> Result<Film, Error> {
        fs::write(self.path("net.onnx"), bytes).unwrap();
        self.read(MattingSettings { model: self.path("net.onnx"), ..settings })
    }

    #[track_caller]
    fn refuses(&self, bytes: &[u8], parts: &[&str]) {
        let error = self.told_by(bytes, plain()).expect_err("a network that cannot be used");
        let message = error.to_string();
        for part in parts.iter().chain(&["net.onnx", "found: ", "wanted: ", "fix: "]) {
            assert!(message.contains(part), "no {part:?} in: {message}");
        }
    }
}

/// Pictures from 0 to 1 as they are.
fn plain() -> MattingSettings {
    MattingSettings { mean: [0.0; 3], deviation: [1.0; 3], ..MattingSettings::default() }
}

/// Whatever is not green is the object.
const WEIGHTS: [f32; 3] = [0.5, -8.0, -0.5];
const BIAS: f32 = 4.0;

fn sum(frame: usize, i: usize) -> f64 {
    let of = colour(frame, i).into_iter().zip(WEIGHTS).map(|(v, w)| f64::from(v) / 255.0 * f64::from(w));
    of.sum::<f64>() + f64::from(BIAS)
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The largest difference of the film's coverage from what is expected of a pixel.
fn off(film: &Film, expected: impl Fn(usize, usize) -> f64) -> f64 {
    assert_eq!((film.frames.len(), film.foreground), (FRAMES, Foreground::Network));
    let differences = film.frames.iter().enumerate().flat_map(|(k, frame)| {
        let differences = frame.alpha.iter().enumerate().map(|(i, a)| (f64::from(*a) - expected(k, i)).abs());
        differences.collect::<Vec<_>>()
    });
    differences.fold(0.0, f64::max)
}

#[test]
fn a_network_tells_the_object() {
    let scene = Scene::new();
    let network = Network::of(Some(SIDE as u64), WEIGHTS, BIAS);
    let film = scene.told_by(&network.bytes(), plain()).unwrap();
    let wrong = off(&film, |k, i| logistic(sum(k, i)));
    assert!(wrong < 0.02, "{wrong}");
    // the object alone on white
    for (k, frame) in film.frames.iter().enumerate() {
        for (i, value) in frame.rgb.iter().enumerate() {
            let share = logistic(sum(k, i / 3));
            let mixed = share * f64::from(colour(k, i / 3)[i % 3]) / 255.0 + 1.0 - share;
            assert!((f64::from(*value) - mixed).abs() < 0.02, "{value}, not {mixed}");
        }
    }
    let said = film.assumptions.join("\n");
    for part in ["by a matting network", "net.onnx", "48 × 48 pixels"] {
        assert!(said.contains(part), "no {part:?} in: {said}");
    }
    assert!(!said.contains("beyond"), "{said}");
}

/// The network undoes the normalisation, channel by channel.
#[test]
fn pictures_are_normalised() {
    let scene = Scene::new();
    let usual = MattingSettings::default();
    let other = MattingSettings { mean: [0.5, 0.4, 0.3], deviation: [0.5, 0.25, 1.0], ..usual.clone() };
    for settings in [usual, other] {
        let weights = [0, 1, 2].map(|c| WEIGHTS[c] * settings.deviation[c] as f32);
        let bias = BIAS + [0, 1, 2].map(|c| WEIGHTS[c] * settings.mean[c] as f32).iter().sum::<f32>();
        let film = scene.told_by(&Network::of(Some(SIDE as u64), weights, bias).bytes(), settings).unwrap();
        let wrong = off(&film, |k, i| logistic(sum(k, i)));
        assert!(wrong < 0.02, "{wrong}");
    }
}

/// The network sees pictures of the size that is asked for, or of its own; masks have that of the film.
#[test]
fn sizes_are_open_or_the_networks_own() {
    let scene = Scene::new();
    let open = Network { inputs: vec![[None; 4]], ..Network::of(None, WEIGHTS, BIAS) };
    for (network, size, seen) in [
        (&open, 96, 96),
        (&open, 100, 96),
        (&open, 33, 32),
        (&open, 512, 512),
        (&Network::of(Some(50), WEIGHTS, BIAS), 96, 50),
    ] {
        let film = scene.told_by(&network.bytes(), MattingSettings { size, ..plain() }).unwrap();
        assert!(film.assumptions.iter().any(|line| line.contains(&format!("sees {seen} × {seen} pixels"))));
        let near = off(&film, |k, i| logistic(sum(k, i)));
        // the mottled background and the edge are blurred a little
        assert!(near < 0.08, "{size}: {near}");
    }
}

#[test]
fn values_beyond_0_to_1() {
    let scene = Scene::new();
    let side = Some(SIDE as u64);
    let said = |film: &Film, what: &str| film.assumptions.iter().any(|line| line.contains(what));
    let logits = Network { last: ("Identity", &[]), ..Network::of(side, WEIGHTS, BIAS) };
    let film = scene.told_by(&logits.bytes(), plain()).unwrap();
    assert!(off(&film, |k, i| logistic(sum(k, i))) < 0.02 && said(&film, "logits"));
    // grey levels of a matte, if not quite from 0 to 255
    let levels = Network { last: ("Identity", &[]), ..Network::of(side, [0.0, -200.0, 0.0], 210.0) };
    let film = scene.told_by(&levels.bytes(), plain()).unwrap();
    let green = |k: usize, i: usize| f64::from(colour(k, i)[1]);
    let range = |k: usize| {
        let all = || (0..SIDE * SIDE).map(|i| green(k, i));
        [all().fold(f64::MAX, f64::min), all().fold(f64::MIN, f64::max)]
    };
    let ranges: Vec<_> = (0..FRAMES).map(range).collect();
    let stretched = |k: usize, i: usize| (ranges[k][1] - green(k, i)) / (ranges[k][1] - ranges[k][0]);
    assert!(off(&film, stretched) < 0.02 && said(&film, "stretched to 0 to 1"));
}

#[test]
fn outputs_of_three_axes() {
    let scene = Scene::new();
    let network = Network { last: ("Squeeze", &[1]), ..Network::of(Some(SIDE as u64), WEIGHTS, BIAS) };
    let film = scene.told_by(&network.bytes(), plain()).unwrap();
    assert!(off(&film, |k, i| logistic(sum(k, i))) < 0.02);
}

#[test]
fn networks_for_something_else() {
    let scene = Scene::new();
    let side = Some(SIDE as u64);
    let good = || Network::of(side, WEIGHTS, BIAS);
    let two = vec![[Some(1), Some(3), side, side]; 2];
    for (network, part) in [
        (Network { last: ("Dream", &[]), ..good() }, "Dream"),
        (Network { inputs: two, ..good() }, "2 inputs and 1 outputs"),
        (Network { inputs: vec![], ..good() }, "in0"),
        (Network { inputs: vec![[Some(1), Some(4), side, side]], ..good() }, "[1, 4, 48, 48]"),
        (Network { inputs: vec![[Some(1), side, side, Some(3)]], ..good() }, "[1, 48, 48, 3]"),
        (Network { inputs: vec![[Some(2), Some(3), None, None]], ..good() }, "[2, 3, ?, ?]"),
        (Network { numbers: 7, ..good() }, "[1, 3, 48, 48]"),
        (Network::of(Some(1 << 40), WEIGHTS, BIAS), "1099511627776"),
        (Network::of(Some(0), WEIGHTS, BIAS), "0 × 0"),
        (Network { channels: 2, ..good() }, "[1, 2, 48, 48]"),
        (Network { last: ("Squeeze", &[0, 1]), ..good() }, "2"),
        (Network { last: ("ArgMax", &[]), ..good() }, "32"),
    ] {
        scene.refuses(&network.bytes(), &[part]);
    }
    let dark = Network { last: ("Log", &[]), ..Network::of(side, [0.0; 3], -1.0) };
    let error = scene.told_by(&dark.bytes(), plain()).unwrap_err();
    assert!(error.kind() == ErrorKind::NonFinite && error.to_string().contains("net.onnx"), "{error}");
    // one that sees nothing is as good as one that is not there
    let error = scene.told_by(&Network::of(side, [0.0; 3], -9.0).bytes(), plain()).unwrap_err().to_string();
    assert!(error.contains("told by a matting network"), "{error}");
}

/// Each ends as an error, or as a network that is a little different, but never as a panic or the end of the process.
#[test]
fn files_that_are_damaged() {
    let scene = Scene::new();
    let good = Network::of(Some(SIDE as u64), WEIGHTS, BIAS).bytes();
    for end in (0..good.len()).step_by(16) {
        scene.refuses(&good[..end], &[]);
    }
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    for _ in 0..64 {
        let bytes: Vec<u8> = (0..200).map(|_| random() as u8).collect();
        scene.refuses(&bytes, &[]);
        let mut bytes = good.clone();
        for _ in 0..=random() % 3 {
            bytes[random() % good.len()] = random() as u8;
        }
        let _ = scene.told_by(&bytes, plain());
    }
    // text of another file, graphs in graphs, a field of a thousand gigabytes, and operators in a row without end
    scene.refuses(b"<html><body>404 Not Found</body></html>", &[]);
    let nested = (0..5000).fold(vec![], |inside, _| field(1, &field(5, &field(6, &inside))));
    scene.refuses(&[&[8, 8][..], &field(7, &nested)].concat(), &["nest"]);
    scene.refuses(&[8, 8, 18, 0x80, 0x80, 0x80, 0x80, 0x80, 0x20], &["beyond"]);
    let row = |k: usize| {
        let [from, to] = [k, k + 1].map(|k| format!("v{k}"));
        field(1, &[field(1, from.as_bytes()), field(2, to.as_bytes()), field(4, b"Relu")].concat())
    };
    scene.refuses(&[&[8, 8][..], &field(7, &vec![row(0); 100_001].concat())].concat(), &["100000 operators"]);
}

#[test]
fn what_a_download_left_is_named() {
    let scene = Scene::new();
    scene.refuses(b"", &["an empty file"]);
    scene.refuses(b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 9\n", &["Git LFS", "git lfs pull"]);
    scene.refuses(b"<!DOCTYPE html><html><title>Sign in</title></html>", &["a web page, \"Sign in\""]);
    scene.refuses(b"{\"error\": \"not found\"}", &["JSON text"]);
}

#[test]
fn settings_of_networks() {
    let scene = Scene::new();
    let missing = MattingSettings { model: scene.path("none.onnx"), ..plain() };
    let error = scene.read(missing).unwrap_err();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("none.onnx"), "{error}");
    let folder = scene.read(MattingSettings { model: scene.path("film"), ..plain() }).unwrap_err();
    assert!(folder.to_string().contains("cannot read the matting network"), "{folder}");
    let model = scene.path("net.onnx");
    for (settings, part) in [
        (MattingSettings { model: PathBuf::new(), ..plain() }, "clip.film.matting.model"),
        (
            MattingSettings { model: model.clone(), deviation: [1.0, 0.0, 1.0], ..plain() },
            "clip.film.matting.deviation",
        ),
        (MattingSettings { model: model.clone(), mean: [f64::NAN; 3], ..plain() }, "clip.film.matting.mean"),
        (MattingSettings { model: model.clone(), size: 1 << 20, ..plain() }, "clip.film.matting.size"),
    ] {
        let error = scene.read(settings).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    let both = FilmSettings {
        masks: Some(scene.path("film")),
        matting: Some(MattingSettings { model, ..plain() }),
        ..FilmSettings::default()
    };
    assert!(both.check().unwrap_err().to_string().contains("one of masks, background and matting"));
}
