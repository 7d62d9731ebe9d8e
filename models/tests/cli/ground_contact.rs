//! The kind of ground as a hypothesis.

use std::fs;

use crate::scene::Scene;

#[test]
fn the_friction_of_the_ground_is_found() {
    let scene = Scene::with_clip(&[0, 3], 8);
    scene.succeeds("reconstruct clip --out out --config quick.toml --ground-contact friction");
    let friction = &scene.parameters("out")["ground_friction"];
    assert_eq!((&friction["unit"], &friction["source"]), (&"-".into(), &"fitted".into()));
    let [low, high] = [0, 1].map(|end| friction["interval_90"][end].as_f64().unwrap());
    let value = friction["value"].as_f64().unwrap();
    assert!(0.0 < low && low <= value && value <= high, "{friction}");
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(config.contains("ground_contact = \"friction\""), "{config}");
}

#[test]
fn every_kind_of_ground_may_try() {
    let scene = Scene::with_clip(&[0, 3], 8);
    scene.succeeds("reconstruct clip --out out --config quick.toml --ground-contact auto");
    let state = scene.state("out");
    let mut names: Vec<&str> =
        state["standings"].as_array().unwrap().iter().map(|s| s["family"].as_str().unwrap()).collect();
    names.sort_unstable();
    assert_eq!(names, ["elastic", "elastic, friction", "elastic, slip"]);
    // the run says which it was
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(!config.contains("ground_contact = \"auto\"") && config.contains("ground_contact = "), "{config}");
    assert_eq!(scene.run("reconstruct clip --out new --ground-contact ice").status.code(), Some(2));
}
