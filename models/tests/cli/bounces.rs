//! Films of a hard ball: the contact is shorter than a frame, and the flights tell the restitution.

use std::fs;

use crate::scene::{Scene, contents};

const RATE: f64 = 30.0;
const RESTITUTION: f64 = 0.7;
const SIZE: [usize; 2] = [200, 180];

/// Metres in a pixel, radius of the ball \[pixels\], where it is let go, and the ground \[pixels\].
const METRES: f64 = 0.005;
const RADIUS: f64 = 8.0;
const FROM: [f64; 2] = [60.0, 25.0];
const GROUND: f64 = 165.0;

/// Centre of the ball, some time after it was let go.
fn place(time: f64) -> [f64; 2] {
    let (a, floor) = (9.81 / METRES, GROUND - RADIUS);
    let mut speed = (2.0 * a * (floor - FROM[1])).sqrt();
    let mut t = time - speed / a;
    let x = FROM[0] + 40.0 * time;
    if t < 0.0 {
        return [x, FROM[1] + 0.5 * a * time * time];
    }
    loop {
        speed *= RESTITUTION;
        if t < 2.0 * speed / a {
            return [x, floor - speed * t + 0.5 * a * t * t];
        }
        t -= 2.0 * speed / a;
    }
}

/// A folder of pictures of a red ball before a patterned wall, as a flat camera sees it.
fn film() -> Scene {
    let scene = Scene::new();
    fs::create_dir(scene.path("ball")).unwrap();
    for frame in 0..40 {
        let [u, v] = place(f64::from(frame) / RATE);
        let mut pixels = Vec::new();
        for i in 0..SIZE[0] * SIZE[1] {
            let [x, y] = [(i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5];
            let pattern = 14.0 * ((0.21 * x + 0.05 * y).sin() + (0.17 * y - 0.02 * x).cos());
            let wall = if y > GROUND { [90.0, 70.0, 50.0] } else { [120.0, 125.0, 130.0] };
            let inside = (RADIUS - (x - u).hypot(y - v) + 0.5).clamp(0.0, 1.0);
            let noise = ((frame as usize * 7919 + i * 104_729) % 13) as f64 / 4.0 - 1.5;
            for (wall, ball) in wall.into_iter().zip([210.0, 50.0, 40.0]) {
                pixels.push((inside * ball + (1.0 - inside) * (wall + pattern) + noise).clamp(0.0, 255.0) as u8);
            }
        }
        let file = fs::File::create(scene.path(&format!("ball/{frame}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, SIZE[0] as u32, SIZE[1] as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    }
    scene
}

#[test]
fn a_hard_ball_is_known_by_its_flights() {
    let scene = film();
    let printed = scene.succeeds("check ball --fps 30");
    for part in ["contact: shorter than a frame", "restitution 0.", "stiffness cannot be seen"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    let seen: serde_json::Value = serde_json::from_str(&scene.succeeds("check ball --fps 30 --json")).unwrap();
    let [low, high] = [0, 1].map(|end| seen["interval_90"]["restitution"][end].as_f64().unwrap());
    let found = seen["restitution"].as_f64().unwrap();
    assert!((found - RESTITUTION).abs() < 0.04 && low < RESTITUTION && RESTITUTION < high, "{low} to {high}");
    assert!(seen["contact_below_s"].as_f64().unwrap() <= 1.01 / RATE, "{seen}");

    scene.succeeds("reconstruct ball --fps 30 --out out --config quick.toml");
    let parameters = scene.parameters("out");
    let restitution = &parameters["restitution"];
    assert_eq!((&restitution["unit"], &restitution["determined"]), (&"-".into(), &true.into()));
    assert_eq!(restitution["value"].as_f64().unwrap(), found);
    assert!(parameters["tangential_ratio"]["value"].as_f64().is_some_and(f64::is_finite), "{parameters}");
    for name in ["young", "poisson"] {
        assert_eq!(parameters[name]["determined"], false, "{parameters}");
        assert!(parameters[name]["interval_90"][1].as_f64().unwrap() > 0.0);
    }
    let page = fs::read_to_string(scene.path("out/index.html")).unwrap();
    for part in ["Restitution", "--contact resolved", "Hit at", "no picture shows it"] {
        assert!(page.contains(part), "no {part:?} on the page");
    }
    for file in ["input_and_reconstruction.gif", "particles/frame_000.ply", "config.toml", "state.json"] {
        assert!(scene.path("out").join(file).is_file(), "{file}");
    }
    // the body moves as a whole
    let height = |frame: usize| {
        let ply = fs::read(scene.path(&format!("out/particles/frame_{frame:03}.ply"))).unwrap();
        ply.len()
    };
    assert_eq!(height(0), height(5));

    // it goes on from any place, to the same numbers
    let state = scene.state("out");
    assert_eq!(state["finished"], serde_json::json!(["shape", "free flights"]));
    let whole = contents(&scene.path("out"));
    let mut stopped = state.clone();
    for list in ["finished", "seconds"] {
        stopped[list].as_array_mut().unwrap().pop();
    }
    stopped.as_object_mut().unwrap().remove("bounces");
    scene.write("out/state.json", stopped.to_string());
    scene.succeeds("reconstruct ball --out out --resume");
    assert_eq!(scene.state("out")["bounces"], state["bounces"]);
    let again = contents(&scene.path("out"));
    let gif = |files: &std::collections::BTreeMap<_, Option<Vec<u8>>>| {
        files[&scene.path("out/input_and_reconstruction.gif")].clone()
    };
    assert!(gif(&whole) == gif(&again));
    // what it would do otherwise is simulated
    scene.succeeds("simulate --from out --set young=1e5 --out again");
}

#[test]
fn the_simulation_can_be_insisted_on() {
    let scene = film();
    let printed = scene.succeeds("check ball --fps 30 --contact resolved");
    assert!(printed.contains("it is simulated as asked for"), "{printed}");
    let output = scene.run("check ball --fps 30 --contact elsewhere");
    assert_eq!(output.status.code(), Some(2));
}
