//! `gradreel synthesize`: what a run leaves, that it can be stopped and gone on with, and what it refuses.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use gradreel::io::TensorFile;
use gradreel::{DType, Tensor};
use gradreel_models::video::{Clip, OpenOptions};
use gradreel_models::views::ModelSizes;

use crate::model::{ball, weights};
use crate::scene::{Scene, contents, text};

const RUN: &str = "synthesize ball.png --weights tiny.safetensors --elevation 20 --out out";
const RESUME: &str = "synthesize ball.png --weights tiny.safetensors --out out --resume";

fn scene() -> Scene {
    let scene = Scene::new();
    weights().write(scene.path("tiny.safetensors")).unwrap();
    ball(scene.path("ball.png"), [0; 4]);
    scene
}

/// Everything that was made of the latents, and these.
fn made(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let all = contents(folder).into_iter().filter_map(|(path, bytes)| Some((path, bytes?)));
    let result = |path: &Path| {
        let name = path.file_name().unwrap().to_str().unwrap();
        !["settings.toml", "index.html", "state.safetensors"].contains(&name)
    };
    all.filter(|(path, _)| result(path))
        .map(|(path, bytes)| (path.strip_prefix(folder).unwrap().to_owned(), bytes))
        .collect()
}

#[test]
fn a_run_leaves_a_clip_and_pictures() {
    let scene = scene();
    let printed = scene.succeeds(&format!("{RUN} --steps 3"));
    assert!(printed.contains("index.html"), "{printed}");
    let out = scene.path("out");
    let latents = TensorFile::read(out.join("latents.safetensors")).unwrap();
    assert_eq!(latents.get("latents").unwrap().dims(), [1, 4, 4, 8, 8]);

    let printed = scene.succeeds("check out");
    for part in ["4 cameras", "16 × 16", "ready to open"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    let clip = Clip::open(&out, &OpenOptions::default()).unwrap();
    assert_eq!((clip.cameras.len(), clip.frame_count()), (4, 1));
    for camera in &clip.cameras {
        // all look at the object, in the middle of the picture
        let [u, v, depth] = camera.project([0.0; 3]).unwrap();
        assert!((u - 8.0).abs() < 1e-9 && (v - 8.0).abs() < 1e-9 && (depth - 1.5).abs() < 1e-9);
    }

    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let animation = fs::read(out.join("around.gif")).unwrap();
    let mut decoder = options.read_info(&animation[..]).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        assert_eq!((frame.width, frame.height), (16, 16));
        frames.push(frame.buffer.to_vec());
    }
    assert!(frames.len() == 4 && frames[0] != frames[2]);
    for (file, side) in [("views.png", 32), ("input.png", 16), ("preview.png", 64), ("data/r_3_0.png", 16)] {
        let file = std::io::BufReader::new(fs::File::open(out.join(file)).unwrap());
        let reader = png::Decoder::new(file).read_info().unwrap();
        assert_eq!((reader.info().width, reader.info().height), (side, side));
    }
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    for part in ["ball.png", "data:image/gif;base64,", "20° (given)", "tiny.safetensors", "views.png"] {
        assert!(page.contains(part), "no {part:?}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("href=\"http"));
    let left = contents(&out).into_keys().filter(|path| path.extension().is_some_and(|e| e == "partial"));
    assert_eq!(left.count(), 0);
}

#[test]
fn threads_and_memory_change_nothing() {
    let scene = scene();
    let run = |threads: &str| {
        let mut command = scene.command(&format!("{RUN}-{threads} --steps 3"));
        let output = command.env("RAYON_NUM_THREADS", threads).output().unwrap();
        let told = text(&output.stderr);
        assert!(output.status.success(), "{told}");
        (made(&scene.path(&format!("out-{threads}"))), told)
    };
    let (one, told) = run("1");
    assert!(told.contains("4 views, 1 at once"), "{told}");
    let (three, told) = run("3");
    assert!(told.contains("4 views, 3 at once"), "{told}");
    assert!(one == three);
    assert!(one.len() >= 4 * 2 + 6, "{:?}", one.keys());
}

