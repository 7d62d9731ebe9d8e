//! `gradreel bench`: tables, cells that are not run twice, and what cannot be used.

use std::fs;

use serde_json::Value;

use crate::scene::{Scene, text};

#[test]
fn a_quick_ablation_and_one_that_goes_on() {
    let scene = Scene::with_clip(&[0, 2, 5], 4);
    // what the table compares with
    fs::copy(crate::scene::bundled().join("truth.json"), scene.path("clip/truth.json")).unwrap();
    let cells = "--cells still,without_lva,time";
    let printed = scene.succeeds(&format!("bench ablation clip --quick --out out {cells} --shift 2 --seed 7"));
    let table = fs::read_to_string(scene.path("out/ablation.md")).unwrap();
    assert!(printed.contains(&table), "{printed}");
    let label = printed.lines().find(|line| line.starts_with("## ")).unwrap();
    assert!(label.ends_with("(elastic)"), "{label}");
    for row in ["truth", "imagined views, without L_va", "merged time features", "no encoding of time"] {
        assert!(table.contains(row), "no {row:?} in\n{table}");
    }
    assert!(!table.contains(", with L_va") && !table.contains("fails"), "{table}");
    let all: Value = serde_json::from_slice(&fs::read(scene.path("out/ablation.json")).unwrap()).unwrap();
    let cells = all[0]["cells"].as_object().unwrap();
    assert_eq!(cells.len(), 3);
    assert!(
        cells["without_lva"]["errors"]["young"].is_number() && cells["without_lva"]["errors"]["velocity"].is_number()
    );
    assert!(cells["time"]["quality"]["psnr_held_out_db"].as_f64().unwrap() > 3.0, "{}", cells["time"]);
    let name = all[0]["clip"].as_str().unwrap().to_owned();
    // each reconstruction is a run that says how it was done
    let config = fs::read_to_string(scene.path(&format!("out/{name}/without_lva/config.toml"))).unwrap();
    assert!(config.contains("alpha = 0.0") && config.contains("robust = true"), "{config}");
    assert!(config.replace([' ', '\n'], "").contains("imagined=[2,5"), "{config}");
    assert!(scene.path(&format!("out/{name}/without_lva/index.html")).is_file());

    // a cell that is lost is run again, and ends alike; the others are left as they are
    let cell = |cell: &str| scene.path(&format!("out/{name}/{cell}.json"));
    let before = fs::read(cell("without_lva")).unwrap();
    let number = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).unwrap()["quality"]["psnr_held_out_db"].as_f64();
    let psnr = number(&fs::read(cell("time")).unwrap());
    fs::remove_file(cell("time")).unwrap();
    scene.succeeds("bench ablation --out out --resume --quiet");
    assert_eq!(fs::read(cell("without_lva")).unwrap(), before);
    assert_eq!(number(&fs::read(cell("time")).unwrap()), psnr);
    fs::write(cell("still"), "{").unwrap();
    scene.refuses("bench ablation --out out --resume", &["still.json", "damaged"]);
}

#[test]
fn the_tables_of_the_paper() {
    let scene = Scene::with_clip(&[0, 2, 5], 6);
    fs::copy(crate::scene::bundled().join("truth.json"), scene.path("clip/truth.json")).unwrap();
    let printed = scene.succeeds("bench table1 clip --quick --out one");
    for row in ["one real view", "real views", "Toothpaste", "PAC-NeRF, multi-view"] {
        assert!(printed.contains(row), "no {row:?} in\n{printed}");
    }
    let all: Value = serde_json::from_slice(&fs::read(scene.path("one/ablation.json")).unwrap()).unwrap();
    let cells = &all[0]["cells"];
    assert!(cells["single"]["errors"]["young"].is_number() && cells["real"]["errors"]["young"].is_number(), "{cells}");
    assert_eq!(cells.as_object().unwrap().len(), 2);

    // films of the five families are made once
    let printed = scene.succeeds("bench table2 --quick --frames 3 --out two");
    for row in ["## newtonian (newtonian)", "## sand (sand)", "with L_va", "without L_va", "as printed"] {
        assert!(printed.contains(row), "no {row:?} in\n{printed}");
    }
    assert!(!printed.contains("one real view"), "{printed}");
    let film = scene.path("two/films/elastic/scene.toml");
    let made = fs::metadata(&film).unwrap().modified().unwrap();
    assert_eq!(scene.succeeds("bench table2 --out two --resume --quiet"), printed);
    assert_eq!(fs::metadata(&film).unwrap().modified().unwrap(), made);
}

