//! Films of one camera on the command line.

use std::fs;

use crate::onnx_file::Network;
use crate::scene::{QUICK, Scene, bundled, text};

/// A folder of the bundled clip's first camera, without any calibration.
fn film() -> Scene {
    let scene = Scene::new();
    fs::create_dir(scene.path("film")).unwrap();
    for frame in 0..14 {
        let from = bundled().join(format!("data/r_0_{frame}.png"));
        fs::copy(from, scene.path(&format!("film/{frame}.png"))).unwrap();
    }
    scene
}

#[test]
fn a_film_is_looked_at() {
    let scene = film();
    let printed = scene.succeeds("check film --fps 24");
    for part in ["14 frames", "192 × 192", "elsewhere", "m away", "in the first 5 frames", "ground", "ready to open"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    scene.refuses("check film", &["film", "--fps"]);
}

/// What a person asks of a film, `check` and `reconstruct` take alike.
#[test]
fn options_of_films() {
    let scene = film();
    let printed = scene.succeeds("check film --fps 24 --first-frame 1 --frames 8 --config quick.toml");
    assert!(printed.contains("8 frames") && printed.contains(" across"), "{printed}");
    for command in ["check", "reconstruct"] {
        let refuses = |arguments: &str, parts: &[&str]| scene.refuses(&format!("{command} {arguments}"), parts);
        refuses("nothing.mp4", &["no such film", "nothing.mp4"]);
        refuses("quick.toml", &["quick.toml", "a file that ends in .toml"]);
        for value in ["0", "-24", "nan", "1e300"] {
            refuses(&format!("film --fps {value}"), &["--fps", "0.1 to 1e6"]);
        }
        refuses("film --fps 24 --field-of-view 0", &["--field-of-view", "1 to 150"]);
        refuses("film --fps 24 --masks film/0.png", &["0.png", "a file"]);
        refuses("film --fps 24 --frames 0", &["--frames"]);
        refuses("film --fps 24 --first-frame -1", &["frame -1"]);
        refuses("film --fps 24 --first-frame 99", &["no frame 99"]);
        refuses("film --fps 24 --frames 1", &["film"]);
        refuses("film --fps 24 --cameras 3", &["camera 3"]);
    }
    // beside frames there are a note of the computer, a background and a gap
    scene.write("film/._0.png", "Mac OS X");
    scene.write("film/background.png", fs::read(scene.path("film/0.png")).unwrap());
    let printed = scene.succeeds("check film --fps 24");
    assert!(printed.contains("14 frames") && printed.contains("no frames: background.png"), "{printed}");
    fs::remove_file(scene.path("film/4.png")).unwrap();
    scene.refuses("check film --fps 24", &["picture 4 is missing"]);
}

#[test]
fn options_of_films_are_none_of_calibrated_clips() {
    let scene = Scene::with_clip(&[0, 3], 3);
    for options in ["--fps 24", "--masks clip", "--field-of-view 40 --elevation 3"] {
        let named = options.split_whitespace().next().unwrap();
        scene.refuses(&format!("check clip {options}"), &["calibrated", named]);
        scene.refuses(&format!("reconstruct clip --out out {options}"), &["calibrated", named]);
    }
}

#[test]
fn what_is_seen_is_json_too() {
    let scene = film();
    let printed = scene.succeeds("check film --fps 24 --json");
    let seen: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!((&seen["name"], &seen["ready"]), (&"film".into(), &true.into()));
    assert_eq!((&seen["frames"], &seen["cameras"], &seen["pixels"][0]), (&14.into(), &1.into(), &192.into()));
    let number = |name: &str| seen[name].as_f64().unwrap();
    assert!((number("fps") - 24.0).abs() < 1e-9, "{printed}");
    // the bird is some 0.4 m long and about a metre away
    assert!((0.2..0.7).contains(&number("diameter_m")) && (0.8..1.4).contains(&number("distance_m")), "{printed}");
    let output = scene.run("check film --json");
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.code() == Some(2) && seen["ready"] == false, "{seen}");
    assert!(seen["problems"][0].as_str().unwrap().contains("--fps"), "{seen}");
    scene.copy_clip("clip", &[0, 3], 3);
    let seen: serde_json::Value = serde_json::from_str(&scene.succeeds("check clip --json")).unwrap();
    assert_eq!((&seen["cameras"], &seen["frames"], &seen["ready"]), (&2.into(), &3.into(), &true.into()));
}

