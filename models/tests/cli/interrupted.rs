//! Ctrl-C: stops with what there is, says how to go on, and goes on there.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::Command;

use serde_json::Value;

use crate::scene::{QUICK, Scene, text};

fn history(state: &Value) -> Vec<Value> {
    state["history"].as_array().unwrap().clone()
}

#[test]
fn a_run_goes_on_where_it_was_stopped() {
    let scene = Scene::with_clip(&[0, 2, 4], 8);
    // Many materials to try: only a stop ends it before long.
    scene.write("long.toml", QUICK.replace("points = 1", "points = 100000"));
    let mut child = scene.command("reconstruct clip --out out --config long.toml").spawn().unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains(": shape: done") {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "it ended before it showed progress");
    }
    let begun = || !history(&scene.state("out")).is_empty();
    while !begun() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{rest}");
    assert!(rest.contains("gradreel reconstruct clip --out out --resume"), "{rest}");
    assert!(!rest.contains("panicked"), "{rest}");
    assert!(!text(&output.stdout).contains("Young's modulus"), "nothing is claimed that was not found");

    let state = scene.state("out");
    assert_eq!(state["finished"][0], "shape");
    let stopped = history(&state);
    assert!(!stopped.is_empty());
    assert!(scene.path("out/field.safetensors").is_file());

    // The same run with fewer iterations ahead.
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap().replace("= 100000\n", "= 1\n");
    scene.write("out/config.toml", config);
    scene.succeeds("reconstruct clip --out out --resume");
    let state = scene.state("out");
    let whole = history(&state);
    assert!(whole.len() > stopped.len());
    assert_eq!(&whole[..stopped.len()], &stopped[..], "what was found before is kept");
    let finished: Vec<&str> = state["finished"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(finished.iter().filter(|stage| **stage == "shape").count(), 1, "a finished stage is not repeated");
    assert!(finished.contains(&"material 1"), "{finished:?}");
    assert_eq!(finished.last(), Some(&"posterior"), "{finished:?}");
    assert!(scene.path("out/parameters.json").is_file() && scene.path("out/index.html").is_file());
}
