//! Scenes that cannot be used are refused with the key, what is wrong and what to do.

use std::path::Path;

use gradreel_models::scenes::{Runner, SceneFile, Setup};

const GOOD: &str = r#"
[time]
duration_s = 0.1
frames_per_s = 20
[grid]
spacing_m = 0.04
[ground]
[materials.rubber]
law = "neo_hookean"
density_kg_m3 = 1000
young = 1e5
poisson = 0.3
[[objects]]
material = "rubber"
shape.box = { centre_m = [0, 0.1, 0], size_m = [0.16, 0.16, 0.16] }
"#;

fn setup(text: &str) -> gradreel::Result<Setup> {
    Setup::of(&SceneFile::parse(text)?, Path::new("."))
}

/// The error of the good scene with one change has all of these words.
#[track_caller]
fn refused(from: &str, to: &str, words: &[&str]) {
    assert!(GOOD.contains(from), "{from}");
    let error = setup(&GOOD.replacen(from, to, 1)).expect_err(to);
    assert_eq!(error.kind(), gradreel::ErrorKind::Input, "{error}");
    let error = error.to_string();
    for word in words {
        assert!(error.contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn the_scene_is_good_without_the_changes() {
    assert_eq!(setup(GOOD).unwrap().len(), 512);
}

#[test]
fn unknown_names_come_with_the_nearest() {
    refused("spacing_m", "spacing", &["unknown field `spacing`", "did you mean `spacing_m`?"]);
    refused("duration_s", "duraton_s", &["did you mean `duration_s`?"]);
    refused("shape.box", "shape.bx", &["did you mean `box`?"]);
    refused("[ground]", "[ground]\ncontact = \"stiky\"", &["did you mean `sticky`?"]);
    refused("material = \"rubber\"", "material = \"ruber\"", &["objects[0].material", "did you mean `rubber`?"]);
    refused("neo_hookean", "neohookean", &["materials.rubber.law", "did you mean `neo_hookean`?"]);
    refused("young", "yung", &["materials.rubber", "no parameter of this name", "did you mean `young`?"]);
    refused("poisson = 0.3", "", &["materials.rubber.poisson", "missing"]);
    refused("[time]", "[tim", &["cannot be read", "line 2"]);
}

#[test]
fn numbers_that_make_no_sense_are_named() {
    refused("young = 1e5", "young = nan", &["materials.rubber.young", "not finite"]);
    refused("young = 1e5", "young = -1e5", &["materials.rubber.young", "negative"]);
    refused("young = 1e5", "young = 0", &["no speed of sound"]);
    refused("poisson = 0.3", "poisson = 0.5", &["no speed of sound", "Poisson"]);
    refused("density_kg_m3 = 1000", "density_kg_m3 = 0", &["density"]);
    refused("[0, 0.1, 0]", "[0, inf, 0]", &["objects[0].shape.box.centre_m[1]", "not finite"]);
    refused("[0.16, 0.16, 0.16]", "[0.16, 0, 0.16]", &["objects[0].shape", "no size"]);
    refused("spacing_m = 0.04", "spacing_m = -1", &["grid.spacing_m"]);
    refused("spacing_m = 0.04", "spacing_m = 1e-6", &["too large for this grid"]);
    refused("frames_per_s = 20", "frames_per_s = 1e9", &["100000 frames"]);
    refused("[grid]", "[grid]\nparticles_per_cell = 5", &["grid.particles_per_cell", "8, 27"]);
    refused("[grid]", "[grid]\nflip = 2", &["grid.flip"]);
    refused("[ground]", "[ground]\ncontact = \"friction\"", &["ground", "no coefficient", "friction = 0.4"]);
    refused("[ground]", "[ground]\nfriction = 0.3", &["the contact is another"]);
    refused("[[objects]]", "[[objects]]\ncolour = \"red\"", &["objects[0].colour", "#rrggbb"]);
}

#[test]
fn what_no_run_could_end_is_refused_at_once_with_the_number() {
    let begun = std::time::Instant::now();
    let stiff = ["too stiff for this grid", "substeps per frame", "softer", "grid spacing"];
    refused("young = 1e5", "young = 1e15", &stiff);
    refused("young = 1e5", "young = 1e300", &stiff);
    let fast = ["moves too fast for this grid", "substeps per frame", "gravity"];
    refused("[ground]", "[world]\ngravity_m_s2 = [0, -1e300, 0]\n[ground]", &fast);
    refused("[ground]", "[world]\ngravity_m_s2 = [0, -1e12, 0]\n[ground]", &fast);
    refused("[[objects]]", "[[objects]]\nvelocity_m_s = [0, 1e300, 0]", &fast);
    refused("[[objects]]", "[[objects]]\nspin_rad_s = [0, 1e12, 0]", &fast);
    let spun = "[[colliders]]\nshape.sphere = { centre_m = [9, 0, 0], radius_m = 0.5 }\nvelocity_m_s = [1e9, 0, 0]";
    refused("[[objects]]", &format!("{spun}\n[[objects]]"), &fast);
    refused(
        "duration_s = 0.1\nframes_per_s = 20",
        "duration_s = 1e300\nframes_per_s = 1e-300",
        &["substeps per frame"],
    );
    refused("frames_per_s = 20", "frames_per_s = 1e-320", &["time.frames_per_s"]);
    refused("frames_per_s = 20", "frames_per_s = 1e300", &["100000 frames"]);
    let many = ["too many substeps", "per frame"];
    refused("frames_per_s = 20", "frames_per_s = 20\nsubsteps_per_frame = 4000000000000000000", &many);
    refused(
        "duration_s = 0.1\nframes_per_s = 20",
        "duration_s = 100\nframes_per_s = 900\nsubsteps_per_frame = 1000000",
        &many,
    );
    refused("[0, 0.1, 0]", "[0, 1e300, 0]", &["origin"]);
    refused("[0, 0.1, 0]", "[0, 1e12, 0]", &["nodes", "origin"]);
    refused("density_kg_m3 = 1000", "density_kg_m3 = 1e-12", &["objects[0]", "mass", "grid cannot carry"]);
    refused("density_kg_m3 = 1000", "density_kg_m3 = 1e308", &["objects[0]"]);
    refused(
        "[[objects]]",
        "[[objects]]\nmaterial = \"rubber\"\nshape.sphere = { centre_m = [1, 1, 0], radius_m = 1e-5 }\n[[objects]]",
        &["objects[0]", "grid.spacing_m smaller"],
    );
    assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
}

#[test]
fn errors_do_not_print_hundreds_of_digits() {
    for (from, to) in [
        ("young = 1e5", "young = -1e300"),
        ("poisson = 0.3", "poisson = 1e300"),
        ("density_kg_m3 = 1000", "density_kg_m3 = -1e300"),
        ("[0, 0.1, 0]", "[0, 1e300, 0]"),
        ("[ground]", "[ground]\nfriction = 1e300"),
        ("spacing_m = 0.04", "spacing_m = 1e-300"),
    ] {
        let error = setup(&GOOD.replacen(from, to, 1)).expect_err(to).to_string();
        let longest = error.split(|c: char| !c.is_ascii_digit()).map(str::len).max().unwrap();
        assert!(longest < 25, "{error}");
    }
}

#[test]
fn a_scene_without_or_with_misplaced_objects_is_refused() {
    let (empty, _) = GOOD.split_once("[[objects]]").unwrap();
    let error = setup(empty).unwrap_err().to_string();
    assert!(error.contains("the scene is empty") && error.contains("[[objects]]"), "{error}");
    refused("[0, 0.1, 0]", "[0, 0.02, 0]", &["objects[0]", "inside an obstacle", "in ground", "of 512"]);
    refused(
        "[ground]",
        "[world]\nbounds_m = [[-1, 0, -1], [1, 0.15, 1]]\n[ground]",
        &["objects[0]", "outside the world's bounds", "world.bounds_m"],
    );
    refused(
        "[[objects]]",
        "[[colliders]]\nshape.sphere = { centre_m = [0, 0, 0], radius_m = 3 }\n[[objects]]",
        &["in colliders[0]", "container = true"],
    );
    refused(
        "[[objects]]",
        "[[colliders]]\nshape.sphere = { centre_m = [9, 0, 0], radius_m = 0 }\n[[objects]]",
        &["colliders[0]", "no size"],
    );
}

#[test]
fn a_step_that_is_too_long_is_refused_before_the_run() {
    let words = ["materials.rubber", "substep is too long", "substeps per frame"];
    refused("frames_per_s = 20", "frames_per_s = 20\nsubsteps_per_frame = 3", &words);
}

#[test]
fn a_run_that_leaves_its_bounds_says_so() {
    let falling = GOOD.replace("[ground]", "[world]\nbounds_m = [[-1, 0.015, -1], [1, 1, 1]]");
    let setup = setup(&falling).unwrap();
    let mut runner = Runner::<f32>::new(&setup).unwrap();
    let error = (0..9).find_map(|_| runner.advance(|| true).err()).expect("it falls out");
    assert!(error.to_string().contains("left the world's bounds"), "{error}");
}

/// The good scene, and a block that flies into its object at this speed \[m/s\].
fn collision(speed: f64) -> String {
    GOOD.to_owned()
        + &format!(
            "[[objects]]\nmaterial = \"rubber\"\nvelocity_m_s = [0, {}, 0]\n\
             shape.box = {{ centre_m = [0, 0.36, 0], size_m = [0.16, 0.16, 0.16] }}\n",
            -speed
        )
}

#[test]
fn a_flight_too_fast_for_the_steps_that_are_given_stops_the_run() {
    // Each step is short enough for sound.
    let given = collision(40.0).replace("frames_per_s = 20", "frames_per_s = 20\nsubsteps_per_frame = 36");
    let setup = setup(&given).unwrap();
    let mut runner = Runner::<f32>::new(&setup).unwrap();
    let error = runner.advance(|| true).expect_err("nothing survives that").to_string();
    assert!(error.contains("unstable") && error.contains("particle") && error.contains("position"), "{error}");
    assert_eq!(runner.frame().index, 0, "the last whole frame is kept");
}

#[test]
fn an_element_that_is_turned_inside_out_stops_the_run_and_is_named() {
    // Neither block crosses a cell in a step, but together they close in on what lies between by more than its length.
    let upwards = "material = \"rubber\"\nvelocity_m_s = [0, 25, 0]";
    let given = collision(25.0).replacen("material = \"rubber\"", upwards, 1);
    let setup = setup(&given.replace("frames_per_s = 20", "frames_per_s = 20\nsubsteps_per_frame = 36")).unwrap();
    let mut runner = Runner::<f64>::new(&setup).unwrap();
    let error = runner.advance(|| true).expect_err("nothing survives that").to_string();
    assert!(error.contains("volume ratio det F is -") && error.contains("particle"), "{error}");
    assert!(error.contains("more substeps"), "{error}");
}

#[test]
fn a_frame_that_breaks_down_is_tried_again_with_shorter_steps() {
    // The plan knows how fast obstacles travel, but not how fast they spin.
    let blade = "[[colliders]]\nshape.box = { centre_m = [0, 0.3, 0], size_m = [1, 0.1, 0.1] }\n\
                 spin_rad_s = [0, 300, 0]\n[[objects]]";
    let falling = GOOD.replacen("[[objects]]", blade, 1).replace("[0, 0.1, 0]", "[0.3, 0.44, 0]");
    let setup = setup(&falling).unwrap();
    let mut runner = Runner::<f64>::new(&setup).unwrap();
    while runner.frame().index < 2 && runner.advance(|| true).is_ok() {}
    assert!(runner.frame().substeps > setup.schedule.substeps, "{} substeps", runner.frame().substeps);
}