#[cfg(unix)]
#[test]
fn a_run_goes_on_where_it_was_stopped() {
    use std::io::Read;
    use std::process::Command;

    let scene = scene();
    let mut child = scene.command(&format!("{RUN} --steps 40 --seed 3")).spawn().unwrap();
    while !scene.path("out/preview.png").is_file() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it took a step");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{told}");
    assert!(told.contains(RESUME) && !told.contains("panicked"), "{told}");
    assert!(!scene.path("out/index.html").exists(), "nothing is claimed that was not found");

    // the picture and the weights may have moved
    fs::create_dir(scene.path("moved")).unwrap();
    for file in ["ball.png", "tiny.safetensors"] {
        fs::rename(scene.path(file), scene.path(&format!("moved/{file}"))).unwrap();
    }
    let resume = RESUME.replace("ball", "moved/ball").replace("tiny", "moved/tiny");
    scene.succeeds(&format!("{resume} --memory 20MB"));
    let straight = resume.replace("out --resume", "straight --elevation 20 --steps 40 --seed 3");
    scene.succeeds(&straight);
    assert!(made(&scene.path("out")) == made(&scene.path("straight")));

    // a finished run has nothing left to sample, and says the same again
    let before = made(&scene.path("out"));
    scene.succeeds(&resume);
    assert!(made(&scene.path("out")) == before);
}

#[test]
fn seeds_and_elevations_change_the_views() {
    let scene = scene();
    let latents = |out: &str, more: &str| {
        scene.succeeds(&format!("{RUN}-{out} --steps 2 --quiet {more}"));
        fs::read(scene.path(&format!("out-{out}/latents.safetensors"))).unwrap()
    };
    let first = latents("a", "");
    assert!(first == latents("b", "--seed 0 --guidance 2 --crop 200 --device cpu"));
    for (out, more) in [("c", "--seed 1"), ("d", "--guidance 1"), ("e", "--crop 0")] {
        assert!(first != latents(out, more), "{more}");
    }
}

/// The model that comes with the program: whole, within its size, and red where the picture is.
#[test]
fn the_built_in_model() {
    let scene = scene();
    let printed = scene.succeeds("weights check built-in");
    assert!(printed.contains("gradreel") || !printed.is_empty(), "{printed}");
    scene.succeeds("synthesize ball.png --elevation 30 --steps 4 --guidance 1 --out out --quiet");
    let views: Vec<_> = (0..16).map(|view| scene.path(&format!("out/data/r_{view}_0.png"))).collect();
    assert!(views.iter().all(|view| view.is_file()));
    let settings = fs::read_to_string(scene.path("out/settings.toml")).unwrap();
    assert!(settings.contains("path = \"built-in\"") && settings.contains("crop = 128"), "{settings}");
    scene.succeeds("synthesize ball.png --out out --resume --quiet");
    let size = fs::metadata(concat!(env!("CARGO_MANIFEST_DIR"), "/weights/novel_view.safetensors")).unwrap().len();
    assert!(size <= 20_000_000, "{size} bytes");
}

#[test]
fn weights_that_do_not_fit() {
    let scene = scene();
    scene.refuses(&RUN.replace("tiny", "nowhere"), &["nowhere.safetensors"]);
    scene.write("junk.safetensors", [7; 100]);
    scene.refuses(&RUN.replace("tiny", "junk"), &["junk.safetensors"]);

    let mut odd = weights();
    odd.tensors.remove("cc_projection.bias");
    odd.tensors.insert("model.diffusion_model.out.2.bias".into(), Tensor::zeros([3], DType::F32));
    odd.write(scene.path("odd.safetensors")).unwrap();
    scene.refuses(
        &RUN.replace("tiny", "odd"),
        &["odd.safetensors", "cc_projection.bias", "diffusion_model.out.2.bias: [3]"],
    );

    let mut plain = weights();
    plain.metadata.clear();
    plain.write(scene.path("plain.safetensors")).unwrap();
    scene.refuses(&RUN.replace("tiny", "plain"), &["plain.safetensors", "of another shape", "time_embed.0.weight"]);

    let mut sizes = weights();
    let changed =
        sizes.metadata[ModelSizes::METADATA].replace("\"heads\": 2, \"context\"", "\"heads\": 3, \"context\"");
    sizes.metadata.insert(ModelSizes::METADATA.into(), changed);
    sizes.write(scene.path("sizes.safetensors")).unwrap();
    scene.refuses(&RUN.replace("tiny", "sizes"), &["sizes.safetensors", "denoiser.unet.heads"]);
}

#[test]
fn pictures_that_cannot_be_used() {
    let scene = scene();
    let with = |name: &str| RUN.replace("ball.png", name);
    scene.refuses(&with("nowhere.png"), &["nowhere.png"]);
    let whole = fs::read(scene.path("ball.png")).unwrap();
    scene.write("half.png", &whole[..whole.len() / 2]);
    scene.refuses(&with("half.png"), &["half.png", "decode"]);
    scene.write("text.png", "no picture");
    scene.refuses(&with("text.png"), &["text.png", "PNG"]);
    scene.write("half.jpg", [0xff, 0xd8, 0xff, 0xe0, 0, 16]);
    scene.refuses(&with("half.jpg"), &["half.jpg", "JPEG"]);
    ball(scene.path("street.png"), [90, 120, 60, 255]);
    scene.refuses(&with("street.png"), &["street.png", "background"]);
}

