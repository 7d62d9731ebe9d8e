//! What was written is read back by readers that share nothing with the writers.

use std::collections::BTreeMap;

use crate::report::animation::{Picture, gif};
use crate::report::ply::ply;
use crate::report::png_file::png;
use crate::report::quantity::{Quantity, parameters_json};
use gradreel::ErrorKind;
use serde_json::Value;

/// Reads a binary PLY by its own header: the names of the properties and the values of each vertex.
fn read_ply(bytes: &[u8]) -> (Vec<String>, Vec<Vec<f64>>) {
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut lines = header.lines();
    assert_eq!((lines.next(), lines.next()), (Some("ply"), Some("format binary_little_endian 1.0")));
    let (mut count, mut properties) = (None, Vec::new());
    for line in lines {
        match line.split(' ').collect::<Vec<_>>()[..] {
            ["element", "vertex", number] => count = Some(number.parse::<usize>().unwrap()),
            ["property", kind, name] => properties.push((kind.to_string(), name.to_string())),
            ["comment", ..] | ["end_header"] => {}
            _ => panic!("unknown header line {line}"),
        }
    }
    let mut rest = &bytes[end..];
    let mut take = |kind: &str| {
        let (head, tail) = rest.split_at(if kind == "float" { 4 } else { 1 });
        rest = tail;
        if kind == "float" { f64::from(f32::from_le_bytes(head.try_into().unwrap())) } else { f64::from(head[0]) }
    };
    let vertices =
        (0..count.unwrap()).map(|_| properties.iter().map(|(kind, _)| take(kind)).collect()).collect::<Vec<_>>();
    assert!(rest.is_empty(), "{} bytes after the last vertex", rest.len());
    (properties.into_iter().map(|(_, name)| name).collect(), vertices)
}

#[test]
fn particles_come_back_from_ply() {
    let positions = [[0.125, -2.5, 3.0], [1e-20, 0.0, 6.0e8]];
    let wanted: Vec<Vec<f64>> = positions.iter().map(|p| p.iter().map(|&x| f64::from(x)).collect()).collect();
    let (names, vertices) = read_ply(&ply(&positions, None).unwrap());
    assert_eq!((names.join(" "), vertices), ("x y z".into(), wanted.clone()));

    let (names, vertices) = read_ply(&ply(&positions, Some(&[[1, 2, 3], [253, 254, 255]])).unwrap());
    assert_eq!(names.join(" "), "x y z red green blue");
    assert_eq!(vertices[0], [&wanted[0][..], &[1.0, 2.0, 3.0]].concat());
    assert_eq!(vertices[1], [&wanted[1][..], &[253.0, 254.0, 255.0]].concat());

    let header = String::from_utf8_lossy(&ply(&[], None).unwrap()).into_owned();
    assert!(header.contains("comment unit metre\n") && header.contains("y up\n"), "{header}");
    assert_eq!(read_ply(header.as_bytes()).1.len(), 0);
}

#[test]
fn a_particle_without_a_place_is_refused() {
    for bad in [f32::NAN, f32::INFINITY] {
        let error = ply(&[[0.0; 3], [0.0, bad, 0.0]], None).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NonFinite);
        assert!(error.to_string().contains("particle 1"), "{error}");
    }
}

#[test]
#[should_panic(expected = "1 colours for 2 points")]
fn colours_must_fit_the_particles() {
    let _ = ply(&[[0.0; 3]; 2], Some(&[[0; 3]]));
}

/// Frames as the `gif` crate shows them: RGB bytes and delays.
fn read_gif(bytes: &[u8]) -> (u16, u16, gif::Repeat, Vec<(Vec<u8>, u16)>) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(bytes).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        assert_eq!((frame.left, frame.top), (0, 0));
        let rgb = frame.buffer.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        frames.push((rgb, frame.delay));
    }
    (decoder.width(), decoder.height(), decoder.repeat(), frames)
}

fn flat(width: usize, height: usize, colour: [u8; 3]) -> Picture {
    Picture { width, height, rgb: colour.repeat(width * height) }
}

#[test]
fn few_colours_come_back_from_gif_exactly() {
    let frames = [flat(5, 3, [255, 255, 255]), flat(5, 3, [1, 2, 3]), flat(5, 3, [200, 0, 7])];
    let (width, height, repeat, shown) = read_gif(&gif(&frames, 25.0).unwrap());
    assert_eq!((width, height, repeat), (5, 3, gif::Repeat::Infinite));
    assert_eq!(shown, frames.map(|frame| (frame.rgb, 4)));
    assert_eq!(read_gif(&gif(&[flat(1, 1, [9, 9, 9])], 1.0).unwrap()).3, [(vec![9, 9, 9], 100)]);
}

#[test]
fn delays_add_up_to_the_length_of_the_clip() {
    let frames = vec![flat(1, 1, [0; 3]); 240];
    let delays: Vec<u16> = read_gif(&gif(&frames, 24.0).unwrap()).3.iter().map(|frame| frame.1).collect();
    assert_eq!(delays.iter().map(|&d| u32::from(d)).sum::<u32>(), 1000, "240 frames at 24 per second are 10 s");
    assert!(delays.iter().all(|d| (4..=5).contains(d)));
    assert!(read_gif(&gif(&frames, 1000.0).unwrap()).3.iter().all(|frame| frame.1 == 2));
}