/// The 90 % interval of a length is `exp(± 1.645 σ)` around it; of a velocity, `± 1.645 σ`.
#[test]
fn what_is_seen_has_intervals_and_phases() {
    let scene = film();
    let seen: serde_json::Value = serde_json::from_str(&scene.succeeds("check film --fps 24 --json")).unwrap();
    for name in ["diameter_m", "distance_m"] {
        let value = seen[name].as_f64().unwrap();
        let [low, high] = [0, 1].map(|end| seen["interval_90"][name][end].as_f64().unwrap());
        let deviation = seen["distance_deviation"].as_f64().unwrap();
        assert!(
            (value / low - (1.644_85 * deviation).exp()).abs() < 1e-3
                && (low * high / value.powi(2) - 1.0).abs() < 1e-9
        );
    }
    for axis in 0..3 {
        let [low, high] = [0, 1].map(|end| seen["interval_90"]["velocity_m_per_s"][axis][end].as_f64().unwrap());
        let value = seen["velocity_m_per_s"][axis].as_f64().unwrap();
        assert!(low < value && value < high && (low + high - 2.0 * value).abs() < 1e-9);
    }
    assert_eq!(seen["interval_90"]["frames"], serde_json::json!([14, 14]));
    // the bird hits the ground between frames 4 and 6
    let flight = &seen["phases"][0];
    assert_eq!((&flight["kind"], &flight["first_frame"]), (&"flight".into(), &0.into()));
    assert!((3..=6).contains(&flight["last_frame"].as_i64().unwrap()), "{flight}");
    let ends = [0, 1].map(|end| flight["interval_90"]["end_s"][end].as_f64().unwrap());
    let end = flight["end_s"].as_f64().unwrap();
    assert!(ends[0] < end && end < ends[1] && ends[1] - ends[0] < 0.2, "{flight}");
    let assumed = seen["assumed"].as_array().unwrap();
    let option = |start: &str| {
        let all = assumed.iter().find(|assumed| assumed["what"].as_str().unwrap().starts_with(start)).unwrap();
        all["option"].as_str().unwrap_or_default().to_owned()
    };
    assert_eq!(option("camera"), "--field-of-view, --elevation");
    assert!(option("the object is told").contains("--background") && option("ground") == "--ground");
}

#[test]
fn a_film_that_is_looked_at_leaves_a_page() {
    let scene = film();
    let printed = scene.succeeds("check film --fps 24");
    assert!(printed.contains("runs/check-film/index.html") && printed.contains("x to the right"), "{printed}");
    let page = fs::read_to_string(scene.path("runs/check-film/index.html")).unwrap();
    let parts = [
        "data:image/gif;base64",
        "data:image/png;base64",
        "class=\"ground\"",
        "class=\"curve\"",
        "class=\"seen\"",
        "Phase: flight",
        "Diameter",
        "Velocity up",
        "90 %",
        "--field-of-view, --elevation replaces it",
    ];
    parts.iter().for_each(|part| assert!(page.contains(part), "no {part:?}"));
    let numbers = page.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest));
    assert!(!numbers.collect::<String>().contains("NaN"));
    // never written over
    scene.succeeds("check film --fps 24");
    assert!(scene.path("runs/check-film-2/index.html").is_file());
    scene.succeeds("check film --fps 24 --out seen --json");
    assert!(scene.path("seen/index.html").is_file());
    scene.refuses("check film --fps 24 --out seen", &["seen", "not empty"]);
    scene.refuses("check film --fps 24 --out film/seen", &["film/seen", "among"]);
    scene.refuses("check film --out other", &["--fps"]);
    assert!(!scene.path("other").exists());
    scene.copy_clip("clip", &[0, 3], 3);
    scene.refuses("check clip --out other", &["--out", "calibrated"]);
}

