//! Wavefront OBJ with colours: `v x y z [r g b]`, `vt u v` (v upwards), `vn x y z`, `f corner/texture/normal …`, `mtllib` and
//! `usemtl`; all else is passed over. Faces with more than three corners are fans of triangles.

use std::borrow::Cow;
use std::collections::HashMap;

use gradreel::Result;

use super::beside::Beside;
use super::mtl::{self, GREY, Material};
use super::paint::Paint;
use super::surface::{Corner, Surface};
use super::{Triangle, damaged};

/// No texture or normal at a corner.
const NONE: u32 = u32::MAX;

/// What was read so far.
#[derive(Default)]
struct Reader {
    places: Vec<[f64; 3]>,
    /// Of each place, where the file has them.
    colours: Vec<Option<[f32; 3]>>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    libraries: Vec<String>,
    /// Names of the materials that are used, and their numbers from 1; 0 is that of faces without.
    materials: Vec<String>,
    numbers: HashMap<String, u32>,
    material: u32,
    /// Place, texture, normal and material of each corner of the triangles.
    corners: Vec<[u32; 4]>,
}

/// Reads a surface and its materials.
pub(super) fn read(bytes: &[u8], beside: &Beside) -> Result<Surface> {
    let mut reader = Reader::default();
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let mut line = Cow::Borrowed(line);
        // goes on in the next one
        while line.ends_with('\\') && !line.starts_with('#') {
            let whole = line.to_mut();
            whole.pop();
            whole.push(' ');
            whole.push_str(lines.next().map_or("", |(_, next)| next));
        }
        reader.line(line.trim()).map_err(|wanted| {
            let found: String = line.chars().take(80).collect();
            damaged("a line of the mesh cannot be read").at(format!("line {}", number + 1)).found(found).wanted(wanted)
        })?;
        let longest = [reader.corners.len(), reader.places.len(), reader.uvs.len(), reader.normals.len()];
        Surface::check_count(longest.into_iter().fold(0, usize::max) / 3)?;
    }
    reader.surface(beside)
}

impl Reader {
    /// Takes a line, or says what it should have been.
    fn line(&mut self, line: &str) -> Result<(), String> {
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match word {
            "v" => {
                let numbers: Vec<f64> = rest.split_whitespace().map_while(|word| word.parse().ok()).collect();
                let place = numbers.first_chunk().ok_or("v x y z, or v x y z r g b")?;
                self.places.push(*place);
                let colour = numbers.get(3..6).map(|rgb| [0, 1, 2].map(|c| rgb[c] as f32));
                self.colours.push(colour);
            }
            "vt" => {
                let [u, v] = numbers(rest).ok_or("vt u v")?;
                self.uvs.push([u, 1.0 - v]);
            }
            "vn" => self.normals.push(numbers(rest).ok_or("vn x y z")?),
            "f" => self.face(rest)?,
            "mtllib" => self.libraries.push(rest.trim().to_owned()),
            "usemtl" => {
                let name = rest.trim();
                self.material = match self.numbers.get(name) {
                    Some(known) => *known,
                    None => {
                        self.materials.push(name.to_owned());
                        self.numbers.insert(name.to_owned(), self.materials.len() as u32);
                        self.materials.len() as u32
                    }
                };
            }
            _ => {}
        }
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), String> {
        let counts = [self.places.len(), self.uvs.len(), self.normals.len()];
        let corner = |word: &str| -> Option<[u32; 4]> {
            let mut found = [NONE, NONE, NONE, self.material];
            for (kind, index) in word.split('/').enumerate() {
                let count = *counts.get(kind)? as i64;
                if index.is_empty() && kind > 0 {
                    continue;
                }
                let index: i64 = index.parse().ok()?;
                let index = if index < 0 { count.checked_add(index)? } else { index - 1 };
                // faces without their normals are flat
                let there = (0..count).contains(&index).then_some(index as u32);
                found[kind] = if kind == 2 { there.unwrap_or(NONE) } else { there? };
            }
            Some(found)
        };
        let corners: Option<Vec<[u32; 4]>> = rest.split_whitespace().map(corner).collect();
        let corners = corners.filter(|corners| corners.len() >= 3).ok_or_else(|| {
            let [places, uvs, _] = counts;
            format!("f and at least three of the {places} corners and {uvs} texture places before it")
        })?;
        for pair in corners[1..].windows(2) {
            self.corners.extend([corners[0], pair[0], pair[1]]);
        }
        Ok(())
    }

    fn surface(self, beside: &Beside) -> Result<Surface> {
        let libraries = self.read_libraries(beside)?;
        let given: HashMap<&str, &Material> = libraries.iter().map(|material| (&*material.name, material)).collect();
        let mut surface = Surface { paints: vec![Paint::default()], ..Surface::default() };
        let (mut tints, mut known) = (vec![GREY], HashMap::new());
        for name in &self.materials {
            // without a library every surface is grey
            if self.libraries.is_empty() {
                tints.push(GREY);
                surface.paints.push(Paint::default());
                continue;
            }
            let material = given.get(&**name).ok_or_else(|| {
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
                    // a colour of its own takes the place of the material's, unless there is a picture that both tint
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

    /// The materials of all libraries. A line may name several, or one whose name has blanks.
    fn read_libraries(&self, beside: &Beside) -> Result<Vec<Material>> {
        let mut materials = Vec::new();
        for line in &self.libraries {
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

/// The first numbers of a text.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let mut words = text.split_whitespace();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = words.next()?.parse().ok()?;
    }
    Some(numbers)
}