#[test]
fn many_colours_lose_little() {
    // 64 × 64 × 4 different colours: a blue-to-red plane at four brightnesses, and a wide white border.
    let side = 64;
    let frame = |level: usize| {
        let mut picture = flat(side + 40, side, [255; 3]);
        for (row, column) in (0..side).flat_map(|row| (0..side).map(move |column| (row, column))) {
            let at = (row * picture.width + column) * 3;
            picture.rgb[at..at + 3].copy_from_slice(&[(row * 4) as u8, (level * 60) as u8, (column * 4) as u8]);
        }
        picture
    };
    let frames: Vec<Picture> = (0..4).map(frame).collect();
    let shown = read_gif(&gif(&frames, 10.0).unwrap()).3;
    let (mut sum, mut worst, mut count) = (0.0, 0.0f64, 0.0);
    for (frame, (rgb, _)) in frames.iter().zip(&shown) {
        for (a, b) in frame.rgb.iter().zip(rgb) {
            let error = f64::from(a.abs_diff(*b));
            sum += error * error;
            worst = worst.max(error);
            count += 1.0;
        }
        assert_eq!(rgb[(frame.width - 1) * 3..][..3], [255; 3], "white stays white");
    }
    // 64 colours for each 256 × 256 plane: ideal cells of side 32 with an error of 32/√12 in two of three channels
    // over 64/104 of the picture make 5.9 in all.
    let rms = f64::sqrt(sum / count);
    assert!(rms < 6.5, "rms error {rms}");
    assert!(worst < 32.0, "worst error {worst}");
}

#[test]
fn animations_that_cannot_be_are_refused() {
    let square = flat(2, 2, [0; 3]);
    let error = gif(&[square.clone(), flat(2, 3, [0; 3])], 10.0).unwrap_err();
    assert!(error.to_string().contains("frame 1") && error.to_string().contains("2 × 3"), "{error}");
    for (frames, speed) in [
        (vec![], 10.0),
        (vec![flat(0, 2, [0; 3])], 10.0),
        (vec![flat(70_000, 1, [0; 3])], 10.0),
        (vec![square.clone()], 0.0),
        (vec![square.clone()], -1.0),
        (vec![square.clone()], f64::NAN),
        (vec![square.clone()], f64::INFINITY),
        (vec![square], 1e-9),
    ] {
        assert_eq!(gif(&frames, speed).unwrap_err().kind(), ErrorKind::Input, "{speed}");
    }
}

#[test]
fn pictures_are_laid_out_side_by_side_and_in_grids() {
    let [red, blue] = [flat(1, 1, [255, 0, 0]), flat(1, 2, [0, 0, 255])];
    let both = red.beside(&blue);
    assert_eq!((both.width, both.height), (2, 2));
    assert_eq!(both.rgb, [255, 0, 0, 0, 0, 255, 255, 255, 255, 0, 0, 255]);

    let grid = Picture::grid(2, &[red.clone(), blue.clone(), red.clone()]);
    assert_eq!((grid.width, grid.height), (2, 4));
    assert_eq!(grid.rgb[..12], both.rgb);
    assert_eq!(grid.rgb[12..], [&[255, 0, 0][..], &[255; 9]].concat());
    assert_eq!(Picture::grid(7, std::slice::from_ref(&red)), red, "no empty columns");
}

#[test]
fn values_from_0_to_1_become_bytes() {
    let picture = Picture::from_unit(2, 1, &[0.0, 0.5, 1.0, -3.0, 7.0, 0.2]).unwrap();
    assert_eq!(picture.rgb, [0, 128, 255, 0, 255, 51]);
    let mut values = [0.5; 2 * 3 * 3];
    values[3 * 3 + 1] = f32::NAN;
    let error = Picture::from_unit(2, 3, &values).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NonFinite);
    assert!(error.to_string().contains("row 1, column 1, channel 1"), "{error}");
}

#[test]
fn a_picture_comes_back_from_png() {
    let picture = Picture { width: 3, height: 2, rgb: (0..18).map(|value| value * 14).collect() };
    let bytes = png(&picture).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgb).unwrap();
    assert_eq!((info.width, info.height, info.color_type), (3, 2, png::ColorType::Rgb));
    assert_eq!(rgb, picture.rgb);
    assert_eq!(png(&flat(0, 0, [0; 3])).unwrap_err().kind(), ErrorKind::Input);
}

fn quantity(name: &str, unit: &str, value: f64) -> Quantity {
    let source = "fitted".to_string();
    let [label, symbol] = ["Label", "x"].map(String::from);
    Quantity {
        name: name.into(),
        label,
        symbol,
        unit: unit.into(),
        value,
        start: None,
        source,
        interval_90: None,
        determined: None,
    }
}

