//! Pictures and films.

use std::fs;

use gradreel_models::report::animation::{Picture, gif};
use gradreel_models::video::{Film, FilmSettings, OpenOptions};
use gradreel_models::views::open_picture;

use crate::harness::fuzz;

const WORDS: [&[u8]; 8] = [
    b"IHDR",
    b"IDAT",
    b"tRNS",
    b"acTL",
    b"\xff\xda",
    b"\xff\xc0\x00\x11\x08",
    b"\x21\xf9\x04",
    b"\x2c\x00\x00\x00\x00",
];

/// A PNG file of every kind that pictures have.
fn png(colour: png::ColorType, depth: png::BitDepth) -> Vec<u8> {
    const SIDE: usize = 12;
    let bits = depth as usize * colour.samples();
    let row = (bits * SIDE).div_ceil(8);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, SIDE as u32, SIDE as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == png::ColorType::Indexed {
        encoder.set_palette((0..48u8).map(|i| 5 * i).collect::<Vec<_>>());
    }
    // white around a dark square
    let inside = |i: usize| (3..9).contains(&(i / row)) && (row / 4..3 * row / 4).contains(&(i % row));
    let pixel = |i: usize| if inside(i) { 0x11 } else { 0xff };
    encoder.write_header().unwrap().write_image_data(&(0..row * SIDE).map(pixel).collect::<Vec<u8>>()).unwrap();
    bytes
}

#[test]
fn png_and_jpeg() {
    use png::{BitDepth, ColorType};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture");
    let mut seeds = vec![
        png(ColorType::Rgb, BitDepth::Eight),
        png(ColorType::Grayscale, BitDepth::Eight),
        png(ColorType::Grayscale, BitDepth::Sixteen),
        png(ColorType::Rgba, BitDepth::Sixteen),
        png(ColorType::GrayscaleAlpha, BitDepth::Eight),
        png(ColorType::Indexed, BitDepth::Four),
    ];
    let read = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        open_picture(&path, 16, None).is_ok()
    };
    seeds.retain(|seed| read(seed));
    assert!(seeds.len() >= 4);
    seeds.push(fs::read("models/tests/cli/ball.jpg").unwrap());
    fuzz("png-jpeg", &seeds, &WORDS, read);
}

/// A red square that falls before a light ground.
fn frame(number: usize) -> Picture {
    const SIDE: usize = 24;
    let inside = |i: usize| (9..15).contains(&(i % SIDE)) && (4 + 3 * number..10 + 3 * number).contains(&(i / SIDE));
    let pixel = |i: usize| if inside(i) { [200, 30, 20] } else { [220, 215 + (i * 7 % 9) as u8, 225] };
    Picture { width: SIDE, height: SIDE, rgb: (0..SIDE * SIDE).flat_map(pixel).collect() }
}

#[test]
fn gif_films() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.gif");
    let frames: Vec<Picture> = (0..4).map(frame).collect();
    let seeds = [gif(&frames, 20.0).unwrap(), gif(&frames[..2], 10.0).unwrap()];
    fuzz("gif", &seeds, &WORDS, |bytes| {
        fs::write(&path, bytes).unwrap();
        Film::read(&path, &FilmSettings::default(), &OpenOptions::default()).is_ok()
    });
}

/// One damaged picture among the frames of a folder.
#[test]
fn films_of_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let seeds: Vec<Vec<u8>> =
        (0..4).map(|number| gradreel_models::report::png_file::png(&frame(number)).unwrap()).collect();
    for (number, seed) in seeds.iter().enumerate() {
        fs::write(folder.path().join(format!("{number}.png")), seed).unwrap();
    }
    let settings = FilmSettings { frames_per_s: 24.0, ..FilmSettings::default() };
    fuzz("film-folder", &seeds[2..3], &WORDS, |bytes| {
        fs::write(folder.path().join("2.png"), bytes).unwrap();
        Film::read(folder.path(), &settings, &OpenOptions::default()).is_ok()
    });
}
