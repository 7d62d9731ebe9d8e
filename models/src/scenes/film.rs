//! A simulation rendered by a ring of cameras, as a clip for `reconstruct`.
//!
//! The renderer differs from that of the reconstruction: it casts single rays against a closed surface lit by a
//! lamp. An estimate from such a clip thus does not merely invert its own rendering.

use std::f64::consts::TAU;

use gradreel::{Error, ErrorKind, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::setup::Setup;
use super::surface::Surface;
use crate::vector::{bounds, dot, minus};
use crate::video::Camera;

/// Rays per pixel along each side.
const RAYS: usize = 3;
/// Direction towards the lamp.
const LAMP: [f64; 3] = [0.35, 0.83, 0.43];
/// Share of ambient light.
const AMBIENT: f64 = 0.7;

/// Camera settings; omitted values are chosen such that the start and the floor below it are visible.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilmSettings {
    /// Number of cameras on a ring around the target.
    pub cameras: usize,
    /// Width and height of each image \[pixels\].
    pub pixels: [usize; 2],
    /// Vertical field of view \[°\].
    pub field_of_view_deg: f64,
    /// Elevations of the cameras above the target, used cyclically \[°\].
    pub elevation_deg: Vec<f64>,
    /// Target point \[m\].
    pub target_m: Option<[f64; 3]>,
    /// Distance of the cameras from the target \[m\].
    pub distance_m: Option<f64>,
    /// Strength of the colour variation over an object, 0 to 1.
    pub pattern: f64,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self {
            cameras: 7,
            pixels: [320, 320],
            field_of_view_deg: 40.0,
            elevation_deg: vec![12.0, 28.0],
            target_m: None,
            distance_m: None,
            pattern: 0.5,
        }
    }
}

/// An 8-bit sRGB image with alpha.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shot {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height · width · 4` bytes: red, green, blue (straight alpha) and coverage.
    pub rgba: Vec<u8>,
}

/// Cameras around a scene, and the colours of its particles.
///
/// Files of the clip: `all_data.json`, and `data/r_{camera}_{frame}.png` with the object's coverage as alpha.
#[derive(Debug, Clone)]
pub struct Film {
    cameras: Vec<Camera>,
    colours: Vec<[f32; 3]>,
    /// Spacing of each particle, from its neighbours at rest \[m\].
    spacings: Vec<f64>,
    frames: usize,
    frame_dt: f64,
}

impl Film {
    /// Places the cameras.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for settings outside their range.
    pub fn of(setup: &Setup, settings: &FilmSettings) -> Result<Self> {
        let [width, height] = settings.pixels;
        let rules = [
            ((1..=256).contains(&settings.cameras), "cameras", "1 to 256"),
            ((8..=4096).contains(&width) && (8..=4096).contains(&height), "pixels", "8 to 4096 each"),
            ((1.0..=150.0).contains(&settings.field_of_view_deg), "field_of_view_deg", "1 to 150 degrees"),
            (
                !settings.elevation_deg.is_empty() && settings.elevation_deg.iter().all(|e| e.abs() <= 89.0),
                "elevation_deg",
                "at least one angle, none beyond 89 degrees",
            ),
            (settings.distance_m.is_none_or(|d| d > 0.0 && d.is_finite()), "distance_m", "a positive number"),
            (settings.target_m.is_none_or(|t| t.iter().all(|x| x.is_finite())), "target_m", "three numbers"),
            ((0.0..=1.0).contains(&settings.pattern), "pattern", "0 to 1"),
        ];
        if let Some((_, name, wanted)) = rules.iter().find(|(holds, ..)| !holds) {
            return Err(Error::new(ErrorKind::Input, format!("the scene cannot be filmed with this film.{name}"))
                .at(format!("film.{name}"))
                .wanted(wanted)
                .fix("correct it in the scene file, or leave it out"));
        }
        let [mut low, high] = bounds(setup.positions.iter().copied());
        if let Some(floor) = setup.floor() {
            low[1] = low[1].min(floor);
        }
        let middle: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let reach = minus(high, low).map(|x| x * x).iter().sum::<f64>().sqrt();
        let target = settings.target_m.unwrap_or(middle);
        let half = settings.field_of_view_deg.to_radians() / 2.0;
        let distance = settings.distance_m.unwrap_or(0.75 * reach / half.sin());
        let camera = |id: usize| {
            let around = TAU * id as f64 / settings.cameras as f64;
            let up = settings.elevation_deg[id % settings.elevation_deg.len()].to_radians();
            Camera::around(id as i64, settings.pixels, 2.0 * half, target, distance, [around, up])
        };
        Ok(Self {
            cameras: (0..settings.cameras).map(camera).collect(),
            colours: colours(setup, settings.pattern),
            spacings: setup.object_of.iter().map(|&object| setup.volumes[object as usize].cbrt()).collect(),
            frames: setup.schedule.frames,
            frame_dt: setup.schedule.frame_dt,
        })
    }

