//! Films whose frames are not all shown for the same time, and films that are cut off.

use std::fs;

use crate::monocular::clip_of_film;
use crate::video::{Clip, FilmSettings, OpenOptions};

use super::ball::{
    FRAMES, Folder, GRAVITY, RADIUS, VELOCITY, floor, landed, pictures, write_gif, write_gif_with, write_video,
};

/// How far before the camera the ball is first, along the axis that looks down by 12°: 0.18 sin 12° + 1.45 cos 12°.
const DISTANCE: f64 = 1.4557;

fn open(folder: &Folder, name: &str, frames_per_s: f64) -> Clip {
    let settings = FilmSettings { frames_per_s, field_of_view: 40.0, elevation: Some(12.0), ..FilmSettings::default() };
    clip_of_film(&folder.path(name), &settings, &OpenOptions::default(), GRAVITY).unwrap()
}

#[track_caller]
fn is_true(clip: &Clip) {
    let flight = clip.flight.unwrap();
    // within two of the deviations that are stated
    assert!(flight.deviation < 0.2, "{}", flight.deviation);
    assert!((flight.distance / DISTANCE).ln().abs() < 2.0 * flight.deviation, "{} m", flight.distance);
    assert!((flight.diameter / (2.0 * RADIUS)).ln().abs() < 2.0 * flight.deviation, "{} m", flight.diameter);
    assert!((flight.velocity[1] - VELOCITY[1]).abs() < 0.1, "{:?}", flight.velocity);
    assert_eq!(flight.frames, landed());
    assert!((1.0 / clip.frame_dt() - 25.0).abs() < 1.5, "{}", clip.frame_dt());
}

#[test]
fn each_frame_has_its_own_time() {
    let folder = Folder::new();
    let all = pictures(|_, _| [255, 255, 255, 255]);
    // 0.04 s but for one in six, and the first or last frame held for seconds
    let usual = |k: usize| if k % 6 == 5 { 5 } else { 4 };
    for held in [0, FRAMES - 1] {
        write_gif_with(&folder.path("film.gif"), &all, |k| if k == held { 300 } else { usual(k) });
        let clip = open(&folder, "film.gif", 0.0);
        is_true(&clip);
        assert_eq!(clip.frame_count(), FRAMES);
    }
    // at rest three frames are one, as writers of GIFs make it
    let merged: Vec<_> = [&all[..landed() + 1], &all[FRAMES - 1..]].concat();
    let last = merged.len() - 2;
    write_gif_with(&folder.path("merged.gif"), &merged, |k| if k == last { 13 } else { usual(k) });
    let clip = open(&folder, "merged.gif", 0.0);
    is_true(&clip);
    assert_eq!(clip.frame_count(), merged.len() + 2);
    assert!(clip.frames[0][last] == clip.frames[0][last + 1] && clip.frames[0][last] == clip.frames[0][last + 2]);
    assert!(clip.assumptions.iter().any(|line| line.contains("repeated, 2 in all")), "{:?}", clip.assumptions);
    // what is given counts, whatever the file says
    let clip = open(&folder, "merged.gif", 24.0);
    assert_eq!(clip.frame_count(), merged.len());
    approx::assert_relative_eq!(clip.frame_dt(), 1.0 / 24.0, max_relative = 1e-12);
}

/// A frame that was left out in the air: nothing counts in its place, and the fall goes on behind it.
#[test]
fn a_frame_that_is_not_there_is_not_made_up() {
    let folder = Folder::new();
    let mut all = pictures(|_, _| [255, 255, 255, 255]);
    all.remove(3);
    write_gif_with(&folder.path("film.gif"), &all, |k| match k {
        2 => 8,
        5 => 5,
        _ => 4,
    });
    let clip = open(&folder, "film.gif", 0.0);
    is_true(&clip);
    assert_eq!(clip.frame_count(), FRAMES);
    let counts: Vec<bool> = clip.frames[0].iter().map(|frame| frame.weight.iter().any(|w| *w > 0.0)).collect();
    assert_eq!(counts.iter().position(|counts| !counts), Some(3));
    assert_eq!(counts.iter().filter(|counts| **counts).count(), FRAMES - 1);
}

#[test]
fn a_film_that_is_cut_off_has_its_whole_frames() {
    let folder = Folder::new();
    let film = folder.path("film.gif");
    write_gif(&film, &pictures(|_, _| [255, 255, 255, 255]));
    let bytes = fs::read(&film).unwrap();
    assert_eq!(bytes.last(), Some(&0x3b));
    for (kept, frames) in [(bytes.len() - 1, FRAMES), (bytes.len() - 40, FRAMES - 1)] {
        fs::write(&film, &bytes[..kept]).unwrap();
        let clip = open(&folder, "film.gif", 0.0);
        is_true(&clip);
        assert_eq!(clip.frame_count(), frames);
        let said = format!("{frames} whole frames");
        assert!(clip.assumptions.iter().any(|line| line.contains(&said)), "{:?}", clip.assumptions);
    }
}

#[test]
fn a_video_with_a_hold() {
    let folder = Folder::new();
    // the last two frames, in which the ball lies, come five intervals later
    let late = ["-vf", "setpts=if(lt(N\\,8)\\,N\\,N+5)/24/TB", "-vsync", "vfr"];
    let Some(_) = write_video(&folder, &pictures(floor), &late) else { return };
    let clip = open(&folder, "ball.mp4", 0.0);
    assert_eq!(clip.frame_count(), FRAMES + 5);
    approx::assert_relative_eq!(clip.frame_dt(), 1.0 / 24.0, max_relative = 1e-3);
    is_true(&clip);
}