#[test]
fn clips_searched_from_afar() {
    let scene = Scene::with_clip(&[0, 2, 5], 6);
    scene.refuses("bench families clip --config quick.toml --out out", &["clip", "truth.json"]);
    fs::copy(crate::scene::bundled().join("truth.json"), scene.path("clip/truth.json")).unwrap();
    scene.write("results.md", "# Figures\n\nby hand\n");
    let printed = scene.succeeds("bench families clip --config quick.toml --off 100 --out out --markdown results.md");
    let file = fs::read_to_string(scene.path("results.md")).unwrap();
    for part in [
        "# Figures\n\nby hand\n",
        "<!-- begin: families -->",
        "<!-- end: families -->",
        "| split | clips that were given",
        "real views",
    ] {
        assert!(file.contains(part), "no {part:?} in\n{file}");
    }
    assert!(
        file.contains(
            "| command | `gradreel bench families clip --config quick.toml --off 100 --out out --markdown results.md` |"
        ),
        "{file}"
    );
    for part in ["real views", "numbers hold the truth", "of 1 clips"] {
        assert!(printed.contains(part), "no {part:?} in\n{printed}");
    }
    let all: Value = serde_json::from_slice(&fs::read(scene.path("out/ablation.json")).unwrap()).unwrap();
    let real = &all[0]["cells"]["real"];
    assert_eq!(real["family"], "elastic");
    assert!(real["intervals"]["young"][0].as_f64() < real["intervals"]["young"][1].as_f64(), "{real}");
    let name = all[0]["clip"].as_str().unwrap();
    let config = fs::read_to_string(scene.path(&format!("out/{name}/real/config.toml"))).unwrap();
    assert!(config.contains("young = 3000.0"), "{config}");
    let output = scene.run("bench families clip --quick --off 0.5");
    assert!(text(&output.stderr).contains("a factor from 1 to 1000"), "{}", text(&output.stderr));
}

#[test]
fn coverage_of_a_clip_and_one_that_goes_on() {
    let scene = Scene::with_clip(&[0], 2);
    let printed =
        scene.succeeds("bench coverage --quick --clips 1 --cameras 3 --out out --threads 1 --json figures.json");
    let lines = fs::read_to_string(scene.path("out/clips.jsonl")).unwrap();
    let line: Value = serde_json::from_str(&lines).unwrap();
    assert_eq!((&line["clip"], &line["cameras"], &line["refused"]), (&0.into(), &3.into(), &Value::Null), "{line}");
    for name in ["young", "poisson", "velocity_y"] {
        assert!(line["scores"][name]["log_score"].is_number(), "no {name} in {line}");
    }
    assert!(!scene.path("out/clips/00000").exists(), "the clip's files are removed");
    let figures: Value = serde_json::from_slice(&fs::read(scene.path("figures.json")).unwrap()).unwrap();
    for name in ["commit", "machine", "isa", "split", "clips", "seconds", "peak_mib"] {
        assert!(!figures[name].is_null(), "no {name} in {figures}");
    }
    assert_eq!(
        (&figures["split"], &figures["families"]["elastic"]["velocity"]["n"]),
        (&"development".into(), &3.into())
    );
    assert!(printed.contains("| elastic | young | 1 |"), "{printed}");
    assert!(fs::read_to_string(scene.path("out/ranks.svg")).unwrap().contains("elastic poisson (1)"));

    // what is done is not done again, and half a line is none
    fs::write(scene.path("out/clips.jsonl"), format!("{lines}{{\"clip\": 1, \"spl")).unwrap();
    scene.succeeds("bench coverage --out out --resume --quiet");
    assert_eq!(fs::read_to_string(scene.path("out/clips.jsonl")).unwrap(), lines);
    fs::write(scene.path("out/clips.jsonl"), "{}\n").unwrap();
    scene.refuses("bench coverage --out out --resume", &["clips.jsonl", "damaged"]);
    scene.refuses("bench coverage --out other --threads 0", &["--threads", "1 to 256"]);
}

#[test]
fn the_error_budget_is_measured_on_clips() {
    let scene = Scene::with_clip(&[0], 2);
    let settings = "[estimate]\nvelocity = 2\npoints = 1\nsurvivors = 1\nsteps = 1\nrounds = 0\n\
                    [geometry]\ndx = 0.1\n[geometry.fit]\niterations = 4\n";
    scene.write("pool.toml", settings);
    scene.succeeds("bench coverage --clips 1 --cameras 3 --config pool.toml --out out --threads 1 -q");
    let line: Value = serde_json::from_str(&fs::read_to_string(scene.path("out/clips.jsonl")).unwrap()).unwrap();
    assert_eq!(line["surveys"].as_array().unwrap().len(), 1, "{line}");
    assert!(line["scores"]["young"]["rank"].as_f64().is_some_and(|rank| (0.0..=1.0).contains(&rank)), "{line}");
    let printed = scene.succeeds("bench calibrate out --out budget.toml");
    assert!(printed.contains("1 clips: mean log score"), "{printed}");
    let budget = fs::read_to_string(scene.path("budget.toml")).unwrap();
    assert!(budget.contains("[discrepancy]") && budget.contains("Development split, 1 clips"), "{budget}");
    // clips that are reported are not asked
    let reported = fs::read_to_string(scene.path("out/clips.jsonl")).unwrap().replace("\"development\"", "\"report\"");
    fs::write(scene.path("out/clips.jsonl"), reported).unwrap();
    scene.refuses("bench calibrate out", &["never measured on clips that are reported", "--split report"]);
    scene.write("wrong.toml", "[estimate]\nsurvivors = 0\n");
    scene.refuses("bench coverage --config wrong.toml --out none", &["wrong.toml", "estimate.survivors"]);
    assert!(!scene.path("none").exists());
}

