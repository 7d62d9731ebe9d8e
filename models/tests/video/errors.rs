//! Broken folders: each is refused with the file, what was found, and a way out.

use std::fs;

use gradreel_models::video::{Clip, OpenOptions, inspect};
use serde_json::{Value, json};

use super::builder::{Builder, has, in_square, message, red_square, write_png};

#[test]
fn a_missing_folder_and_a_missing_list() {
    let nowhere = std::env::temp_dir().join("gradreel-no-such-clip");
    has(&message(Clip::open(&nowhere, &OpenOptions::default()).unwrap_err()), &["no-such-clip", "all_data.json"]);
    message(inspect(&nowhere).unwrap_err());
    let builder = Builder::square(&[0], 1);
    has(&message(Clip::open(&builder.root, &OpenOptions::default()).unwrap_err()), &["all_data.json", "image list"]);
}

#[test]
fn malformed_lists() {
    let builder = Builder::square(&[0], 1);
    for (text, part) in [
        ("", "EOF"),
        ("[{\"file_path\": ", "line 1"),
        ("[{\"time\": NaN}]", "expected value"),
        ("{\"frames\": []}", "not a list"),
        ("[]", "no entry"),
        ("[1, 2]", "file_path is missing"),
    ] {
        fs::write(builder.root.join("all_data.json"), text).unwrap();
        has(&message(Clip::open(&builder.root, &OpenOptions::default()).unwrap_err()), &["all_data.json", part]);
    }
}

#[test]
fn unusable_entries_are_named() {
    let identity = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
    let cases: Vec<(&str, Value, &str)> = vec![
        ("c2w", json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), "c2w is 3×3, not 3×4"),
        ("c2w", json!([[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0]]), "ragged"),
        ("c2w", json!([[1, 0, 0, null], [0, 1, 0, 0], [0, 0, 1, 0]]), "null"),
        ("c2w", json!([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]), "not a rotation"),
        ("c2w", json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]), "mirrors"),
        ("c2w", json!([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0]]), "changes its c2w"),
        ("intrinsic", json!([[30, 0], [0, 30]]), "intrinsic is 2×2, not 3×3"),
        ("intrinsic", json!([[-30, 0, 12], [0, 30, 8], [0, 0, 1]]), "positive"),
        ("intrinsic", identity, "intrinsic is 3×4"),
        ("time", json!("soon"), "time is"),
        ("file_path", json!("./data/left.png"), "no camera and frame number"),
        ("file_path", json!("r_0_0.png"), "listed twice"),
    ];
    for (key, value, part) in cases {
        let mut builder = Builder::square(&[0], 3);
        builder.entries[1][key] = value;
        has(&builder.fails(), &["entry 1", part]);
    }
}

#[test]
fn broken_images() {
    let builder = Builder::square(&[2], 3);
    let path = builder.path('r', 2, 1);
    let whole = fs::read(&path).unwrap();
    for bytes in [&whole[..whole.len() / 2], &whole[..12], b"not a png at all", b""] {
        fs::write(&path, bytes).unwrap();
        has(&builder.fails(), &["r_2_1.png", "cannot decode"]);
    }
    let mut flipped = whole.clone();
    let middle = whole.len() / 2;
    flipped[middle] ^= 0xff;
    fs::write(&path, &flipped).unwrap();
    has(&builder.fails(), &["r_2_1.png", "cannot decode"]);
    write_png(&path, (24, 17), true, &red_square);
    has(&builder.fails(), &["r_2_1.png", "24 × 17", "24 × 16"]);
    assert!(inspect(&builder.root).unwrap().problems.iter().any(|problem| problem.contains("24 × 17")));
}

/// A header that claims 100 000 × 100 000 pixels must be refused before memory is asked for.
#[test]
fn a_hostile_size() {
    let builder = Builder::square(&[0], 1);
    let path = builder.path('r', 0, 0);
    let mut bytes = fs::read(&path).unwrap();
    bytes[16..20].copy_from_slice(&100_000u32.to_be_bytes());
    bytes[20..24].copy_from_slice(&100_000u32.to_be_bytes());
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    fs::write(&path, bytes).unwrap();
    has(&builder.fails(), &["r_0_0.png", "100000 × 100000", "at most"]);
}

/// Images that together need more memory than there may be are refused by their headers.
#[test]
fn images_that_are_too_large_together() {
    let builder = Builder::square(&[0], 6);
    for frame in 0..6 {
        let path = builder.path('r', 0, frame);
        let mut bytes = fs::read(&path).unwrap();
        bytes[16..20].copy_from_slice(&16_384u32.to_be_bytes());
        bytes[20..24].copy_from_slice(&4096u32.to_be_bytes());
        let crc = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        fs::write(&path, bytes).unwrap();
    }
    // 6 · 16384 · 4096 pixels
    has(&builder.fails(), &["too large", "6 images of 402 megapixels", "--frames"]);
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}