/// What a person says of the ground and of unseen sides, `check` judges as `reconstruct` does.
#[test]
fn options_of_the_world_are_looked_at_too() {
    let scene = film();
    for command in ["check", "reconstruct"] {
        scene.refuses(&format!("{command} film --fps 24 --ground -900"), &["ground", "far"]);
        scene.refuses(&format!("{command} film --fps 24 --dx -1"), &["dx"]);
        scene.refuses(&format!("{command} film --fps 24 --views nowhere"), &["nowhere"]);
        scene.refuses(&format!("{command} film --fps 24 --imagine=nothing.safetensors"), &["nothing.safetensors"]);
    }
    scene.succeeds("check film --fps 24 --ground auto");
}

#[test]
fn without_ffmpeg_it_is_said_which_one_is_needed() {
    let scene = film();
    scene.write("ball.mp4", [0; 64]);
    let output = scene.command("check ball.mp4").env("PATH", "").output().unwrap();
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    for part in ["ball.mp4", "ffmpeg", "5.1", "fix: "] {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
    // pictures need none
    let output = scene.command("check film --fps 24").env("PATH", "").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn a_folder_of_films_becomes_a_table() {
    let scene = film();
    fs::create_dir(scene.path("films")).unwrap();
    scene.write("films/broken.gif", "GIF89a");
    scene.write("films/notes.txt", "none of the films");
    fs::copy(bundled().parent().unwrap().join("bird.gif"), scene.path("films/bird.gif")).unwrap();
    scene.write("films/films.json", r#"{"bird.gif": {"diameter_m": 0.4, "first_hit": 5}}"#);
    let printed = scene.succeeds("bench films --real films --markdown table.md --json table.json -q");
    let lines: Vec<&str> = printed.lines().filter(|line| line.starts_with("| b")).collect();
    assert_eq!(lines.len(), 2, "{printed}");
    assert!(lines[0].contains("bird.gif | accepted | ") && lines[0].contains("hit 5") && lines[0].contains("flight 0"));
    assert!(lines[1].contains("broken.gif | refused: ") && lines[1].contains("decode"), "{printed}");
    assert!(printed.contains("1 of 2 films are accepted"), "{printed}");
    assert!(scene.path("runs/films/bird.gif/index.html").is_file());
    let table = fs::read_to_string(scene.path("table.md")).unwrap();
    assert!(table.contains("<!-- begin: films -->") && table.contains(lines[0]), "{table}");
    let rows: serde_json::Value = serde_json::from_slice(&fs::read(scene.path("table.json")).unwrap()).unwrap();
    assert!(rows[0]["seconds"].as_f64().unwrap() > 0.0 && rows[1]["exit_code"] == 2, "{rows}");
    #[cfg(target_os = "linux")]
    assert!((1.0..512.0).contains(&rows[0]["seen"]["memory_mib"].as_f64().unwrap()), "{rows}");
    scene.refuses("bench films --real nowhere", &["nowhere"]);
    scene.refuses("bench films --real runs", &["no film"]);
    scene.write("films/films.json", "{]");
    scene.refuses("bench films --real films", &["films.json"]);
}

/// The bird has less green than red and blue, its surroundings as much; the weights undo the usual normalisation, too.
#[test]
fn a_network_tells_the_object() {
    let scene = film();
    scene.write("colours.onnx", Network::of(Some(192), [13.74, -26.88, 13.5], -7.26).bytes());
    let printed = scene.succeeds("check film --fps 24 --matting colours.onnx");
    for part in ["by a matting network", "colours.onnx", "192 × 192 pixels", "ready to open"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    scene.write("page.onnx", "<html><body>404 Not Found</body></html>");
    scene.refuses("check film --fps 24 --matting page.onnx", &["page.onnx", "an ONNX file", "--matting"]);
    scene.refuses("check film --fps 24 --matting nothing.onnx", &["nothing.onnx", "--matting"]);
    let both = scene.run("check film --fps 24 --matting colours.onnx --masks film");
    assert!(both.status.code() == Some(2) && text(&both.stderr).contains("cannot be used with"));

    // what the settings say of a network holds for the one that is given, and for the run that goes on
    scene.write("matting.toml", format!("{QUICK}[clip.film.matting]\nmodel = \"elsewhere.onnx\"\nsize = 192\n"));
    scene.refuses("reconstruct film --fps 24 --config matting.toml --out out", &["elsewhere.onnx"]);
    scene.succeeds("reconstruct film --fps 24 --frames 8 --matting colours.onnx --config matting.toml --out out");
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(config.contains("[clip.film.matting]") && config.contains("size = 192"), "{config}");
    assert!(config.contains("colours.onnx") && !config.contains("elsewhere.onnx"), "{config}");
    scene.succeeds("reconstruct film --out out --resume");
}

#[test]
fn a_film_is_reconstructed_and_resumed_and_made_again() {
    let scene = film();
    scene.refuses("reconstruct film --out out --config quick.toml", &["--fps"]);
    scene.succeeds("reconstruct film --fps 24 --frames 8 --out out --config quick.toml");
    let state = scene.state("out");
    let velocity: Vec<f64> = (0..3).map(|k| state["unknowns"]["velocity"][k].as_f64().unwrap()).collect();
    let error = velocity.iter().zip([-0.4, -0.6, 0.1]).map(|(v, truth)| (v - truth).powi(2)).sum::<f64>().sqrt();
    // on a grid as coarse as this
    assert!(error < 0.25 * 0.728, "{velocity:?}");
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(config.contains("frames_per_s = 24.0"), "{config}");
    let output = scene.run("reconstruct film --out out --resume --fps 12");
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("belongs to the run"));
    // stopped before it knew how sure it is
    let mut stopped = state.clone();
    assert_eq!(stopped["finished"].as_array_mut().unwrap().pop().unwrap(), "posterior");
    stopped["seconds"].as_array_mut().unwrap().pop();
    for found in ["intervals", "surveys"] {
        stopped[found] = serde_json::json!([]);
    }
    scene.write("out/state.json", stopped.to_string());
    scene.succeeds("reconstruct film --out out --resume");
    let went_on = scene.state("out");
    for found in ["unknowns", "intervals", "marginals"] {
        assert_eq!(went_on[found], state[found], "{found}");
    }

    scene.succeeds("simulate --from out --set young=1e6 --out again");
    assert!(scene.path("again/index.html").is_file());
    stopped.as_object_mut().unwrap().remove("survivors");
    scene.write("out/state.json", stopped.to_string());
    scene.refuses("reconstruct film --out out --resume", &["state.json", "no survivors of the stage"]);
}

#[test]
fn given_views_stand_around_what_a_film_shows() {
    let scene = film();
    // the first frame from all cameras of the bundled clip, as if they had been imagined
    scene.copy_clip("views", &[0, 1, 2, 3, 4, 5, 6], 1);
    scene.succeeds("reconstruct film --fps 24 --frames 8 --views views --out out --config quick.toml");
    let notes = scene.state("out")["notes"].to_string();
    assert!(
        notes.contains("imagined views of the first frame show") && notes.contains("0 of 7 may be wrong"),
        "{notes}"
    );
    assert!(!notes.contains("as deep as it is wide, part by part"), "{notes}");
    scene.succeeds("reconstruct film --out out --resume");
    scene.refuses("reconstruct film --fps 24 --views nowhere --out other", &["nowhere"]);
    assert!(!scene.path("other").exists());
}

#[test]
fn unseen_sides_are_imagined_and_kept() {
    let scene = film();
    let quick = fs::read_to_string(scene.path("quick.toml")).unwrap();
    scene.write("imagine.toml", format!("{quick}\n[imagine]\nsteps = 3\nguidance = 1.0\n"));
    scene.succeeds("reconstruct film --fps 24 --frames 8 --imagine --out out --config imagine.toml");
    for file in ["first_frame.png", "views/views.png", "views/index.html", "views/data/r_15_0.png"] {
        assert!(scene.path("out").join(file).is_file(), "no {file}");
    }
    let made = fs::metadata(scene.path("out/views/views.png")).unwrap().modified().unwrap();
    scene.succeeds("reconstruct film --out out --resume");
    assert_eq!(fs::metadata(scene.path("out/views/views.png")).unwrap().modified().unwrap(), made);

    // weights that are not there leave no trace
    let missing = "reconstruct film --fps 24 --frames 8 --imagine=tiny.safetensors --out tiny --config imagine.toml";
    scene.refuses(missing, &["tiny.safetensors"]);
    assert!(!scene.path("tiny").exists());
    scene.copy_clip("clip", &[0, 3], 4);
    scene.refuses("reconstruct clip --imagine --out several", &["several cameras already", "--cameras"]);
}