#[test]
fn what_cannot_be_compared() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.refuses("bench ablation clip --out out --quick", &["three cameras", "cameras 0, 3"]);
    scene.copy_clip("more", &[0, 3, 5], 2);
    scene.refuses("bench ablation more --out out --quick --markdown results.md", &["--markdown", "--quick"]);
    scene.refuses("bench ablation more --out out --primary 4", &["camera 4 of 0, 3, 5", "--primary"]);
    scene.refuses("bench ablation more --out out --shift=-1", &["--shift", "0 to 1000"]);
    scene.refuses("bench ablation more --out out --tint 2", &["--tint", "0 to 1"]);
    scene.refuses("bench ablation more nowhere --out out", &["nowhere"]);
    scene.write("more/clip.toml", "imagined = [3]");
    scene.refuses("bench ablation more --out out", &["imagined already"]);
    fs::create_dir(scene.path("empty")).unwrap();
    scene.refuses("bench ablation --out empty --resume", &["ablation.toml"]);
    for arguments in ["bench", "bench ablation", "bench ablation more --cells best"] {
        let output = scene.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {}", text(&output.stderr));
    }
    let help = scene.succeeds("bench ablation --help");
    for part in ["with_lva", "without_lva", "truth.json", "--resume", "Examples:"] {
        assert!(help.contains(part), "no {part} in {help}");
    }
}

/// Tables of the published chain in one folder: films, cells and views that they share are made once.
#[test]
fn the_tables_of_the_published_chain() {
    let scene = Scene::with_clip(&[0, 2, 5], 8);
    fs::copy(crate::scene::bundled().join("truth.json"), scene.path("clip/truth.json")).unwrap();
    crate::model::weights().write(scene.path("tiny.safetensors")).unwrap();
    scene.write(
        "chain.toml",
        "[clip]\nshrink = 5\n[geometry]\ndx = 0.08\n[geometry.fit]\niterations = 3\n[published]\nweights = \"tiny.safetensors\"\n\
         steps = 2\nguidance = 1.0\nfield = 40\nrays = 128\nnodes = 3000\nvelocity = 2\nstarts = 1\nmaterial = 2\n",
    );
    let printed = scene.succeeds("bench table2 clip --method published --config chain.toml --out both -q");
    for row in
        ["as published, one real view, with L_va", "as published, one real view, without L_va", "fails to converge"]
    {
        assert!(printed.contains(row), "no {row:?} in\n{printed}");
    }
    let all: Value = serde_json::from_slice(&fs::read(scene.path("both/ablation.json")).unwrap()).unwrap();
    let folder = scene.path("both").join(all[0]["clip"].as_str().unwrap());
    let read = |name: &str| fs::read(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let without = fs::read_to_string(folder.join("published_without_lva/config.toml")).unwrap();
    assert!(without.contains("alpha = 0.0"), "{without}");
    let view = "views/frame_003.safetensors";
    assert_eq!(read(&format!("published/{view}")), read(&format!("published_without_lva/{view}")));
    let seconds = |cell: &str| {
        let state: Value = serde_json::from_slice(&read(&format!("{cell}/published.json"))).unwrap();
        state["finished"][1]["seconds"].as_f64().unwrap()
    };
    assert_eq!(seconds("published"), seconds("published_without_lva"), "the views were not made again");

    let before = read("published.json");
    let printed = scene.succeeds("bench table1 --method published --out both --resume -q");
    assert!(printed.contains("as published, real views") && !printed.contains("without L_va |"), "{printed}");
    assert_eq!(read("published.json"), before, "a cell of both tables");
    // that model has no module to draw the figure with
    let message = scene.run("bench figure5 --out both --resume -q");
    assert_eq!(message.status.code(), Some(2));
    assert!(text(&message.stderr).contains("no spatial-aware module"), "{}", text(&message.stderr));
}