#[test]
fn gaps_are_named() {
    let mut builder = Builder::square(&[0, 3], 14);
    fs::remove_file(builder.path('r', 3, 5)).unwrap();
    has(&builder.fails(), &["camera 3 has frames 0–4 and 6–13, frame 5 is missing", "r_3_5.png"]);
    assert!(!inspect(&builder.root).unwrap().is_complete());
    builder.entries.retain(|entry| entry["file_path"] != "./data/r_3_5.png");
    has(&builder.fails(), &["camera 3 has frames 0–4 and 6–13, frame 5 is missing", "no entry"]);
    // What is complete can still be opened.
    let clip = builder.open_with(&OpenOptions { max_frames: Some(5), ..OpenOptions::default() }).unwrap();
    assert_eq!((clip.cameras.len(), clip.frame_count()), (2, 5));
    let clip = builder.open_with(&OpenOptions { first_frame: Some(6), ..OpenOptions::default() }).unwrap();
    assert_eq!(clip.frame_numbers, (6..14).collect::<Vec<i64>>());
    let clip = builder.open_with(&OpenOptions { cameras: Some(vec![0]), ..OpenOptions::default() }).unwrap();
    assert_eq!((clip.cameras[0].id, clip.frame_count()), (0, 14));
    // A camera that stops early, and a frame number that would never end.
    let mut builder = Builder::square(&[0, 1], 4);
    builder.entries.pop();
    has(&builder.fails(), &["camera 1 has frames 0–2, frame 3 is missing"]);
    builder.list(1, 9_000_000_000_000);
    has(&builder.fails(), &["frame 4 is missing"]);
}

#[test]
fn wrong_choices_and_times() {
    let mut builder = Builder::square(&[0, 1], 4);
    let choose = |options| message(builder.open_with(&options).unwrap_err());
    has(&choose(OpenOptions { cameras: Some(vec![7]), ..OpenOptions::default() }), &["camera 7", "0–1"]);
    has(&choose(OpenOptions { cameras: Some(vec![]), ..OpenOptions::default() }), &["no camera"]);
    has(&choose(OpenOptions { max_frames: Some(0), ..OpenOptions::default() }), &["no frame"]);
    has(&choose(OpenOptions { first_frame: Some(9), ..OpenOptions::default() }), &["no frame"]);
    builder.entries[2]["time"] = json!(0.2);
    has(&builder.fails(), &["not evenly spaced", "frame 2"]);
    let mut builder = Builder::square(&[0, 1], 4);
    for entry in &mut builder.entries[4..] {
        entry["time"] = json!(entry["time"].as_f64().unwrap() + 0.02);
    }
    has(&builder.fails(), &["not synchronous"]);
    for entry in &mut builder.entries {
        entry["time"] = json!(0);
    }
    has(&builder.fails(), &["does not advance"]);
}

#[test]
fn nothing_to_tell_the_object_by_and_no_object() {
    let floor = |_: usize, _: usize| [120, 100, 80, 255];
    let mut builder = Builder::square(&[0], 2);
    for frame in 0..2 {
        builder.list(4, frame);
        builder.image('r', 4, frame, false, &floor);
    }
    has(&builder.fails(), &["camera 4", "r_4_-1.png"]);
    builder.image('r', 4, -1, false, &floor);
    has(&builder.fails(), &["camera 4 never sees an object"]);
    // Seen once is enough for a camera …
    builder.image('r', 4, 1, false, &|x, y| if in_square(x, y) { [20, 40, 200, 255] } else { [120, 100, 80, 255] });
    assert!(builder.open().is_ok());
    // … but in every frame somebody has to see it.
    builder.image('r', 0, 0, true, &|_, _| [0, 0, 0, 0]);
    has(&builder.fails(), &["no camera sees an object in frame 0"]);
    // Masks for some frames only.
    let builder = Builder::square(&[0], 3);
    builder.image('a', 0, 1, true, &red_square);
    has(&builder.fails(), &["camera 0 has masks for some frames only", "a_0_{frame}.png for frames 1"]);
}

/// Folders in `file_path` are ignored: only the two numbers are used.
#[test]
fn paths_are_not_followed() {
    let mut builder = Builder::square(&[0], 2);
    fs::write(builder.root.join("r_0_1.png"), "outside").unwrap();
    builder.entries[1]["file_path"] = json!("../../../../../../etc/../r_0_1.png");
    assert_eq!(builder.open().unwrap().frame_count(), 2);
    builder.entries[1]["file_path"] = json!("../../etc/passwd");
    has(&builder.fails(), &["no camera and frame number"]);
}