#[test]
fn numbers_are_readable() {
    for (value, unit, wanted) in [
        (301_234.0, "Pa", "301 kPa"),
        (3e5, "Pa", "300 kPa"),
        (999.4, "Pa", "999 Pa"),
        (999.6, "Pa", "1.00 kPa"),
        (999_600.0, "Pa", "1.00 MPa"),
        (2.1e11, "Pa", "210 GPa"),
        (1e15, "Pa", "1.00e6 GPa"),
        (-0.0125, "m", "-12.5 mm"),
        (4.16e-4, "s", "416 µs"),
        (12.0, "Pa s", "12.0 Pa s"),
        (0.0, "Pa", "0 Pa"),
        (0.29812, "-", "0.298"),
        (0.29812, "", "0.298"),
        (-0.40211, "m/s", "-0.402 m/s"),
        (1023.4, "kg/m³", "1020 kg/m³"),
        (0.00123, "", "0.00123"),
        (1.5e-7, "", "1.50e-7"),
        (1.5e7, "kg", "1.50e7 kg"),
        (f64::NAN, "Pa", "NaN Pa"),
        (f64::NEG_INFINITY, "m", "-inf m"),
    ] {
        assert_eq!(quantity("q", unit, value).readable(), wanted, "{value:e} {unit:?}");
    }
}

#[test]
fn parameters_come_back_from_json() {
    let young = Quantity { start: Some(1e6), ..quantity("young", "Pa", 301_234.567_890_123) };
    let poisson = quantity("poisson", "-", 0.1 + 0.2);
    let density = Quantity { source: "assumed".into(), ..quantity("density", "kg/m³", 1000.0) };
    let quality = BTreeMap::from([("psnr".to_string(), 31.25), ("chamfer".to_string(), 0.002)]);
    let bytes = parameters_json("neo_hookean", &[young, poisson], &[density], &quality).unwrap();

    let read: Value = serde_json::from_slice(&bytes).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&read), ["material", "parameters", "assumed", "quality", "isa"]);
    assert_eq!(read["material"], "neo_hookean");
    assert_eq!(keys(&read["parameters"]), ["young", "poisson"], "in the order given");
    let young = &read["parameters"]["young"];
    assert_eq!(
        keys(young),
        ["label", "symbol", "value", "unit", "readable", "start", "source", "interval_90", "determined"]
    );
    assert_eq!(young["value"].as_f64(), Some(301_234.567_890_123));
    assert_eq!((&young["unit"], &young["readable"]), (&"Pa".into(), &"301 kPa".into()));
    assert_eq!(young["start"].as_f64(), Some(1e6));
    assert_eq!(read["parameters"]["poisson"]["value"].as_f64(), Some(0.1 + 0.2), "to the last bit");
    assert!(read["parameters"]["poisson"]["start"].is_null());
    assert_eq!(read["assumed"]["density"]["source"], "assumed");
    assert_eq!(read["quality"]["chamfer"].as_f64(), Some(0.002));
}

#[test]
fn what_a_clip_does_not_determine_is_not_read_as_a_number() {
    let interval_90 = Some([2e4, 3e6]);
    let young = Quantity { determined: Some(false), interval_90, ..quantity("young", "Pa", 1e5) };
    assert_eq!((young.shown(), young.readable_interval().unwrap()), ("–".into(), "20.0 kPa to 3.00 MPa".into()));
    let bytes = parameters_json("neo_hookean", std::slice::from_ref(&young), &[], &BTreeMap::new()).unwrap();
    let read: Value = serde_json::from_slice(&bytes).unwrap();
    let entry = &read["parameters"]["young"];
    assert_eq!((entry["value"].as_f64(), entry["readable"].as_str()), (Some(1e5), Some("–")));
    assert_eq!((&entry["determined"], &entry["interval_90"][1]), (&false.into(), &3e6.into()));
    let known = Quantity { determined: Some(true), ..young };
    assert_eq!(known.shown(), "100 kPa");
}

#[test]
fn numbers_that_are_none_are_refused_by_name() {
    let none = BTreeMap::new();
    let good = quantity("young", "Pa", 1.0);
    let bad = quantity("yield_stress", "Pa", f64::NAN);
    let bad_start = Quantity { start: Some(f64::INFINITY), ..good.clone() };
    let bad_quality = BTreeMap::from([("psnr".to_string(), f64::NEG_INFINITY)]);
    for (result, name) in [
        (parameters_json("m", &[good.clone(), bad.clone()], &[], &none), "parameters.yield_stress"),
        (parameters_json("m", &[], &[bad], &none), "assumed.yield_stress"),
        (parameters_json("m", &[bad_start], &[], &none), "parameters.young.start"),
        (parameters_json("m", std::slice::from_ref(&good), &[], &bad_quality), "quality.psnr"),
    ] {
        let error = result.unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NonFinite);
        assert!(error.to_string().contains(name), "{error}");
    }
    let twice = parameters_json("m", &[good.clone(), good.clone()], &[], &none).unwrap_err();
    assert!(twice.to_string().contains("parameters.young"), "{twice}");
    let guessed = Quantity { source: "guessed".into(), ..good };
    assert!(parameters_json("m", &[guessed], &[], &none).unwrap_err().to_string().contains("guessed"));
}
