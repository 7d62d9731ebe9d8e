//! Films that cannot be used: each refused with the place, what was found and a way out.

use std::fs;
use std::path::Path;

use crate::monocular::clip_of_film;
use crate::video::{FilmSettings, OpenOptions};
use gradreel::ErrorKind;

use super::ball::{Folder, GRAVITY, floor, pictures, write_folder, write_gif};

#[track_caller]
fn refused(path: &Path, settings: &FilmSettings, options: &OpenOptions, parts: &[&str]) {
    let error = clip_of_film(path, settings, options, GRAVITY).expect_err("a film that cannot be used");
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    let message = error.to_string();
    for part in parts.iter().chain(&["fix: "]) {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

fn whole() -> OpenOptions {
    OpenOptions::default()
}

#[test]
fn damaged_gifs() {
    let folder = Folder::new();
    let film = folder.path("film.gif");
    write_gif(&film, &pictures(floor));
    let bytes = fs::read(&film).unwrap();
    for damaged in [&bytes[..bytes.len() / 20], &bytes[..20], b"", b"not a gif at all"] {
        fs::write(&film, damaged).unwrap();
        refused(&film, &FilmSettings::default(), &whole(), &["film.gif"]);
    }
    // a header that promises 65535 × 65535 pixels
    let mut huge = bytes.clone();
    huge[6..10].fill(0xff);
    fs::write(&film, huge).unwrap();
    refused(&film, &FilmSettings::default(), &whole(), &["film.gif", "too large", "65535"]);
}

#[test]
fn a_video_that_is_none() {
    let folder = Folder::new();
    let film = folder.path("film.mp4");
    for bytes in [&b""[..], b"#EXTM3U\nhttp://localhost/x.ts\n", &[0; 4096]] {
        fs::write(&film, bytes).unwrap();
        refused(&film, &FilmSettings::default(), &whole(), &["film.mp4", "ffmpeg"]);
    }
}

#[test]
fn films_that_do_not_say_enough() {
    let folder = Folder::new();
    let frames = folder.path("frames");
    let all = pictures(floor);
    write_folder(&frames, &all);
    refused(&frames, &FilmSettings::default(), &whole(), &["frames", "how fast", "--fps"]);
    let fps = FilmSettings { frames_per_s: 24.0, ..FilmSettings::default() };
    let late = OpenOptions { first_frame: Some(99), ..whole() };
    refused(&frames, &fps, &late, &["no frame", "99"]);
    // it lies on the floor from the first of these on
    let lying = OpenOptions { first_frame: Some(6), ..whole() };
    refused(&frames, &fps, &lying, &["frames"]);
    let backwards: Vec<_> = all[..5].iter().rev().cloned().collect();
    write_folder(&folder.path("backwards"), &backwards);
    let rising = FilmSettings { elevation: Some(-60.0), ..fps.clone() };
    refused(&folder.path("backwards"), &rising, &OpenOptions { max_frames: Some(2), ..whole() }, &["free fall"]);

    let masks = folder.path("masks");
    write_folder(&masks, &all[..3]);
    refused(
        &frames,
        &FilmSettings { masks: Some(masks), ..fps.clone() },
        &whole(),
        &["more frames than masks", "3 PNG"],
    );
    let nothing = FilmSettings { background: Some(frames.join("none.png")), ..fps.clone() };
    assert!(clip_of_film(&frames, &nothing, &whole(), GRAVITY).unwrap_err().to_string().contains("none.png"));
    for wrong in [
        FilmSettings { frames_per_s: f64::NAN, ..fps.clone() },
        FilmSettings { field_of_view: 180.0, ..fps.clone() },
        FilmSettings { elevation: Some(f64::INFINITY), ..fps.clone() },
    ] {
        refused(&frames, &wrong, &whole(), &["clip.film."]);
    }
    let sideways = clip_of_film(&frames, &fps, &whole(), [9.8, 0.0, 0.0]).unwrap_err();
    assert!(sideways.to_string().contains("world.gravity"), "{sideways}");
}

#[test]
fn an_object_that_is_not_in_every_frame() {
    let folder = Folder::new();
    let mut all = pictures(floor);
    all[7] = (0..160 * 160).flat_map(|i| floor(i % 160, i / 160)).collect();
    write_folder(&folder.path("frames"), &all);
    let fps = FilmSettings { frames_per_s: 24.0, ..FilmSettings::default() };
    // one such frame is left out
    let clip = clip_of_film(&folder.path("frames"), &fps, &whole(), GRAVITY).unwrap();
    assert_eq!(clip.frame_count(), all.len());
    assert!(clip.assumptions.iter().any(|line| line.contains("nothing in frame 7 counts")), "{:?}", clip.assumptions);
    for (k, frame) in clip.frames[0].iter().enumerate() {
        assert_eq!(frame.weight.iter().all(|weight| *weight == 0.0), k == 7, "frame {k}");
    }
    // but not a quarter of them, nor one of the first
    let empty = all[7].clone();
    (8..10).for_each(|k| all[k].clone_from(&empty));
    write_folder(&folder.path("often"), &all);
    refused(&folder.path("often"), &fps, &whole(), &["frame 7", "cannot be told", "3 of"]);
    let mut all = pictures(floor);
    all[1] = empty;
    write_folder(&folder.path("early"), &all);
    refused(&folder.path("early"), &fps, &whole(), &["frame 1", "cannot be told"]);
}
