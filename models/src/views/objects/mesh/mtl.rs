//! Materials of a Wavefront OBJ: the display colour `Kd r g b` and the picture `map_Kd file`, multiplied by it; all
//! else is ignored.

use std::collections::HashMap;
use std::sync::Arc;

use gradreel::Result;

use super::beside::Beside;
use super::damaged;
use super::paint::{Ends, Paint, Picture};
use crate::mesh_files::text;
use crate::mesh_files::wavefront::{self, uncommented};

/// Maximum number of pictures of a mesh.
pub(super) const MOST_PICTURES: usize = 256;
/// Default surface colour.
pub(super) const GREY: [f32; 3] = [0.8; 3];

/// A named material.
pub(super) struct Material {
    pub name: String,
    colour: Option<[f32; 3]>,
    /// Picture file, and whether it is clamped at its edges.
    picture: Option<(String, bool)>,
}

impl Material {
    /// Colour factor of the vertices. Exporters write black for a surface coloured by its picture only.
    pub fn colour(&self) -> [f32; 3] {
        match (self.colour, &self.picture) {
            (Some([0.0, 0.0, 0.0]) | None, Some(_)) => [1.0; 3],
            (colour, _) => colour.unwrap_or(GREY),
        }
    }

    /// The picture of the surface; `known` caches those already read.
    pub fn paint(&self, beside: &Beside, known: &mut HashMap<String, Arc<Picture>>) -> Result<Paint> {
        let Some((file, clamped)) = &self.picture else { return Ok(Paint::default()) };
        let picture = match known.get(file) {
            Some(picture) => picture.clone(),
            None => {
                if known.len() >= MOST_PICTURES {
                    return Err(damaged("the mesh has too many textures").wanted(format!("at most {MOST_PICTURES}")));
                }
                let bare = uncommented(file);
                let there = if beside.has(file) || bare.is_empty() { file } else { bare };
                let bytes = beside.read(there, "the texture of the mesh")?;
                let picture = Arc::new(Picture::decode(&bytes, file)?);
                known.insert(file.clone(), picture.clone());
                picture
            }
        };
        let ends = if *clamped { Ends::Clamp } else { Ends::Repeat };
        Ok(Paint { picture: Some(picture), cutoff: 0.0, ends: [ends; 2] })
    }
}

/// Reads the materials of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<Material>> {
    let text = text::decoded(bytes)?;
    let mut materials: Vec<Material> = Vec::new();
    for line in wavefront::lines(&text) {
        let refused = |wanted: &str| {
            let error = damaged("a line of the materials cannot be read").at(format!("line {}", line.number));
            error.found(line.shown()).wanted(wanted)
        };
        let word = line.word();
        if word == "newmtl" {
            materials.push(Material { name: line.name().to_owned(), colour: None, picture: None });
        }
        let Some(material) = materials.last_mut() else { continue };
        if word == "Kd" {
            material.colour = Some(colour(line.values()).ok_or_else(|| refused("Kd r g b, from 0 to 1"))?);
        } else if word.eq_ignore_ascii_case("map_Kd") {
            material.picture = Some(picture(line.name()).ok_or_else(|| refused("map_Kd and a file"))?);
        }
    }
    Ok(materials)
}

/// Three numbers, or one for all channels.
fn colour(text: &str) -> Option<[f32; 3]> {
    let numbers = text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f32| x.is_finite()));
    match numbers.collect::<Option<Vec<f32>>>()?[..] {
        [grey] => Some([grey; 3]),
        [red, green, blue, ..] => Some([red, green, blue]),
        _ => None,
    }
}

/// The file after the options, which may contain spaces, and whether it is clamped.
fn picture(text: &str) -> Option<(String, bool)> {
    let (mut rest, mut clamped) = (text, false);
    let next = |text: &mut &str| {
        let (word, after) = text.split_once(char::is_whitespace)?;
        *text = after.trim_start();
        Some(word.to_owned())
    };
    while rest.starts_with('-') {
        let option = next(&mut rest)?;
        match option.as_str() {
            "-clamp" => clamped = next(&mut rest)? == "on",
            "-mm" => (0..2).try_for_each(|_| next(&mut rest).map(drop))?,
            // one to three numbers
            "-o" | "-s" | "-t" => {
                for _ in 0..3 {
                    let word = rest.split_whitespace().next()?;
                    if word.parse::<f64>().is_ok() {
                        next(&mut rest)?;
                    }
                }
            }
            // one argument: -blendu, -cc, -boost, …
            _ => drop(next(&mut rest)?),
        }
    }
    (!rest.is_empty()).then(|| (rest.to_owned(), clamped))
}
