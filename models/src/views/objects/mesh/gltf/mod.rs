//! glTF 2.0, as text (`.gltf`) or binary (`.glb`): the triangles of a scene, their base colours and textures.
//!
//! Skins, morph targets, animations, lights and emission are ignored.

mod binary;
mod json;
mod materials;
mod nodes;
mod whole;

use gradreel::Result;

use self::binary::{Buffers, Elements};
use self::json::{Primitive, Root};
use self::materials::Materials;
use self::nodes::{Placed, placed};
use super::beside::Beside;
use super::surface::{Corner, Surface};
use super::{Triangle, damaged};

/// Reads a surface with its pictures.
pub(super) fn read(bytes: &[u8], beside: &Beside) -> Result<Surface> {
    let (json, binary) = binary::parts(bytes)?;
    let root: Root =
        serde_json::from_slice(json).map_err(|e| damaged("the mesh cannot be read").found(e).wanted("glTF 2.0"))?;
    let understood = |name: &str| {
        let surfaces = name.starts_with("KHR_materials_") || name == "KHR_lights_punctual";
        surfaces || ["KHR_texture_transform", "KHR_mesh_quantization"].contains(&name)
    };
    if let Some(name) = root.extensions_required.iter().find(|name| !understood(name)) {
        return Err(damaged("the mesh needs an extension of glTF that is not read")
            .found(name)
            .wanted("plain glTF 2.0")
            .fix("export without compression of meshes, with textures as PNG or JPEG"));
    }
    let buffers = Buffers::read(&root, binary, beside)?;
    let (mut surface, mut materials) = (Surface::default(), Materials::new(&root));
    for Placed { mesh, place } in placed(&root)? {
        let found = root.meshes.get(mesh).ok_or_else(|| damaged(format!("there is no mesh {mesh}")))?;
        for (index, primitive) in found.primitives.iter().enumerate() {
            if !(4..=6).contains(&primitive.mode) {
                continue; // points and lines
            }
            add(&mut surface, primitive, &place, &buffers, &mut materials, beside)
                .map_err(|e| e.within(format!("mesh {mesh}, primitive {index}")))?;
        }
    }
    surface.paints = materials.into_paints();
    Ok(surface)
}

fn add(
    surface: &mut Surface,
    primitive: &Primitive,
    place: &nodes::Place,
    buffers: &Buffers<'_>,
    materials: &mut Materials<'_>,
    beside: &Beside,
) -> Result<()> {
    let attribute = |name: &str| primitive.attributes.get(name).map(|index| buffers.elements(*index)).transpose();
    let wanted = |what: &str, count: usize| {
        let wanted = format!("one of at least {count} numbers for each corner");
        damaged(format!("the {what} of the mesh do not fit it")).wanted(wanted)
    };
    let places = attribute("POSITION")?.ok_or_else(|| damaged("the mesh has no places of its corners"))?;
    let places: Vec<[f64; 3]> = places.vectors().ok_or_else(|| wanted("places", 3))?.collect();
    let count = places.len();
    // one per vertex, or none
    fn fitting<const N: usize>(elements: Option<Elements>, count: usize) -> Option<Vec<[f64; N]>> {
        let Some(elements) = elements else { return Some(vec![[0.0; N]; count]) };
        elements.vectors().filter(|each| each.len() == count).map(Iterator::collect)
    }
    let normals = fitting::<3>(attribute("NORMAL")?, count).ok_or_else(|| wanted("normals", 3))?;
    let material = materials.get(primitive.material, buffers, beside)?;
    let uvs = fitting::<2>(attribute(&format!("TEXCOORD_{}", material.uv_set))?, count);
    let uvs = uvs.ok_or_else(|| wanted("places in the texture", 2))?;
    let colours = match attribute("COLOR_0")? {
        None => None,
        given => Some(fitting::<3>(given, count).ok_or_else(|| wanted("colours", 3))?),
    };
    let first = surface.corners.len();
    surface.corners.extend((0..count).map(|i| Corner {
        place: place.point(places[i]),
        normal: place.normal(normals[i]).map(|x| x as f32),
        uv: material.uv(uvs[i]).map(|x| x as f32),
        colour: material.colour(colours.as_ref().map_or([1.0; 3], |colours| colours[i])),
    }));
    let order: Vec<u32> = match primitive.indices {
        None => (0..count as u32).collect(),
        Some(index) => buffers.elements(index)?.numbers.into_iter().map(|x| x as u32).collect(),
    };
    if let Some(corner) = order.iter().find(|corner| **corner as usize >= count) {
        let error = damaged("a face of the mesh names a corner that there is not");
        return Err(error.found(format!("corner {corner}")).wanted(format!("less than {count}")));
    }
    let corners = |[a, b, c]: [usize; 3]| [order[a], order[b], order[c]].map(|corner| first as u32 + corner);
    let triangles: Box<dyn Iterator<Item = [usize; 3]>> = match primitive.mode {
        5 => Box::new((2..order.len()).map(|i| [i - 2, i - 1, i])),
        6 => Box::new((2..order.len()).map(|i| [0, i - 1, i])),
        _ => Box::new((0..order.len() / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2])),
    };
    surface.triangles.extend(triangles.map(|at| Triangle { corners: corners(at), paint: material.paint }));
    Surface::check_count(surface.triangles.len().max(surface.corners.len() / 3))
}