#[test]
fn a_picture_on_white_is_as_good_as_one_with_transparency() {
    let scene = scene();
    ball(scene.path("white.png"), [255; 4]);
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/ball.jpg"), scene.path("ball.jpg")).unwrap();
    let seen = |name: &str| {
        scene.succeeds(&format!("{}-{name} --steps 1 --quiet", RUN.replace("ball.png", name)));
        let file = fs::File::open(scene.path(&format!("out-{name}/input.png"))).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels
    };
    let transparent = seen("ball.png");
    assert_eq!(transparent[..3], [255; 3], "what surrounds the object is white");
    assert!(transparent.chunks(3).any(|pixel| pixel[0] > 150 && pixel[1] < 80), "the object is red");
    assert!(seen("white.png") == transparent);
    let jpeg = seen("ball.jpg");
    // its edges are soft: the object's box may be a pixel wider
    let apart: f64 = jpeg.iter().zip(&transparent).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    assert!(apart / (jpeg.len() as f64) < 20.0, "{apart}");
}

#[test]
fn settings_without_sense() {
    let scene = scene();
    for (more, part) in [
        ("--steps 0", "steps"),
        ("--steps 1001", "steps"),
        ("--guidance nan", "guidance"),
        ("--crop 300", "--crop"),
        ("--memory 10KB", "--memory"),
    ] {
        scene.refuses(&format!("{RUN} {more}"), &[part]);
    }
    scene.refuses(&RUN.replace("20", "100"), &["elevation", "100"]);
    scene.refuses(&RUN.replace("20", "nan"), &["elevation"]);
    // settings belong to the run: they are not to be given again
    for arguments in [&format!("{RESUME} --seed 1"), "synthesize ball.png --weights tiny.safetensors", "synthesize"] {
        assert_eq!(scene.run(arguments).status.code(), Some(2), "{arguments}");
    }
    let largest = format!("{RUN}-largest --steps 1 --seed {}", i64::MAX);
    scene.succeeds(&largest);
    assert_eq!(scene.run(&format!("{RUN} --seed 9223372036854775808")).status.code(), Some(2));
    scene.refuses(&RUN.replace("ball.png", "."), &["the picture"]);
    let memory = scene.run(&format!("{RUN} --memory lots"));
    assert!(text(&memory.stderr).contains("500MB"), "{}", text(&memory.stderr));
}

#[test]
fn runs_that_cannot_be_gone_on_with() {
    let scene = scene();
    scene.refuses(RESUME, &["out"]);
    fs::create_dir(scene.path("out")).unwrap();
    scene.refuses(RESUME, &["out", "no run"]);
    scene.succeeds(&format!("{RUN} --steps 2"));
    scene.refuses(RUN, &["out", "not empty"]);
    ball(scene.path("other.png"), [255; 4]);
    scene.refuses(&RESUME.replace("ball", "other"), &["other.png", "ball.png", "changed"]);
    let mut weights = weights();
    weights.metadata.insert("note".into(), "another file".into());
    weights.write(scene.path("second.safetensors")).unwrap();
    scene.refuses(&RESUME.replace("tiny", "second"), &["second.safetensors", "changed"]);

    let state = fs::read(scene.path("out/state.safetensors")).unwrap();
    for bytes in [&state[..state.len() / 2], b""] {
        scene.write("out/state.safetensors", bytes);
        scene.refuses(RESUME, &["out/state.safetensors"]);
    }
    scene.write("out/state.safetensors", &state);
    let settings = fs::read_to_string(scene.path("out/settings.toml")).unwrap();
    for (from, to, part) in [("seed = 0", "seed = 1", "does not belong"), ("seed = 0", "", "damaged")] {
        assert!(settings.contains(from), "{settings}");
        scene.write("out/settings.toml", settings.replace(from, to));
        scene.refuses(RESUME, &["out/s", part]);
    }
    scene.write("out/settings.toml", &settings);
    scene.succeeds(RESUME);
}

#[test]
fn the_help_says_where_weights_are_to_be_had() {
    let scene = Scene::new();
    for help in ["synthesize --help", "synthesize -h"] {
        let printed = scene.succeeds(help);
        for part in
            ["syncdreamer-pretrain.ckpt", "github.com/liuyuan-pal/SyncDreamer", "comes with gradreel", "--elevation"]
        {
            assert!(
                printed.split_whitespace().collect::<Vec<_>>().join(" ").contains(part),
                "no {part:?} in {printed}"
            );
        }
    }
}
