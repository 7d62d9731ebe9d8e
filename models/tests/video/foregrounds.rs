//! Every source of the foreground, and the order of preference among them.

use gradreel_models::video::{Clip, Foreground, OpenOptions, PixelRect, inspect};

use super::builder::{Builder, in_square, red_square};

const SQUARE: Option<PixelRect> = Some(PixelRect { left: 8, top: 5, right: 14, bottom: 11 });

fn opaque(x: usize, y: usize) -> [u8; 4] {
    if in_square(x, y) { [200, 30, 20, 255] } else { [90, 110, 60, 255] }
}

/// Two frames of one camera with opaque images.
fn filmed() -> Builder {
    let mut builder = Builder::new(24, 16);
    for frame in 0..2 {
        builder.list(5, frame);
        builder.image('r', 5, frame, false, &opaque);
    }
    builder
}

#[test]
fn every_source_finds_the_square() {
    // Each source is added to a clip that already has the less preferred ones.
    let builder = filmed();
    let check = |foreground: Foreground| {
        let clip = builder.open().unwrap();
        assert_eq!(clip.foreground, [foreground]);
        assert_eq!(inspect(&builder.root).unwrap().cameras[0].foreground, Some(foreground));
        for frame in 0..2 {
            assert_eq!(clip.pixel_rect(0, frame, 0), SQUARE, "{foreground}");
            let Frame { rgb, alpha } = pixel(&clip, frame, 10, 8);
            assert!(alpha == 1.0 && (rgb[0] - 200.0 / 255.0).abs() < 1e-6, "{foreground}: {rgb:?} {alpha}");
            let Frame { rgb, alpha } = pixel(&clip, frame, 2, 2);
            assert!(alpha == 0.0 && rgb == [1.0; 3], "{foreground}: {rgb:?} {alpha}");
        }
    };
    builder.image('r', 5, -1, false, &|_, _| [90, 110, 60, 255]);
    check(Foreground::Plate);
    for frame in 0..2 {
        builder.image('r', 5, frame, true, &red_square);
    }
    check(Foreground::ImageAlpha);
    let on_white = |x: usize, y: usize| if in_square(x, y) { [200, 30, 20, 255] } else { [255; 4] };
    for frame in 0..2 {
        builder.image('r', 5, frame, false, &opaque);
        builder.image('m', 5, frame, false, &on_white);
    }
    check(Foreground::MaskOnWhite);
    for frame in 0..2 {
        builder.image('a', 5, frame, true, &red_square);
    }
    check(Foreground::MaskAlpha);
}

struct Frame {
    rgb: [f32; 3],
    alpha: f32,
}

fn pixel(clip: &Clip, frame: usize, x: usize, y: usize) -> Frame {
    let frame = &clip.frames[0][frame];
    Frame { rgb: [0, 1, 2].map(|c| frame.rgb[[y, x, c]]), alpha: frame.alpha[[y, x]] }
}

/// An alpha channel that is opaque everywhere says nothing.
#[test]
fn an_opaque_alpha_channel_is_no_source() {
    let builder = filmed();
    for frame in 0..2 {
        builder.image('r', 5, frame, true, &opaque);
    }
    assert!(builder.open().is_err());
    builder.image('r', 5, -1, true, &|_, _| [90, 110, 60, 255]);
    assert_eq!(builder.open().unwrap().foreground, [Foreground::Plate]);
}

#[test]
fn excluded_pixels_have_no_weight() {
    let builder = Builder::square(&[1], 2);
    assert!(builder.open().unwrap().frames[0][0].weight.iter().all(|&w| w == 1.0));
    builder.image('r', 1, -2, true, &|x, _| [0, 0, 0, if x < 3 { 51 } else { 50 }]);
    let clip = builder.open().unwrap();
    for ((_, x), &weight) in clip.frames[0][1].weight.indexed_iter() {
        assert_eq!(weight, if x < 3 { 0.0 } else { 1.0 });
    }
    builder.image('r', 1, -2, false, &|_, _| [0; 4]);
    assert!(builder.fails().contains("no alpha channel"));
}

/// Half transparent pixels are composited on white; a box average keeps that composite.
#[test]
fn compositing_and_scaling() {
    let builder = Builder::square(&[0], 1);
    builder.image('r', 0, 0, true, &|x, y| [255, 0, 51, if in_square(x, y) { 255 } else { 51 * (x as u8 % 2) }]);
    let clip = builder.open().unwrap();
    let frame = &clip.frames[0][0];
    assert!((frame.alpha[[0, 1]] - 0.2).abs() < 1e-6);
    for (c, wanted) in [1.0, 0.8, 0.84].into_iter().enumerate() {
        assert!((frame.rgb[[0, 1, c]] - wanted).abs() < 1e-6);
    }
    let half = clip.scaled(2);
    assert_eq!(half.frames[0][0].alpha.dim(), (8, 12));
    assert_eq!((half.cameras[0].width, half.cameras[0].height), (12, 8));
    assert!((half.frames[0][0].alpha[[0, 0]] - 0.1).abs() < 1e-6);
    assert!((half.frames[0][0].rgb[[0, 0, 1]] - 0.9).abs() < 1e-6);
    assert_eq!(clip.scaled(5).frames[0][0].rgb.dim(), (3, 4, 3));
    assert_eq!(clip.pixel_rect(0, 0, 6), Some(PixelRect { left: 2, top: 0, right: 20, bottom: 16 }));
}

#[test]
fn the_bundled_clip_opens() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/clips/bird");
    let clip = Clip::open(path.as_ref(), &OpenOptions::default()).unwrap();
    assert_eq!((clip.name.as_str(), clip.cameras.len(), clip.frame_count()), ("bird", 7, 14));
    assert!((clip.frame_dt() - 1.0 / 24.0).abs() < 1e-9);
    assert!(clip.foreground.iter().all(|&f| f == Foreground::Plate));
    // The bird spans 0.44 × 0.20 × 0.35 m at about 1.4 m; its box in frame 0 projects into the matte's rectangle.
    for (c, camera) in clip.cameras.iter().enumerate() {
        let rect = clip.pixel_rect(c, 0, 0).unwrap();
        let mut span = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for corner in 0..8 {
            let pick = |bit: usize, low: f64, high: f64| if corner >> bit & 1 == 0 { low } else { high };
            let p = [pick(0, -0.192, 0.252), pick(1, 0.3, 0.502), pick(2, -0.174, 0.175)];
            let [u, v, _] = camera.project(p).unwrap();
            span = [span[0].min(u), span[1].min(v), span[2].max(u), span[3].max(v)];
        }
        let [left, top, right, bottom] = span;
        assert!(rect.left as f64 > left - 2.0 && (rect.right as f64) < right + 2.0, "camera {}: {rect:?}", camera.id);
        assert!(rect.top as f64 > top - 2.0 && (rect.bottom as f64) < bottom + 2.0, "camera {}: {rect:?}", camera.id);
        assert!(rect.width() > 35 && rect.height() > 20, "camera {}: {rect:?}", camera.id);
    }
    let inventory = inspect(path.as_ref()).unwrap();
    assert!(inventory.is_complete());
    let text = inventory.to_string();
    for part in ["7 cameras", "24.0 per second", "camera 6: 192 × 192, frames 0–13", "ready to open"] {
        assert!(text.contains(part), "{text}");
    }
}
