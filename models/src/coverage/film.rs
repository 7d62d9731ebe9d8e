//! A recipe filmed: pictures by rays against a surface, written as a clip or as a film.

use std::fs;
use std::path::{Path, PathBuf};

use gradreel::{Error, Result};
use rayon::prelude::*;

use super::Recipe;
use super::mesh::{Mesh, Skin};
use super::motion::Motion;
use crate::identify::Config;
use crate::scenes::{self, Film, Hit, Paint, Surface};
use crate::video::Camera;

/// Rays per pixel along each side.
const RAYS: usize = 3;
/// How far from a surface a shadow ray starts, in particle spacings.
const LIFT: f64 = 0.5;

/// What rays meet in one frame.
enum Shown<'a> {
    Solid(Mesh<'a>),
    Fluid(Surface),
}

impl Shown<'_> {
    fn hit(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Hit> {
        match self {
            Self::Solid(mesh) => mesh.hit(origin, along),
            Self::Fluid(surface) => surface.hit(origin, along),
        }
    }
}

/// Films a motion into a folder and returns the path for a fit: a clip in the PAC-NeRF layout, or a folder of pictures where
/// the fit is not told of the camera.
///
/// Solids are drawn as the mesh of the body, which its particles carry; fluid-like bodies as the level of a smooth sum over
/// particles that encloses the particles' volume.
///
/// # Errors
/// [`ErrorKind::Physics`](gradreel::ErrorKind::Physics) for particles that are spread too far,
/// [`ErrorKind::Io`](gradreel::ErrorKind::Io) where the files cannot be written.
pub fn write(recipe: &Recipe, motion: &Motion, folder: &Path) -> Result<PathBuf> {
    let rest = &motion.positions[0];
    let skin = (!Config::default().flows(&recipe.law)).then(|| Skin::of(recipe, rest, motion.spacing));
    let painted = |x: &[f32; 3]| {
        let place = std::array::from_fn(|axis| (f64::from(x[axis]) - recipe.start[axis]) / recipe.size);
        recipe.body.colour(place).map(|c| c as f32)
    };
    let colours: Vec<[f32; 3]> = rest.iter().map(painted).collect();
    let spacings = vec![motion.spacing; rest.len()];
    let paint = Paint::draw(recipe.paint);
    let root = folder.join(if recipe.calibrated { "clip" } else { "film" });
    let pictures = if recipe.calibrated { root.join("data") } else { root.clone() };
    fs::create_dir_all(&pictures).map_err(|e| Error::io(&pictures, "make the folder of a clip", &e))?;
    for (frame, now) in motion.positions.iter().enumerate() {
        let shown = match &skin {
            Some(skin) => Shown::Solid(skin.carried(rest, now)),
            None => Shown::Fluid(Surface::of(now, &colours, &spacings)?.enclosing(motion.volumes[frame])),
        };
        for camera in &recipe.cameras {
            let name = match recipe.calibrated {
                true => Film::name(camera.id, frame),
                false => format!("{frame:04}.png"),
            };
            let lift = LIFT * motion.spacing;
            let rgba = picture(recipe, camera, &paint, Some((&shown, lift)), frame as u64);
            store(&root.join(name), camera, &rgba)?;
        }
    }
    if recipe.calibrated {
        if recipe.background {
            for camera in &recipe.cameras {
                let plate = picture(recipe, camera, &paint, None, u64::MAX);
                store(&pictures.join(format!("r_{}_-1.png", camera.id)), camera, &plate)?;
            }
        }
        let list = root.join("all_data.json");
        fs::write(&list, scenes::list(&recipe.cameras, recipe.schedule.frames, recipe.schedule.frame_dt))
            .map_err(|e| Error::io(&list, "write the list of a clip", &e))?;
    }
    Ok(root)
}

