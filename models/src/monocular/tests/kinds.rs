//! Pictures, masks and objects of the kinds that phones and tools leave.

use std::fs;

use crate::monocular::clip_of_film;
use crate::video::{Clip, FilmSettings, Foreground, OpenOptions};
use gradreel::ErrorKind;
use ndarray::Array2;

use super::ball::{
    FRAMES, Folder, GRAVITY, RADIUS, VELOCITY, camera, coverage, floor, middle, pictures, write_folder, write_gif,
    write_png,
};

const SIDE: usize = 160;

fn settings(frames_per_s: f64) -> FilmSettings {
    FilmSettings { frames_per_s, field_of_view: 40.0, elevation: Some(12.0), ..FilmSettings::default() }
}

fn open(folder: &Folder, name: &str, settings: &FilmSettings) -> Clip {
    clip_of_film(&folder.path(name), settings, &OpenOptions::default(), GRAVITY).unwrap()
}

/// Pictures that a phone stored lying on its side, with Exif's orientation 6: to be turned clockwise.
#[test]
fn pictures_are_turned_as_they_were_held() {
    let folder = Folder::new();
    let all = pictures(|_, _| [255, 255, 255, 255]);
    // of the upper half only, so that width and height differ
    let height = SIDE / 2 + 40;
    let orientation = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0".to_vec();
    for (k, picture) in all.iter().enumerate() {
        let shown = |x: usize, y: usize| &picture[4 * (y * SIDE + x)..][..4];
        let upright: Vec<u8> = (0..height * SIDE).flat_map(|i| shown(i % SIDE, i / SIDE).to_vec()).collect();
        // stored column x and row y are shown at column height − 1 − y … turned clockwise: shown (X, Y) = stored (Y, h − 1 − X)
        let stored: Vec<u8> =
            (0..SIDE * height).flat_map(|i| shown(SIDE - 1 - i / height, i % height).to_vec()).collect();
        let size = [SIDE, height];
        write_png(&folder.path(&format!("upright/{k}.png")), size, png::ColorType::Rgba, None, &upright);
        let exif = Some(orientation.clone());
        write_png(&folder.path(&format!("lying/{k}.png")), [height, SIDE], png::ColorType::Rgba, exif, &stored);
    }
    let [upright, lying] = ["upright", "lying"].map(|name| open(&folder, name, &settings(24.0)));
    assert_eq!(lying.frames, upright.frames);
    assert_eq!((lying.cameras[0].width, lying.cameras[0].height), (SIDE, height));
}

#[test]
fn masks_of_all_kinds() {
    let folder = Folder::new();
    write_folder(&folder.path("film"), &pictures(floor));
    let inside = |k: usize| -> Array2<bool> { coverage(&camera(), middle(k)).mapv(|a| a > 0.5) };
    let write = |name: &str, colour, of: &dyn Fn(bool) -> Vec<u8>| {
        for k in 0..FRAMES {
            let bytes: Vec<u8> = inside(k).iter().flat_map(|inside| of(*inside)).collect();
            write_png(&folder.path(&format!("{name}/{k}.png")), [SIDE; 2], colour, None, &bytes);
        }
    };
    let masks = |name: &str| FilmSettings { masks: Some(folder.path(name)), ..settings(24.0) };
    write("white", png::ColorType::Grayscale, &|inside| vec![if inside { 255 } else { 0 }]);
    write("ones", png::ColorType::Grayscale, &|inside| vec![u8::from(inside)]);
    write("cut-out", png::ColorType::Rgba, &|inside| if inside { vec![9, 40, 7, 255] } else { vec![0; 4] });
    let wanted = open(&folder, "film", &masks("white"));
    assert_eq!(wanted.foreground, [Foreground::Mask]);
    for name in ["ones", "cut-out"] {
        assert_eq!(open(&folder, "film", &masks(name)).frames, wanted.frames, "{name}");
    }
    write("dark", png::ColorType::Rgb, &|inside| if inside { vec![3, 2, 3] } else { vec![1, 0, 0] });
    let error = clip_of_film(&folder.path("film"), &masks("dark"), &OpenOptions::default(), GRAVITY).unwrap_err();
    assert!(
        error.kind() == ErrorKind::Input && error.to_string().contains("the brightest value is 3 of 255"),
        "{error}"
    );
    // a file in place of a folder, and a mask that is missing
    let file = clip_of_film(&folder.path("film"), &masks("white/0.png"), &OpenOptions::default(), GRAVITY).unwrap_err();
    assert!(file.kind() == ErrorKind::Input && file.to_string().contains("a file"), "{file}");
    fs::remove_file(folder.path("white/1.png")).unwrap();
    let part = OpenOptions { max_frames: Some(5), ..OpenOptions::default() };
    let gap = clip_of_film(&folder.path("film"), &masks("white"), &part, GRAVITY).unwrap_err();
    assert!(gap.kind() == ErrorKind::Input && gap.to_string().contains("picture 1 is missing"), "{gap}");
}

