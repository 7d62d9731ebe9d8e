//! What a finished run leaves: every file can be read back and says what it should.

use std::fs;

use gradreel_models::identify::Config;
use serde_json::Value;

use crate::scene::{Scene, bundled};

#[test]
fn a_quick_run_leaves_every_result() {
    let scene = Scene::new();
    let clip = bundled();
    let arguments = "--cameras 0,2,4,6 --frames 8 --young 20000 --out out --config quick.toml";
    let printed = scene.succeeds(&format!("reconstruct {} {arguments}", clip.display()));
    let young = printed.lines().find(|line| line.contains("Young's modulus")).expect("the summary names it");
    assert!(young.contains("90 %") && young.trim_end().ends_with("Pa"), "{young}");
    assert!(printed.contains("index.html"));

    let out = scene.path("out");
    let config = Config::parse(&fs::read_to_string(out.join("config.toml")).unwrap()).unwrap();
    assert_eq!((config.clip.cameras, config.clip.frames), (vec![0, 2, 4, 6], 8));
    assert_eq!(config.material.start["young"], 20000.0);

    let file = fs::read(out.join("parameters.json")).unwrap();
    let parameters: Value = serde_json::from_slice(&file).unwrap();
    for (name, unit) in [("young", "Pa"), ("poisson", "-"), ("velocity_y", "m/s")] {
        let entry = &parameters["parameters"][name];
        assert_eq!(entry["unit"], unit, "{name}");
        let value = entry["value"].as_f64().expect("a number");
        let [low, high] = [0, 1].map(|end| entry["interval_90"][end].as_f64().expect("an interval"));
        assert!(low < value && value < high && low.is_finite() && high.is_finite(), "{entry}");
        assert!(entry["determined"].is_boolean(), "{entry}");
    }
    assert!(parameters["parameters"]["young"]["value"].as_f64().unwrap() > 0.0);
    assert_eq!(parameters["parameters"]["young"]["start"], 20000.0);
    assert!(parameters["assumed"]["density"]["value"] == 1000.0);
    let isa = parameters["isa"].as_str().expect("the instruction set");
    assert!(["scalar", "avx2", "avx512", "neon"].contains(&isa), "{isa}");
    let particles = parameters["quality"]["particles"].as_f64().unwrap();

    for frame in 0..8 {
        let ply = fs::read(out.join(format!("particles/frame_{frame:03}.ply"))).unwrap();
        let header = String::from_utf8_lossy(&ply[..ply.len().min(200)]).into_owned();
        assert!(header.starts_with("ply\n") && header.contains(&format!("element vertex {particles}\n")), "{header}");
    }
    assert!(!out.join("particles/frame_008.ply").exists());
    let animation = fs::read(out.join("input_and_reconstruction.gif")).unwrap();
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(&animation[..]).unwrap();
    let mut pictures = 0;
    while decoder.read_next_frame().unwrap().is_some() {
        pictures += 1;
    }
    assert_eq!(pictures, 8);
    let plots: Vec<_> = fs::read_dir(out.join("plots")).unwrap().collect();
    assert!(plots.len() >= 3, "{plots:?}");

    let page = fs::read_to_string(out.join("index.html")).unwrap();
    for part in ["Young", "assumed", "data:image/gif;base64,"] {
        assert!(page.contains(part), "no {part:?}");
    }
    for link in ["src=\"http", "href=\"http", "url(http", "import(\"http"] {
        assert!(!page.contains(link), "the page asks the network: {link}");
    }
    let left = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert_eq!(left.filter(|name| name.ends_with(".partial")).count(), 0);
}

#[test]
fn another_family_of_materials() {
    let scene = Scene::with_clip(&[0, 3], 7);
    let start = "--start yield_stress=500,young=2e4";
    let printed =
        scene.succeeds(&format!("reconstruct clip --material plasticine {start} --out out --config quick.toml"));
    assert!(printed.contains("yield stress"), "{printed}");
    let file = fs::read(scene.path("out/parameters.json")).unwrap();
    let parameters: Value = serde_json::from_slice(&file).unwrap();
    assert_eq!(parameters["material"], "von_mises");
    assert_eq!(parameters["parameters"]["yield_stress"]["start"], 500.0);
    assert!(parameters["parameters"]["poisson"]["interval_90"].is_array());
}

#[test]
fn a_family_is_chosen_when_nobody_said() {
    let scene = Scene::with_clip(&[0, 3], 7);
    let printed = scene.succeeds("reconstruct clip --material auto --out out --config quick.toml");
    for family in ["elastic", "plasticine", "newtonian", "non_newtonian", "sand", "chosen: "] {
        assert!(printed.contains(family), "no {family} in {printed}");
    }
    let state = scene.state("out");
    assert_eq!(state["standings"].as_array().unwrap().len(), 5);
    let chosen = Config::parse(&fs::read_to_string(scene.path("out/config.toml")).unwrap()).unwrap();
    assert!(!chosen.chooses_family());
    scene.succeeds("reconstruct clip --out out --resume");
    assert_eq!(scene.state("out"), state, "a finished run has nothing left to do");
}

#[test]
fn a_single_camera_says_what_it_assumes() {
    for (frames, said) in [(4, "a single camera: the object is"), (2, "the single camera does not see the object fall")]
    {
        let scene = Scene::with_clip(&[0], frames);
        scene.succeeds("reconstruct clip --cameras 0 --out out --config quick.toml");
        let notes = scene.state("out")["notes"].to_string();
        assert!(notes.contains(said), "{notes}");
        let page = fs::read_to_string(scene.path("out/index.html")).unwrap();
        assert!(page.contains(said));
    }
}

