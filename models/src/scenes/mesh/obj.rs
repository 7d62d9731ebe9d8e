//! Vertices and faces of a Wavefront OBJ.

use gradreel::Result;

use super::Surface;
use crate::mesh_files::obj::{self, Item};

/// Reads vertices and faces.
pub(super) fn read(bytes: &[u8]) -> Result<Surface> {
    let mut surface = Surface::default();
    let mut places = Vec::new();
    obj::read(bytes, false, |item| match item {
        Item::Place(place, _) => surface.add_vertex(place),
        Item::Face(corners) => {
            places.clear();
            places.extend(corners.iter().map(|corner| corner.place));
            surface.add_face(&places)
        }
        _ => Ok(()),
    })?;
    Ok(surface)
}