    /// The cameras.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// The first camera; colours and spacings \[m\] of the particles.
    pub fn of_one_camera(mut self) -> (Camera, Vec<[f32; 3]>, Vec<f64>) {
        (self.cameras.swap_remove(0), self.colours, self.spacings)
    }

    /// `all_data.json` of the clip.
    pub fn list(&self) -> String {
        list(&self.cameras, self.frames, self.frame_dt)
    }

    /// File name of an image, relative to the clip's folder.
    pub fn name(camera: i64, frame: usize) -> String {
        format!("data/r_{camera}_{frame}.png")
    }

    /// Renders particles at these positions \[m\] in every camera.
    ///
    /// # Errors
    /// [`ErrorKind::Physics`] if they are spread too far.
    pub fn shots(&self, positions: &[[f32; 3]]) -> Result<Vec<Shot>> {
        let surface = Surface::of(positions, &self.colours, &self.spacings)?;
        Ok(self.cameras.iter().map(|camera| shot(&surface, camera)).collect())
    }
}

/// `all_data.json` of a clip in the PAC-NeRF layout: the file, the time \[s\] and the camera of each image.
pub(crate) fn list(cameras: &[Camera], frames: usize, frame_dt: f64) -> String {
    let entry = |camera: &Camera, frame: usize| {
        json!({
            "file_path": format!("./{}", Film::name(camera.id, frame)),
            "time": frame as f64 * frame_dt,
            "c2w": camera.c2w,
            "intrinsic": [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]],
        })
    };
    let entries = cameras.iter().flat_map(|camera| (0..frames).map(move |frame| entry(camera, frame)));
    serde_json::Value::from_iter(entries).to_string()
}

/// The objects' colours, varied smoothly over each object.
fn colours(setup: &Setup, pattern: f64) -> Vec<[f32; 3]> {
    let [low, high] = bounds(setup.positions.iter().copied());
    let size = minus(high, low).into_iter().fold(1e-9, f64::max);
    let colour = |(x, &object): (&[f64; 3], &u32)| -> [f32; 3] {
        let base = setup.colours[object as usize];
        std::array::from_fn(|channel| {
            let at = |axis: usize, waves: f64| (TAU * waves * (x[axis] - low[axis]) / size).sin();
            let wave = match channel {
                0 => at(0, 1.3) * at(1, 0.9),
                1 => at(1, 1.6) + 0.4 * at(2, 1.1),
                _ => at(2, 1.4) * at(0, 0.8),
            };
            let plain = f64::from(base[channel]) / 255.0;
            (plain + 0.5 * pattern * wave * (0.2 + plain.min(1.0 - plain))).clamp(0.0, 1.0) as f32
        })
    };
    setup.positions.iter().zip(&setup.object_of).map(colour).collect()
}

fn shot(surface: &Surface, camera: &Camera) -> Shot {
    let (width, height) = (camera.width, camera.height);
    let mut rgba = vec![0u8; width * height * 4];
    rgba.par_chunks_mut(width * 4).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.chunks_exact_mut(4).enumerate() {
            let (mut colour, mut hits) = ([0.0; 3], 0);
            for part in 0..RAYS * RAYS {
                let inside = |k: usize| (k as f64 + 0.5) / RAYS as f64;
                let (u, v) = (column as f64 + inside(part % RAYS), row as f64 + inside(part / RAYS));
                let (origin, direction) = camera.ray(u, v);
                if let Some(hit) = surface.hit(origin, direction) {
                    let light = AMBIENT + (1.0 - AMBIENT) * dot(hit.normal, LAMP).max(0.0);
                    (0..3).for_each(|c| colour[c] += light * hit.colour[c]);
                    hits += 1;
                }
            }
            if hits > 0 {
                (0..3).for_each(|c| pixel[c] = (255.0 * colour[c] / f64::from(hits)).round() as u8);
                pixel[3] = (255.0 * f64::from(hits) / (RAYS * RAYS) as f64).round() as u8;
            }
        }
    });
    Shot { width, height, rgba }
}
