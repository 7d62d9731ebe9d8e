//! The page as a whole.

use crate::report::base64::encode;
use crate::report::page::{Headline, Page, Scene};
use crate::report::plot::{Plot, Series};
use serde_json::Value;

use super::markup::{decode_base64, decode_entities};

const HOSTILE: &str = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(2)>&amp;";

fn scene() -> Scene {
    Scene {
        frames: vec![
            vec![[0.0, 0.0, 0.0], [1.0, 2.0, 4.0], [0.25, 0.0, 0.0]],
            vec![[0.5, 0.5, 1.0], [f32::NAN, 0.0, 0.0], [0.25, 0.5, 0.5]],
        ],
        colours: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255]],
        frame_dt: 0.04,
        ground: 0.0,
        cameras: vec![[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 3.0]]],
    }
}

/// A page whose every text is `text`.
fn page<'a>(text: &'a str, gif: &'a [u8]) -> Page<'a> {
    let pair = || (text.to_string(), text.to_string());
    let [symbol, label, readable, exact, note] = std::array::from_fn(|_| text.to_string());
    let series = vec![Series { label: text.into(), points: vec![(0.0, 1.0), (1.0, 2.0)] }; 2];
    let [title, x_label, y_label] = std::array::from_fn(|_| text.to_string());
    Page {
        title: text,
        subtitle: text.into(),
        headlines: vec![Headline { symbol, label, readable, exact, note }],
        animation: Some(gif),
        animation_caption: text.into(),
        drawings: vec![],
        scene: Some(scene()),
        plots: vec![Plot { title, x_label, y_label, log_y: false, series, reference: Some((text.into(), 1.5)) }],
        notes: vec![pair()],
        timings: vec![(text.into(), 1.0), (text.into(), f64::NAN)],
        config_toml: text.into(),
        files: vec![pair()],
    }
}

fn between<'a>(text: &'a str, start: &str, end: &str) -> &'a str {
    let (_, after) = text.split_once(start).unwrap_or_else(|| panic!("{start} is missing"));
    after.split_once(end).unwrap_or_else(|| panic!("{end} is missing")).0
}

fn scene_data(html: &str) -> Value {
    let json = between(html, "<script type=\"application/json\" id=\"scene\">", "</script>");
    serde_json::from_str(json).expect("the scene is JSON")
}

/// RFC 4648, section 10.
#[test]
fn base64_matches_the_vectors_of_its_standard() {
    let vectors = ["", "", "f", "Zg==", "fo", "Zm8=", "foo", "Zm9v", "foob", "Zm9vYg==", "fooba", "Zm9vYmE="];
    for pair in vectors.chunks(2).chain([["foobar", "Zm9vYmFy"].as_slice()]) {
        assert_eq!(encode(pair[0].as_bytes()), pair[1]);
        assert_eq!(decode_base64(pair[1]), pair[0].as_bytes());
    }
    for length in [255, 256, 257] {
        let bytes: Vec<u8> = (0..length).map(|i| (i * 37 % 256) as u8).collect();
        assert_eq!(decode_base64(&encode(&bytes)), bytes);
    }
}

#[test]
fn foreign_text_neither_runs_nor_breaks_out() {
    let (harmless, hostile) = (page("x", b"GIF89a").html(), page(HOSTILE, b"GIF89a").html());
    for opening in ["<script", "</script", "<img", "<svg", "</svg", "<a ", "<"] {
        let (wanted, found) = (harmless.matches(opening).count(), hostile.matches(opening).count());
        assert_eq!(found, wanted, "the text opened or closed {opening}");
    }
    assert_eq!(hostile.matches('"').count(), harmless.matches('"').count(), "the text closed an attribute");
    assert_eq!(decode_entities(between(&hostile, "<h1>", "</h1>")), HOSTILE);
    assert!(decode_entities(between(&hostile, "<code>", "</code>")) == HOSTILE);
}

#[test]
fn links_lead_only_to_files_beside_the_page() {
    let mut page = page("x", b"");
    page.files =
        ["javascript:alert(1)", "ply/frame 01#a?.ply", "50 %\"ü"].map(|f| (f.into(), "a file".into())).to_vec();
    let html = page.html();
    let links: Vec<&str> = html.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap_or("")).collect();
    assert_eq!(links, ["./javascript%3Aalert%281%29", "./ply/frame%2001%23a%3F.ply", "./50%20%25%22%C3%BC"]);
}

