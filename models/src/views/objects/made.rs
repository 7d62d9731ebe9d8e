//! Procedural objects: a body, its texture, and its grid.

use gradreel::Key;

use super::Met;
use super::body::Body;
use super::field::Field;
use super::texture::Texture;

/// A body with a texture.
pub(crate) struct Made {
    body: Body,
    texture: Texture,
    field: Field,
}

impl Made {
    /// Built from a key for its shape and a key for its texture, with `nodes` grid nodes along the longest side.
    // empty and paper-thin bodies are redrawn
    pub fn new(keys: [Key; 2], nodes: usize) -> Self {
        Self::of(Body::new, keys, nodes)
    }

    pub fn of(draw: impl Fn(Key) -> Body, [shape, paint]: [Key; 2], nodes: usize) -> Self {
        let made = (0..).find_map(|turn| {
            let body = draw(shape.fold(turn));
            Field::of(&body, nodes.max(8)).map(|field| (body, field))
        });
        let (body, field) = made.expect("bodies do not end");
        Self { texture: Texture::new(paint, body.parts()), body, field }
    }

    /// Half sides of its box.
    pub fn half(&self) -> [f64; 3] {
        self.field.half
    }

    /// Intersection with a ray; the direction has length 1.
    pub fn field(&self) -> &Field {
        &self.field
    }

    pub fn colour(&self, place: [f64; 3]) -> [f64; 3] {
        let (middle, size) = self.field.made;
        let made: [f64; 3] = std::array::from_fn(|axis| middle[axis] + size * place[axis]);
        let own = self.body.inside(made);
        self.texture.colour(self.body.part_at(own), own)
    }

    pub(super) fn met(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Met> {
        let entry = self.field.entry(origin, along)?;
        Some(Met { normal: entry.normal, colour: self.colour(entry.place) })
    }
}
