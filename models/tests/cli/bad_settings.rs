//! Settings that make no sense: refused by name, before anything is written.

use crate::scene::{Scene, text};

#[test]
fn files_of_settings() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for (settings, parts) in [
        ("[geometry]\nvoxel_size = 1.0", ["voxel_size", "config.toml"]),
        ("[geometry", ["line 1", "bad.toml"]),
        ("[geometry]\ndx = 'small'", ["dx", "bad.toml"]),
        ("[geometry]\ndx = -0.1", ["geometry.dx", "0.00001"]),
        ("[geometry]\ndx = 1e-300", ["geometry.dx", "0.00001"]),
        ("[geometry]\ndx = nan", ["geometry.dx", "0.00001"]),
        ("[geometry]\nhull_coverage = 2.0", ["geometry.hull_coverage", "0 to 1"]),
        ("[geometry.fit]\nsmoothness = nan", ["geometry.fit.smoothness", "positive"]),
        ("[world]\ndensity = 0.0", ["world.density", "kg/m³"]),
        ("[world]\ngravity = [0.0, inf, 0.0]", ["world.gravity", "m/s²"]),
        ("[world]\ncfl = 3.0", ["world.cfl", "0.01 to 1"]),
        ("[world]\ncfl = 1e-30", ["world.cfl", "0.01 to 1"]),
        ("[loss]\ntrajectory = -1.0", ["loss.trajectory", "positive"]),
        ("[loss.views]\nalpha = nan", ["loss.views.alpha", "0 to 100"]),
        ("[loss.pixels]\ndelta = 0.0", ["loss.pixels.delta", "positive"]),
        ("[loss.ranges]\noutside = -1.0", ["loss.ranges.outside", "positive"]),
        ("[loss.ranges.ranges]\n'neo_hookean.hardness' = [1.0, 2.0]", ["neo_hookean.hardness", "neo_hookean.young"]),
        ("[loss.ranges.ranges]\n'newtonian.viscosity' = [0.0, 2.0]", ["newtonian.viscosity", "can take"]),
        ("[clip]\nimagined = [7]", ["camera 7", "0, 3"]),
        ("[clip]\nimagined = [0, 3]", ["no view of the clip is real", "--cameras"]),
        ("[clip]\nshrink = 5000", ["clip.shrink", "at most 24"]),
        ("[material]\nname = 'cheese'", ["cheese", "neo_hookean"]),
        ("[clip]\ncameras = [3, 0, 3]", ["clip.cameras", "camera 3 twice"]),
        ("[temporal]\nenabled = false\n[loss.views]\nalpha = inf", ["loss.views.alpha", "100"]),
        ("[surface]\nlow = nan", ["surface.low", "within 0 to 1"]),
        ("[world]\nground = nan", ["world.ground", "metres"]),
        ("[imagine]\nguidance = inf", ["imagine.guidance", "number"]),
        ("[weights]\ncolour = inf", ["weights.colour", "finite"]),
        ("[weights]\nimagined_colour = inf", ["weights.imagined_colour", "finite"]),
        ("[material]\nname = 'auto'\nheld = ['young']", ["auto", "material.held"]),
        ("[material]\nname = 'auto'\n[material.start]\nyoung = 1e4", ["auto", "material.start"]),
        ("[material]\nheld = ['hardness']", ["hardness", "young"]),
        ("[material.start]\nhardness = 3.0", ["hardness", "young"]),
    ] {
        scene.write("bad.toml", settings);
        scene.refuses("reconstruct clip --out out --config bad.toml", &parts);
    }
    scene.refuses("reconstruct clip --out out --config missing.toml", &["missing.toml"]);
}

/// A file may speak of parameters of the material that the command line names: what is refused is the frames then.
#[test]
fn a_file_that_the_command_line_completes() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.write("held.toml", "[material]\nheld = ['yield_stress']\n[material.start]\nyield_stress = 500.0");
    scene.refuses("reconstruct clip --out out --config held.toml", &["yield_stress", "material.held", "young"]);
    scene.refuses("reconstruct clip --out out --config held.toml --material sand", &["yield_stress", "cohesion"]);
    scene.refuses("reconstruct clip --out out --config held.toml --material plasticine --frames 1", &["two frames"]);
}