#[test]
fn the_page_needs_no_network() {
    let html = page("x", b"GIF89a").html().replace("http://www.w3.org/2000/svg", "");
    for word in ["http://", "https://", "src=\"//", "fetch(", "XMLHttpRequest", "import(", "@import", "url(", "<link"] {
        assert!(!html.contains(word), "the page contains {word}");
    }
    assert!(html.contains("default-src 'none'"));
}

#[test]
fn the_animation_is_embedded_byte_for_byte_with_its_size() {
    let gif: Vec<u8> = b"GIF89a".iter().copied().chain([0x40, 0x01, 0xc8, 0x00]).chain(0..=255).collect();
    let html = page("x", &gif).html();
    assert_eq!(decode_base64(between(&html, "data:image/gif;base64,", "\"")), gif);
    // 320 × 200, enlarged twice.
    assert!(html.contains("width=\"640\" height=\"400\""));
}

#[test]
fn positions_come_back_to_half_a_step() {
    let data = scene_data(&page("x", b"").html());
    let vector = |name: &str| -> Vec<f64> {
        data[name].as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
    };
    let (low, extent) = (vector("low"), vector("extent"));
    let bytes = decode_base64(data["positions"].as_str().expect("base64"));
    let steps: Vec<u16> = bytes.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let particles = scene().frames.concat();
    assert_eq!((low.as_slice(), extent.as_slice()), ([0.0; 3].as_slice(), [1.0, 2.0, 4.0].as_slice()));
    assert_eq!(steps.len(), 3 * particles.len());
    for (particle, step) in particles.iter().zip(steps.chunks(3)) {
        if particle.iter().any(|x| !x.is_finite()) {
            assert_eq!(step, [65535; 3]);
            continue;
        }
        for axis in 0..3 {
            let back = low[axis] + extent[axis] * f64::from(step[axis]) / 65534.0;
            assert!((back - f64::from(particle[axis])).abs() <= extent[axis] / 65534.0 / 2.0 * 1.001);
        }
    }
    assert_eq!((data["absent"].as_u64(), data["frames"].as_u64()), (Some(1), Some(2)));
    // Nearest neighbours in the first frame: 0.25, √(0.75² + 2² + 4²), 0.25.
    assert_eq!(data["spacing"].as_f64(), Some(0.25));
}

#[test]
fn a_scene_without_particles_or_with_none_finite_is_still_a_page() {
    let empty = Scene { frames: vec![], colours: vec![], ..scene() };
    let lost = Scene { frames: vec![vec![[f32::NAN; 3]; 3]], ground: f32::NAN, frame_dt: f64::NAN, ..scene() };
    for (scene, absent) in [(empty, 0), (lost, 3)] {
        let data = scene_data(&Page { scene: Some(scene), ..page("x", b"") }.html());
        assert_eq!(data["absent"].as_u64(), Some(absent));
        assert!(data["extent"].as_array().expect("a list").iter().all(|v| v.as_f64() == Some(0.0)));
    }
}

#[test]
#[should_panic(expected = "frame 1 has 2 particles, but there are 3 colours")]
fn a_frame_that_lost_a_particle_is_a_mistake_of_the_caller() {
    let mut scene = scene();
    scene.frames[1].pop();
    Page { scene: Some(scene), ..page("x", b"") }.html();
}

#[test]
fn empty_parts_leave_no_empty_frames() {
    let html = Page {
        title: "x",
        subtitle: String::new(),
        headlines: vec![],
        animation: None,
        animation_caption: String::new(),
        drawings: vec![],
        scene: None,
        plots: vec![],
        notes: vec![],
        timings: vec![],
        config_toml: String::new(),
        files: vec![],
    }
    .html();
    assert!(["<section", "<article", "<script", "<table", "<details", "<h2"].iter().all(|t| !html.contains(t)));
}

#[test]
fn durations_are_written_as_a_person_says_them() {
    let timings = [0.4217, 12.345, 59.96, 245.0, 7620.0, f64::NAN].map(|s| ("stage".to_string(), s)).to_vec();
    let html = Page { timings, ..page("x", b"") }.html();
    for text in ["0.42 s", "12.3 s", "1 min 00 s", "4 min 05 s", "2 h 07 min", "unknown"] {
        assert!(html.contains(&format!("<td>{text}</td>")), "{text} is missing");
    }
}
