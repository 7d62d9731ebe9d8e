//! Numbers that no film has, and that looking at a clip says what opening it says.

use std::fs;

use gradreel_models::video::{OpenOptions, inspect, inspect_and_open};
use serde_json::json;

use super::builder::{Builder, has, in_square, red_square, write_png};

/// Two cameras with three frames each, so far apart \[s\].
fn apart(dt: f64) -> Builder {
    let mut builder = Builder::square(&[0, 1], 3);
    for (k, entry) in builder.entries.iter_mut().enumerate() {
        entry["time"] = json!((k % 3) as f64 * dt);
    }
    builder
}

#[test]
fn times_that_no_film_has() {
    assert!(apart(1.0 / 240.0).open().is_ok());
    for dt in [60.0, 1e-300, 1e-8, 1e300, 8e307] {
        let builder = apart(dt);
        has(&builder.fails(), &["all_data.json", "s between frames"]);
        assert!(!inspect(&builder.root).unwrap().to_string().contains("ready to open"), "{dt}");
    }
    let text = apart(60.0).fails();
    // half of 9.81 m/s² times 3600 s²
    has(&text, &["60.0 s between frames", "18000.0 m", "frames_per_s"]);
    // milliseconds, and what to do about them
    let builder = apart(40.0);
    fs::write(builder.root.join("clip.toml"), "frames_per_s = 25.0").unwrap();
    assert!((builder.open().unwrap().frame_dt() - 0.04).abs() < 1e-12);
    for rate in ["0.01", "9e5"] {
        fs::write(builder.root.join("clip.toml"), format!("frames_per_s = {rate}")).unwrap();
        let opened = builder.open();
        let said = inspect(&builder.root).unwrap().to_string();
        assert_eq!(opened.is_ok(), rate == "9e5");
        has(&said, &["s between frames"]);
    }
    // slow, but possible: said
    let builder = apart(0.5);
    let clip = builder.open().unwrap();
    assert!(clip.assumptions.iter().any(|line| line.contains("0.5 s between frames")), "{:?}", clip.assumptions);
}

#[test]
fn places_and_lenses_that_no_film_has() {
    let numbers: [(&str, usize, usize, f64, &str); 6] = [
        ("c2w", 0, 3, 1e308, "1e308"),
        ("c2w", 1, 3, -5e6, "origin"),
        ("intrinsic", 0, 0, 0.5, "0.5 pixels for 24 pixels"),
        ("intrinsic", 1, 1, 1e200, "angle of view"),
        ("intrinsic", 0, 2, 1e300, "principal point (1e300"),
        ("intrinsic", 1, 2, -500.0, "principal point"),
    ];
    for (key, row, column, value, part) in numbers {
        let mut builder = Builder::square(&[0, 1], 3);
        for entry in &mut builder.entries {
            entry[key][row][column] = json!(value);
        }
        has(&builder.fails(), &["all_data.json", part]);
        assert!(!inspect(&builder.root).unwrap().is_complete());
    }
    // outside the image, but near it: said
    let mut builder = Builder::square(&[0], 2);
    for entry in &mut builder.entries {
        entry["intrinsic"][0][2] = json!(-3.0);
    }
    assert!(builder.open().unwrap().assumptions.iter().any(|line| line.contains("looks past its image")));
}

#[test]
fn a_single_frame_is_not_simply_ready() {
    let builder = Builder::square(&[0, 1], 1);
    builder.save();
    let text = inspect(&builder.root).unwrap().to_string();
    has(&text, &["a single frame: shape only, no motion", "not to reconstruct"]);
}

/// What looking finds is what opening finds, whatever is wrong.
#[test]
fn looking_is_opening() {
    type Damage = (&'static str, fn(&mut Builder));
    let damage: [Damage; 11] = [
        ("nothing", |_| {}),
        ("the second half of a later image", |b| {
            let path = b.path('r', 1, 2);
            let whole = fs::read(&path).unwrap();
            fs::write(path, &whole[..whole.len() - 20]).unwrap();
        }),
        ("an opaque plate of excluded pixels", |b| b.image('r', 1, -2, false, &red_square)),
        ("a mask of another size", |b| {
            (0..3).for_each(|f| write_png(&b.path('a', 0, f), (20, 16), true, &red_square));
        }),
        ("opaque masks", |b| (0..3).for_each(|f| b.image('a', 0, f, false, &red_square))),
        ("masks for some frames", |b| b.image('a', 0, 1, true, &red_square)),
        ("masks that are no images", |b| (0..3).for_each(|f| fs::write(b.path('m', 0, f), "text").unwrap())),
        ("no object in a camera", |b| (0..3).for_each(|f| b.image('r', 1, f, true, &|_, _| [0; 4]))),
        ("no object in a frame", |b| (0..2).for_each(|c| b.image('r', c, 1, true, &|_, _| [0; 4]))),
        ("transparency in a later frame only", |b| {
            let ground = |x: usize, y: usize| if in_square(x, y) { [9, 9, 9, 255] } else { [90, 90, 90, 255] };
            b.image('r', 0, 0, true, &ground);
        }),
        ("every camera imagined", |b| fs::write(b.root.join("clip.toml"), "imagined = [0, 1]").unwrap()),
    ];
    for (name, break_it) in damage {
        let mut builder = Builder::square(&[0, 1], 3);
        break_it(&mut builder);
        let opened = builder.open();
        let inventory = inspect(&builder.root).unwrap();
        assert_eq!(opened.is_ok(), inventory.is_complete(), "{name}: {inventory}");
        assert_eq!(opened.is_ok(), inventory.to_string().contains("ready to open"), "{name}: {inventory}");
        if let Err(error) = opened {
            assert!(inventory.problems.contains(&error.to_string()), "{name}: {error}, {inventory}");
        }
    }
}

/// What is wrong with a camera that is not chosen does not matter.
#[test]
fn only_what_is_chosen_must_be_right() {
    let builder = Builder::square(&[0, 1], 3);
    builder.save();
    fs::write(builder.path('r', 1, 0), "text").unwrap();
    assert!(!inspect(&builder.root).unwrap().is_complete());
    let options = OpenOptions { cameras: Some(vec![0]), ..OpenOptions::default() };
    let (inventory, clip) = inspect_and_open(&builder.root, &options).unwrap();
    assert!(inventory.is_complete() && inventory.cameras.len() == 2, "{inventory}");
    assert_eq!(clip.unwrap().cameras.len(), 1);
}