/// A smaller ball goes up while the other one falls: never a velocity between theirs.
#[test]
fn the_larger_of_two_objects_is_taken() {
    let folder = Folder::new();
    let film = folder.path("two.gif");
    let both = |behind: fn(usize, usize) -> [u8; 4]| {
        let mut all = pictures(behind);
        for (k, picture) in all.iter_mut().enumerate() {
            let (left, top) = (20.0, 140.0 - 9.0 * k as f64);
            for i in 0..SIDE * SIDE {
                let (x, y) = ((i % SIDE) as f64 + 0.5 - left, (i / SIDE) as f64 + 0.5 - top);
                if x.hypot(y) < 9.0 {
                    picture[4 * i..][..4].copy_from_slice(&[30, 40, 200, 255]);
                }
            }
        }
        all
    };
    let backgrounds: [fn(usize, usize) -> [u8; 4]; 3] = [|_, _| [0; 4], |_, _| [255; 4], floor];
    for behind in backgrounds {
        write_gif(&film, &both(behind));
        let clip = open(&folder, "two.gif", &settings(24.0));
        let flight = clip.flight.unwrap();
        let off = [0, 1].map(|axis| (flight.velocity[axis] - VELOCITY[axis]).abs());
        assert!(off[0] < 0.07 && off[1] < 0.1, "{:?}", flight.velocity);
        assert!((flight.diameter / (2.0 * RADIUS) - 1.0).abs() < 0.1, "{} m", flight.diameter);
        assert!(
            clip.assumptions.iter().any(|line| line.contains("several objects are seen")),
            "{:?}",
            clip.assumptions
        );
    }
}

#[test]
fn a_size_that_is_hardly_so_is_warned_of() {
    let folder = Folder::new();
    write_gif(&folder.path("film.gif"), &pictures(|_, _| [255; 4]));
    let warned = |rate: f64| {
        let clip = open(&folder, "film.gif", &settings(rate));
        clip.said().find(|line| line.starts_with("warning: "))
    };
    assert_eq!(warned(24.0), None);
    // lengths go with the square of the interval: 0.2 m become 0.2 (24/3)² = 12.8 m, and 0.2 (24/240)² = 2 mm
    let far = warned(3.0).unwrap();
    assert!(["24", "25", "30"].iter().any(|rate| far.contains(&format!("--fps {rate} "))), "{far}");
    let near = warned(240.0).unwrap();
    assert!(
        near.contains("0.2 cm") && ["24", "25", "30"].iter().any(|rate| near.contains(&format!("--fps {rate} "))),
        "{near}"
    );
}

#[test]
fn pictures_beyond_all_bounds_are_refused_by_their_headers() {
    let folder = Folder::new();
    write_folder(&folder.path("film"), &pictures(floor));
    let mut huge = fs::read(folder.path("film/frame3.png")).unwrap();
    // width and height of the header, and its check sum
    huge[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    let crc = huge[12..29].iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 })
    });
    huge[29..33].copy_from_slice(&(!crc).to_be_bytes());
    fs::write(folder.path("film/frame3.png"), huge).unwrap();
    let film = clip_of_film(&folder.path("film"), &settings(24.0), &OpenOptions::default(), GRAVITY).unwrap_err();
    assert!(film.kind() == ErrorKind::Input && film.to_string().contains("16384 × 16384"), "{film}");
    assert!(film.to_string().contains("too large") && film.to_string().contains("frame3.png"), "{film}");
}