#[test]
fn runs_without_out_that_begin_at_once_each_get_a_folder() {
    let scene = Scene::with_clip(&[0, 3], 2);
    let start = || scene.command("reconstruct clip --quiet --config quick.toml").spawn().unwrap();
    let runs = [start(), start()];
    for run in runs {
        let output = run.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(output.stderr.is_empty(), "--quiet is quiet");
    }
    for folder in ["runs/clip", "runs/clip-2"] {
        assert!(scene.path(folder).join("index.html").is_file(), "{folder}");
    }
}

#[test]
fn the_velocity_may_start_from_the_temporal_field() {
    let scene = Scene::with_clip(&[0, 2, 5], 4);
    let small = "[temporal]\nenabled = true\niterations = 20\n";
    scene.write("field.toml", format!("{}{small}", crate::scene::QUICK));
    scene.succeeds("reconstruct clip --out out --config field.toml");
    let state = scene.state("out");
    let finished: Vec<&str> = state["finished"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(finished[..3], ["shape", "temporal field", "velocity"], "{finished:?}");
    let notes = state["notes"].to_string();
    assert!(notes.contains("the temporal field shows"), "{notes}");
    // the search started there
    let shown = &state["flight"]["velocity"];
    assert!(shown.is_null() || state["history"][0]["unknowns"]["velocity"] == *shown, "{shown}");
    scene.write("field.toml", "[temporal]\niterations = 0\n");
    scene.refuses("reconstruct clip --out other --config field.toml", &["temporal.iterations", "1 to 1000000"]);
}

#[test]
fn a_body_that_may_spin_above_ground_of_unknown_height() {
    let scene = Scene::new();
    let clip = bundled().display().to_string();
    let output = scene.run(&format!("reconstruct {clip} --ground low"));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && message.contains("neither `auto` nor a height"), "{message}");
    let arguments = "--cameras 0,2,4,6 --frames 8 --spin --ground auto --out out --config quick.toml";
    let printed = scene.succeeds(&format!("reconstruct {clip} {arguments}"));
    assert!(printed.contains("Initial spin, x"), "{printed}");
    let parameters: Value = serde_json::from_slice(&fs::read(scene.path("out/parameters.json")).unwrap()).unwrap();
    for name in ["spin_x", "spin_y", "spin_z"] {
        let entry = &parameters["parameters"][name];
        assert_eq!(entry["unit"], "rad/s");
        // the bird does not spin
        assert!(entry["value"].as_f64().unwrap().abs() < 1.0, "{entry}");
        assert!(entry["interval_90"][0].as_f64() < entry["interval_90"][1].as_f64(), "{entry}");
    }
    // the floor is at 0
    let ground = parameters["assumed"]["ground"]["value"].as_f64().unwrap();
    assert!(ground.abs() < 0.03 && ground != 0.0, "{ground}");
    assert!(scene.state("out")["notes"].to_string().contains("where the object lands"));
    let printed = scene.succeeds("simulate --from out --spin 0,6,0 --out again");
    assert!(printed.contains("ω [0.0, 6.0, 0.0] rad/s"), "{printed}");
    assert_eq!(scene.state("again")["unknowns"]["spin"], serde_json::json!([0.0, 6.0, 0.0]));
}

#[test]
fn a_material_that_is_held_altogether() {
    let scene = Scene::with_clip(&[0, 3], 7);
    let material = "[material]\nheld = ['young', 'poisson']\n[material.start]\nyoung = 2e4\npoisson = 0.35\n";
    scene.write("held.toml", format!("{}{material}", crate::scene::QUICK));
    let printed = scene.succeeds("reconstruct clip --out held --config held.toml");
    assert!(printed.contains("assumed") && printed.contains("Initial velocity"), "{printed}");
    let parameters = scene.parameters("held");
    assert_eq!((&parameters["young"]["value"], &parameters["poisson"]["value"]), (&2e4.into(), &0.35.into()));
    assert_eq!(parameters["young"]["source"], "assumed");
    assert!(parameters["velocity_y"]["interval_90"][0].as_f64() < parameters["velocity_y"]["value"].as_f64());
    // nothing of the material is fitted with the voxels
    scene.write("rate.toml", crate::scene::QUICK.replace("in_motion = 2\n", "in_motion = 2\nmaterial_rate = 0.0\n"));
    scene.succeeds("reconstruct clip --out rate --config rate.toml");
}

/// What the clip does not determine is no number to read: neither in the terminal nor on the page.
#[test]
fn what_is_not_determined_is_no_headline() {
    let scene = Scene::with_clip(&[0, 3], 3);
    let printed = scene.succeeds("reconstruct clip --out out --config quick.toml --young 12345");
    let young = printed.lines().find(|line| line.contains("Young's modulus")).unwrap();
    assert!(young.contains(" –  ") && young.contains("not determined by this clip: 90 %"), "{young}");
    let entry = &scene.parameters("out")["young"];
    assert_eq!((&entry["determined"], &entry["readable"]), (&false.into(), &"–".into()));
    assert!(entry["value"].as_f64().is_some_and(|value| value > 0.0), "{entry}");
    let page = fs::read_to_string(scene.path("out/index.html")).unwrap();
    let headlines: Vec<&str> = page.split("<article class=\"number\">").skip(1).collect();
    assert!(headlines.iter().all(|card| !card.starts_with("<h2>Young")), "a headline of what is not known");
    assert!(headlines.iter().any(|card| card.starts_with("<h2>Initial velocity")));
    assert!(
        page.contains("<th>Young&#39;s modulus</th><td>–: not determined by this clip; 90 %: "),
        "not in the notes"
    );
    let poisson = &scene.parameters("out")["poisson"];
    let [low, high] = [0, 1].map(|end| poisson["interval_90"][end].as_f64().unwrap());
    assert!(0.0 <= low && low < high && high <= 0.45, "{poisson}");
}