#[test]
fn starting_values() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for young in ["-5", "0", "nan", "inf", "1e300", "1e-300"] {
        scene.refuses(&format!("reconstruct clip --out out --young {young}"), &["young", "Pa"]);
    }
    for poisson in ["0.5", "-0.9", "nan"] {
        scene.refuses(&format!("reconstruct clip --out out --poisson {poisson}"), &["poisson", "0.45"]);
    }
    scene.refuses("reconstruct clip --out out --material cheese", &["cheese", "plasticine"]);
    scene.refuses("reconstruct clip --out out --material sand --start hardness=3", &["hardness", "friction_angle"]);
    assert_eq!(scene.run("reconstruct clip --out out --start young").status.code(), Some(2));
    scene.refuses("reconstruct clip --out out --density -1", &["world.density"]);
    scene.refuses("reconstruct clip --out out --dx -1", &["geometry.dx"]);
    scene.refuses("reconstruct clip --out out --dx 0.00001", &["--dx", "too fine"]);
    scene.refuses("reconstruct clip --out out --ground nan", &["world.ground"]);
}

#[test]
fn cameras_and_frames() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.refuses("reconstruct clip --out out --cameras 0,9", &["camera 9", "0 and 3"]);
    scene.refuses("reconstruct clip --out out --frames 1", &["two frames", "--frames"]);
    scene.refuses("reconstruct clip --out out --frames 0", &["two frames", "--frames"]);
    scene.refuses("reconstruct clip --out out --cameras 0,3,0", &["camera 0 twice", "each camera once"]);
    for first in ["100", "-5", "1"] {
        scene.refuses(&format!("reconstruct clip --out out --first-frame={first}"), &["frame"]);
    }
    for arguments in ["reconstruct clip --young soft", "reconstruct clip --cameras left", "reconstruct", "cook clip"] {
        let output = scene.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("--help"), "{arguments}");
        assert!(!scene.path("runs").exists());
    }
}

#[test]
fn the_instruction_set() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for (name, said) in [("avx1024", "avx1024"), ("", "GRADREEL_ISA")] {
        let mut command = scene.command("check clip");
        let output = command.env("GRADREEL_ISA", name).output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        for part in ["error: ", "GRADREEL_ISA", said, "scalar", "fix: "] {
            assert!(message.contains(part), "no {part:?} in: {message}");
        }
        assert!(!message.contains("panicked"), "{message}");
    }
    let output = scene.command("check clip").env("GRADREEL_ISA", "scalar").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn files_that_are_no_settings() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.write("latin.toml", b"[clip]\n# caf\xe9\nshrink = 5\n");
    scene.refuses("reconstruct clip --out out --config latin.toml", &["latin.toml", "UTF-8", "line 2"]);
    scene.refuses("reconstruct clip --out out --config clip", &["clip", "--config"]);
    scene.refuses("train novel-view --out out --config latin.toml", &["latin.toml", "UTF-8"]);
    // without end, or longer than settings are
    #[cfg(unix)]
    scene.refuses("reconstruct clip --out out --config /dev/zero", &["/dev/zero", "16777216 bytes"]);
    // a byte order mark is no setting
    scene.write("bom.toml", "\u{feff}[geometry]\ndx = -1.0");
    scene.refuses("reconstruct clip --out out --config bom.toml", &["geometry.dx"]);
}

#[test]
fn units_and_names_of_what_to_start_from() {
    let scene = Scene::with_clip(&[0, 3], 2);
    // what is refused in the end is the number of frames: all before was understood
    for start in ["young=100kPa", "young=0.1MPa,poisson=0.3", "young=1e5", "young=1bar"] {
        scene.refuses(&format!("reconstruct clip --out out --frames 1 --start {start}"), &["two frames"]);
    }
    for options in
        ["--young 100kPa", "--density 0.95g/cm3", "--dx 2cm", "--material sand --start friction_angle=0.5rad"]
    {
        scene.refuses(&format!("reconstruct clip --out out --frames 1 {options}"), &["two frames"]);
    }
    for (options, parts) in [
        ("--start young=100m", ["--start young", "wanted: Pa"]),
        ("--start poisson=30Pa", ["--start poisson", "without a unit"]),
        ("--start young=1e3,young=1e4", ["--start young", "two values"]),
        ("--start young=1e3 --young 1e4", ["--start young", "two values"]),
        ("--poisson 0.2 --start poisson=0.3", ["--poisson", "two values"]),
        ("--start yung=1e4", ["young [Pa], poisson", "did you mean `young`?"]),
        ("--material rubber", ["did you mean `elastic`?", "plasticine"]),
        ("--material honey", ["did you mean `newtonian`?", "neo_hookean"]),
        ("--material Sand", ["did you mean `sand`?", "newtonian"]),
        ("--material auto --young 1e4", ["--young", "auto"]),
        ("--young 1e300", ["1e300 Pa", "--start young="]),
        ("--material sand --start friction_angle=200", ["friction_angle", "--start friction_angle="]),
    ] {
        scene.refuses(&format!("reconstruct clip --out out {options}"), &parts);
        let message = text(&scene.run(&format!("reconstruct clip --out out {options}")).stderr);
        assert!(!message.contains("[\"") && !message.contains("0000000000"), "{message}");
    }
}
