//! Wavefront OBJ with colours and materials. Faces with more than three corners are split into triangle fans.

use std::collections::HashMap;

use gradreel::Result;

use super::beside::Beside;
use super::mtl::{self, GREY, Material};
use super::paint::Paint;
use super::surface::{Corner, Surface};
use super::{Triangle, damaged};
use crate::mesh_files::obj::{self, Item};
use crate::mesh_files::wavefront::uncommented;

/// Marks a corner without texture or normal.
const NONE: u32 = u32::MAX;

/// State of the reader.
#[derive(Default)]
struct Reader {
    places: Vec<[f64; 3]>,
    /// Colour of each position, if the file has colours.
    colours: Vec<Option<[f32; 3]>>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    libraries: Vec<String>,
    /// Names of the used materials, and their indices from 1; 0 means no material.
    materials: Vec<String>,
    numbers: HashMap<String, u32>,
    material: u32,
    /// Position, texture, normal and material of each corner of the triangles.
    corners: Vec<[u32; 4]>,
}

/// Reads a surface and its materials.
pub(super) fn read(bytes: &[u8], beside: &Beside) -> Result<Surface> {
    let mut reader = Reader::default();
    obj::read(bytes, true, |item| {
        reader.take(item);
        let longest = [reader.corners.len(), reader.places.len(), reader.uvs.len(), reader.normals.len()];
        Surface::check_count(longest.into_iter().fold(0, usize::max) / 3)
    })?;
    reader.surface(beside)
}

impl Reader {
    fn take(&mut self, item: Item<'_>) {
        match item {
            Item::Place(place, colour) => {
                self.places.push(place);
                self.colours.push(colour);
            }
            Item::Uv([u, v]) => self.uvs.push([u, 1.0 - v]),
            Item::Normal(normal) => self.normals.push(normal),
            Item::Face(corners) => {
                let key = |corner: &obj::Corner| {
                    [corner.place, corner.uv.unwrap_or(NONE), corner.normal.unwrap_or(NONE), self.material]
                };
                for pair in corners[1..].windows(2) {
                    self.corners.extend([corners[0], pair[0], pair[1]].iter().map(key));
                }
            }
            Item::Libraries("") => {}
            Item::Libraries(names) => self.libraries.push(names.to_owned()),
            Item::Material("") => self.material = 0,
            Item::Material(name) => {
                self.material = match self.numbers.get(name) {
                    Some(known) => *known,
                    None => {
                        self.materials.push(name.to_owned());
                        self.numbers.insert(name.to_owned(), self.materials.len() as u32);
                        self.materials.len() as u32
                    }
                };
            }
        }
    }

    fn surface(self, beside: &Beside) -> Result<Surface> {
        let libraries = self.read_libraries(beside)?;
        let given: HashMap<&str, &Material> = libraries.iter().map(|material| (&*material.name, material)).collect();
        // `#` may be part of a name or begin a comment
        let bare: HashMap<&str, &Material> =
            given.iter().map(|(name, material)| (uncommented(name), *material)).collect();
        let mut surface = Surface { paints: vec![Paint::default()], ..Surface::default() };
        let (mut tints, mut known) = (vec![GREY], HashMap::new());
        for name in &self.materials {
            // without a library, or without a material name, the surface is grey
            if self.libraries.is_empty() || (uncommented(name).is_empty() && !given.contains_key(&**name)) {
                tints.push(GREY);
                surface.paints.push(Paint::default());
                continue;
            }
            let material = given.get(&**name).or_else(|| bare.get(uncommented(name))).ok_or_else(|| {
                damaged("the mesh uses a material that it does not have")
                    .at(format!("usemtl {name}"))
                    .found(format!("{} materials in {}", given.len(), self.libraries.join(", ")))
                    .wanted("a material of this name")
            })?;
            tints.push(material.colour());
            surface.paints.push(material.paint(beside, &mut known)?);
        }
        let mut places = HashMap::new();
        let corners: Vec<u32> = self
            .corners
            .iter()
            .map(|key| {
                *places.entry(*key).or_insert_with(|| {
                    let [place, uv, normal, material] = key.map(|index| index as usize);
                    let painted = surface.paints[material].picture.is_some();
                    let own = self.colours[place];
                    // a vertex colour replaces the material's, unless there is a picture that both tint
                    let tint = if own.is_some() && !painted { [1.0; 3] } else { tints[material] };
                    let own = own.unwrap_or([1.0; 3]);
                    surface.corners.push(Corner {
                        place: self.places[place],
                        normal: self.normals.get(normal).copied().unwrap_or_default(),
                        uv: self.uvs.get(uv).copied().unwrap_or_default(),
                        colour: std::array::from_fn(|c| own[c] * tint[c]),
                    });
                    surface.corners.len() as u32 - 1
                })
            })
            .collect();
        let triangle = |corners: &[u32], keys: &[[u32; 4]]| Triangle {
            corners: [corners[0], corners[1], corners[2]],
            paint: keys[0][3],
        };
        surface.triangles = corners
            .chunks_exact(3)
            .zip(self.corners.chunks_exact(3))
            .map(|(corners, keys)| triangle(corners, keys))
            .collect();
        Ok(surface)
    }

    /// The materials of all libraries, if any are used. A line may name several libraries, or one whose name
    /// contains spaces.
    fn read_libraries(&self, beside: &Beside) -> Result<Vec<Material>> {
        let mut materials = Vec::new();
        let libraries = if self.materials.is_empty() { &[][..] } else { &self.libraries };
        for line in libraries {
            let line = if beside.has(line) { line } else { uncommented(line) };
            let whole = beside.has(line) || !line.contains(char::is_whitespace);
            let names: Vec<&str> = if whole { vec![line] } else { line.split_whitespace().collect() };
            for name in names {
                let bytes = beside.read(name, "the materials of the mesh")?;
                materials.extend(mtl::read(&bytes).map_err(|e| e.within(name))?);
            }
        }
        Ok(materials)
    }
}