/// What a camera sees, as bytes of red, green, blue and coverage; with a background everything is covered.
fn picture(recipe: &Recipe, camera: &Camera, paint: &Paint, shown: Option<(&Shown<'_>, f64)>, frame: u64) -> Vec<u8> {
    let (width, height) = (camera.width, camera.height);
    let mut rgba = vec![0u8; width * height * 4];
    let noise = recipe.paint.fold(2 + camera.id as u64).fold(frame);
    rgba.par_chunks_mut(width * 4).enumerate().for_each(|(row, pixels)| {
        let mut grain = Paint::grain(noise.fold(row as u64), 3 * width);
        for (column, pixel) in pixels.chunks_exact_mut(4).enumerate() {
            let (mut colour, mut hits) = ([0.0; 3], 0);
            for part in 0..RAYS * RAYS {
                let inside = |k: usize| (k as f64 + 0.5) / RAYS as f64;
                let (u, v) = (column as f64 + inside(part % RAYS), row as f64 + inside(part / RAYS));
                let (origin, along) = camera.ray(u, v);
                let seen = match shown.and_then(|(shown, _)| shown.hit(origin, along)) {
                    Some(hit) => {
                        hits += 1;
                        let light = paint.light(hit.normal, false);
                        hit.colour.map(|c| light * c)
                    }
                    None if recipe.background => behind(paint, shown, origin, along),
                    None => continue,
                };
                (0..3).for_each(|c| colour[c] += seen[c]);
            }
            let rays = if recipe.background { RAYS * RAYS } else { hits };
            let covered = if recipe.background { 1.0 } else { hits as f64 / (RAYS * RAYS) as f64 };
            if rays > 0 {
                for c in 0..3 {
                    let noise = if recipe.background { grain.next().unwrap_or(0.0) } else { 0.0 };
                    pixel[c] = (255.0 * colour[c] / rays as f64 + noise).round().clamp(0.0, 255.0) as u8;
                }
            }
            pixel[3] = (255.0 * covered).round() as u8;
        }
    });
    rgba
}

/// The floor, in shadow where the body is before the lamp, or the wall.
fn behind(paint: &Paint, shown: Option<(&Shown<'_>, f64)>, origin: [f64; 3], along: [f64; 3]) -> [f64; 3] {
    let Some(foot) = Paint::foot(origin, along) else { return paint.wall(along) };
    let shadow = shown.is_some_and(|(shown, lift)| {
        let from = std::array::from_fn(|axis| foot[axis] + lift * paint.lamp[axis]);
        shown.hit(from, paint.lamp).is_some()
    });
    paint.lit_floor(foot, shadow).map(|c| c.clamp(0.0, 1.0))
}

fn store(path: &Path, camera: &Camera, rgba: &[u8]) -> Result<()> {
    let bytes = crate::report::png_file::png_with_alpha(camera.width, camera.height, rgba)?;
    fs::write(path, bytes).map_err(|e| Error::io(path, "write a picture", &e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::{Split, simulate};

    fn silhouette(rgba: &[u8]) -> usize {
        rgba.chunks_exact(4).filter(|pixel| pixel[3] > 127).count()
    }

    /// Of a fluid, the picture is of as much volume as its particles have.
    #[test]
    fn the_level_of_a_fluid_encloses_its_volume() {
        let recipe = Recipe::draw(Split::Development, 2, 7, None).unwrap();
        let motion = simulate(&recipe).unwrap();
        let colours = vec![[0.5; 3]; motion.positions[0].len()];
        let spacings = vec![motion.spacing; colours.len()];
        for (now, volume) in motion.positions.iter().zip(&motion.volumes) {
            let surface = Surface::of(now, &colours, &spacings).unwrap().enclosing(*volume);
            let found = surface.volume();
            assert!((found / volume - 1.0).abs() < 0.02, "{found} of {volume} m³");
        }
    }

    /// In free fall, solid and level look alike, and the body is within every picture.
    #[test]
    fn cameras_see_the_body() {
        for number in 0..5 {
            let recipe = Recipe { background: false, ..Recipe::draw(Split::Development, number, 7, None).unwrap() };
            let motion = simulate(&recipe).unwrap();
            let rest = &motion.positions[0];
            let skin = Skin::of(&recipe, rest, motion.spacing);
            let mesh = Shown::Solid(skin.carried(rest, rest));
            let spacings = vec![motion.spacing; rest.len()];
            let level = Surface::of(rest, &vec![[0.5; 3]; rest.len()], &spacings).unwrap().enclosing(motion.volumes[0]);
            let paint = Paint::draw(recipe.paint);
            let camera = &recipe.cameras[0];
            let [solid, fluid] = [mesh, Shown::Fluid(level)].map(|shown| {
                let rgba = picture(&recipe, camera, &paint, Some((&shown, 0.0)), 0);
                let rim = |at: usize| rgba[4 * at + 3] > 0;
                let (w, h) = (camera.width, camera.height);
                assert!((0..w).all(|u| !rim(u) && !rim((h - 1) * w + u)), "clip {number} is cut off");
                silhouette(&rgba) as f64
            });
            assert!(solid > 20.0 && (fluid / solid - 1.0).abs() < 0.3, "clip {number}: {solid} and {fluid} pixels");
        }
    }
}
