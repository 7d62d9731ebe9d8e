//! GIFs, folders of pictures and video files before backgrounds of all kinds, of a camera that nobody knows.

use std::path::Path;

use crate::monocular::clip_of_film;
use crate::video::{Clip, Film, FilmSettings, Foreground, OpenOptions};

use super::ball::{
    FRAMES, Folder, GRAVITY, RADIUS, START, VELOCITY, camera, coverage, floor, landed, middle, pictures, write_folder,
    write_gif, write_video,
};

fn open(path: &Path, settings: &FilmSettings) -> Clip {
    assert!(Film::is_at(path));
    clip_of_film(path, settings, &OpenOptions::default(), GRAVITY).unwrap()
}

fn fps() -> FilmSettings {
    FilmSettings { frames_per_s: 24.0, ..FilmSettings::default() }
}

/// Pixels whose coverage is on the wrong side of one half, in the worst frame.
fn wrong(clip: &Clip) -> usize {
    let camera = camera();
    let frames = clip.frames[0].iter().enumerate().map(|(k, frame)| {
        let truth = coverage(&camera, middle(k));
        frame.alpha.iter().zip(&truth).filter(|(a, b)| (**a > 0.5) != (**b > 0.5)).count()
    });
    frames.max().unwrap()
}

#[test]
fn every_background_is_told_from_the_object() {
    let folder = Folder::new();
    let film = folder.path("film.gif");
    for (behind, foreground) in [
        ((|_, _| [0, 0, 0, 0]) as fn(usize, usize) -> [u8; 4], Foreground::ImageAlpha),
        (|_, _| [255, 255, 255, 255], Foreground::White),
        (|_, _| [20, 180, 60, 255], Foreground::Plain),
        (floor, Foreground::Still),
    ] {
        write_gif(&film, &pictures(behind));
        let clip = open(&film, &FilmSettings::default());
        assert_eq!(clip.foreground, [foreground]);
        // the ball covers a thousand pixels and has a hundred and twenty at its edge
        assert!(wrong(&clip) < 60, "{foreground}: {} pixels", wrong(&clip));
        assert_eq!(clip.frame_count(), FRAMES);
    }
    // a given background and given masks come first
    write_gif(&film, &pictures(floor));
    write_folder(&folder.path("empty"), &[(0..160 * 160).flat_map(|i| floor(i % 160, i / 160)).collect()]);
    let settings = FilmSettings { background: Some(folder.path("empty/frame0.png")), ..FilmSettings::default() };
    let clip = open(&film, &settings);
    assert_eq!((clip.foreground[0], wrong(&clip) < 60), (Foreground::Plate, true));
    let camera = camera();
    let mask = |k| {
        coverage(&camera, middle(k)).iter().flat_map(|a| [[(255.0 * a) as u8; 3].as_slice(), &[255]].concat()).collect()
    };
    write_folder(&folder.path("masks"), &(0..FRAMES).map(mask).collect::<Vec<Vec<u8>>>());
    let clip = open(&film, &FilmSettings { masks: Some(folder.path("masks")), ..FilmSettings::default() });
    assert_eq!((clip.foreground[0], wrong(&clip) < 4), (Foreground::Mask, true));
}

#[test]
fn an_unknown_camera_still_gives_metres() {
    let folder = Folder::new();
    let film = folder.path("ball.gif");
    write_gif(&film, &pictures(|_, _| [0, 0, 0, 0]));
    let known = FilmSettings { field_of_view: 40.0, elevation: Some(12.0), ..fps() };
    for settings in [known, fps()] {
        let clip = open(&film, &settings);
        let flight = clip.flight.unwrap();
        // what the camera's pitch leaves open
        let unsure = settings.elevation.map_or(2.0, |_| 0.0);
        assert_eq!(flight.frames, landed());
        // directions follow the camera, which looks along −z in the world of the film, too
        let off = [0, 1, 2].map(|axis| (flight.velocity[axis] - VELOCITY[axis]).abs());
        let allowed = flight.velocity_deviation().map(|deviation| f64::max(0.07, unsure * deviation));
        assert!(off[0] < allowed[0] && off[1] < allowed[1], "{:.3?}, {allowed:.3?}", flight.velocity);
        assert!(allowed[0] < 0.15 && allowed[1] < 0.4, "{allowed:.3?}");
        // what it does along the line of sight is seen least, and said so
        assert!(off[2] < 2.0 * flight.velocity_deviation()[2] && off[2] < 0.5, "{:.3?}", flight.velocity);
        // the floor is at height 0
        let allowed = f64::max(0.04, unsure * flight.deviation * START[1]);
        assert!((flight.centre[1] - START[1]).abs() < allowed, "{:.3?}, {allowed:.3}", flight.centre);
        let bottom = flight.at(landed() as f64 / 24.0)[1] - RADIUS;
        assert!(bottom < 0.01, "by then it would be below the floor: {bottom}");
        for part in ["camera", "scale", "ground", "shape"] {
            assert!(clip.assumptions.iter().any(|line| line.starts_with(part)), "{part}: {:?}", clip.assumptions);
        }
    }
}

#[test]
fn folders_and_a_part_of_a_film() {
    let folder = Folder::new();
    let all = pictures(floor);
    write_folder(&folder.path("frames"), &all);
    let options = OpenOptions { first_frame: Some(1), max_frames: Some(8), cameras: None, progress: false };
    let clip = clip_of_film(&folder.path("frames"), &fps(), &options, GRAVITY).unwrap();
    assert_eq!((clip.frame_numbers[0], clip.frame_count(), clip.name.as_str()), (1, 8, "frames"));
    assert!((clip.flight.unwrap().velocity[1] - (VELOCITY[1] - 9.8 / 24.0)).abs() < 0.1);
}

#[test]
fn a_video_file() {
    let folder = Folder::new();
    let Some(film) = write_video(&folder, &pictures(floor), &[]) else { return };
    let clip = open(&film, &FilmSettings::default());
    assert_eq!(clip.frame_count(), FRAMES);
    approx::assert_relative_eq!(clip.frame_dt(), 1.0 / 24.0, max_relative = 1e-6);
    assert!(wrong(&clip) < 80, "{} pixels", wrong(&clip));
    let options = OpenOptions { first_frame: Some(2), max_frames: Some(4), cameras: None, progress: false };
    let part = Film::read(&film, &FilmSettings::default(), &options).unwrap();
    let same = |k: usize| {
        part.frames[k].alpha.iter().zip(&clip.frames[0][k + 2].alpha).filter(|(a, b)| (*a - *b).abs() > 0.5).count()
    };
    assert!(part.frames.len() == 4 && (0..4).all(|k| same(k) < 60));
}
