//! Base colours and textures of surfaces.

use std::collections::HashMap;
use std::sync::Arc;

use gradreel::Result;

use super::binary::{Buffers, of_uri};
use super::json::{Material, Root, Sampler, TextureInfo, TextureTransform};
use crate::views::objects::mesh::beside::Beside;
use crate::views::objects::mesh::damaged;
use crate::views::objects::mesh::mtl::MOST_PICTURES;
use crate::views::objects::mesh::paint::{Ends, Paint, Picture};

/// The requested materials and their pictures.
pub(super) struct Materials<'a> {
    root: &'a Root,
    paints: Vec<Paint>,
    /// By index in the file.
    known: HashMap<Option<usize>, Look>,
    pictures: HashMap<usize, Arc<Picture>>,
}

/// Effect of a material on a vertex.
#[derive(Clone)]
pub(super) struct Look {
    /// Index of the paint.
    pub paint: u32,
    /// Index of the texture coordinate set.
    pub uv_set: usize,
    /// Linear.
    factor: [f32; 3],
    transform: Option<TextureTransform>,
}

impl<'a> Materials<'a> {
    pub fn new(root: &'a Root) -> Self {
        Self { root, paints: Vec::new(), known: HashMap::new(), pictures: HashMap::new() }
    }

    /// A material by its index; white without one.
    pub fn get(&mut self, index: Option<usize>, buffers: &Buffers<'_>, beside: &Beside) -> Result<Look> {
        if let Some(look) = self.known.get(&index) {
            return Ok(look.clone());
        }
        let plain = Material::default();
        let material = match index {
            None => &plain,
            Some(index) => {
                let found = self.root.materials.get(index);
                found.ok_or_else(|| {
                    damaged("the mesh uses a material that it does not have").at(format!("material {index}"))
                })?
            }
        };
        let base = material.extensions.specular_glossiness.as_ref().unwrap_or(&material.pbr_metallic_roughness);
        let [red, green, blue, alpha] = base.factor.unwrap_or([1.0; 4]);
        let cutoff = match material.alpha_mode.as_deref() {
            Some("MASK") => material.alpha_cutoff.unwrap_or(0.5),
            Some("BLEND") => 0.5,
            _ => 0.0,
        };
        // opacity is the product of both
        let cutoff = if cutoff > 0.0 { cutoff / alpha.max(1e-6) } else { 0.0 };
        let mut paint = Paint { cutoff, ..Paint::default() };
        let transform = base.texture.as_ref().and_then(|info| info.extensions.transform.clone());
        let uv_set = base.texture.as_ref().map_or(0, |info| info.tex_coord);
        if let Some(info) = &base.texture {
            (paint.picture, paint.ends) = self.picture(info, buffers, beside)?;
        }
        let look = Look {
            paint: self.paints.len() as u32,
            uv_set: transform.as_ref().and_then(|transform| transform.tex_coord).unwrap_or(uv_set),
            factor: [red, green, blue],
            transform,
        };
        self.paints.push(paint);
        self.known.insert(index, look.clone());
        Ok(look)
    }

    fn picture(
        &mut self,
        info: &TextureInfo,
        buffers: &Buffers<'_>,
        beside: &Beside,
    ) -> Result<(Option<Arc<Picture>>, [Ends; 2])> {
        let missing = || damaged("the mesh uses a texture that it does not have").at(format!("texture {}", info.index));
        let texture = self.root.textures.get(info.index).ok_or_else(missing)?;
        let sampler = texture
            .sampler
            .and_then(|index| self.root.samplers.get(index))
            .unwrap_or(&Sampler { wrap_s: None, wrap_t: None });
        let ends = [sampler.wrap_s, sampler.wrap_t].map(|wrap| match wrap {
            Some(33071) => Ends::Clamp,
            Some(33648) => Ends::Mirror,
            _ => Ends::Repeat,
        });
        let source = texture.source.ok_or_else(missing)?;
        if let Some(known) = self.pictures.get(&source) {
            return Ok((Some(known.clone()), ends));
        }
        if self.pictures.len() >= MOST_PICTURES {
            return Err(damaged("the mesh has too many textures").wanted(format!("at most {MOST_PICTURES}")));
        }
        let image = self.root.images.get(source).ok_or_else(missing)?;
        let name = match &image.uri {
            Some(uri) if !uri.starts_with("data:") => uri.clone(),
            _ => format!("image {source}"),
        };
        let picture = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => Picture::decode(&of_uri(uri, beside, "the texture of the mesh")?, &name)?,
            (None, Some(view)) => Picture::decode(buffers.view(view)?.0, &name)?,
            (None, None) => return Err(missing()),
        };
        let picture = Arc::new(picture);
        self.pictures.insert(source, picture.clone());
        Ok((Some(picture), ends))
    }

    pub fn into_paints(self) -> Vec<Paint> {
        self.paints
    }
}

impl Look {
    /// Transformed texture coordinates.
    pub fn uv(&self, uv: [f64; 2]) -> [f64; 2] {
        let Some(TextureTransform { offset, rotation, scale, .. }) = &self.transform else { return uv };
        let scale = scale.unwrap_or([1.0; 2]);
        let ([u, v], (sin, cos)) = ([uv[0] * scale[0], uv[1] * scale[1]], rotation.sin_cos());
        [offset[0] + cos * u + sin * v, offset[1] - sin * u + cos * v]
    }

    /// Display colour of a vertex, given its linear colour. The texture is multiplied in display values as well,
    /// which is exact if one of the two is white.
    pub fn colour(&self, own: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|c| shown(own[c] * f64::from(self.factor[c])) as f32)
    }
}

/// sRGB of a linear value (IEC 61966-2-1).
fn shown(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
