//! The parts of a glTF file's JSON that affect appearance (Khronos glTF 2.0). Names are those of the format.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::whole;

/// Maximum length of a list: an entry of three bytes in JSON may take fifty times that memory.
const MOST: usize = 1 << 18;

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Root {
    pub extensions_required: Vec<String>,
    #[serde(deserialize_with = "whole::maybe")]
    pub scene: Option<usize>,
    #[serde(deserialize_with = "list")]
    pub scenes: Vec<Scene>,
    #[serde(deserialize_with = "list")]
    pub nodes: Vec<Node>,
    #[serde(deserialize_with = "list")]
    pub meshes: Vec<Mesh>,
    #[serde(deserialize_with = "list")]
    pub materials: Vec<Material>,
    #[serde(deserialize_with = "list")]
    pub textures: Vec<Texture>,
    #[serde(deserialize_with = "list")]
    pub samplers: Vec<Sampler>,
    #[serde(deserialize_with = "list")]
    pub images: Vec<Image>,
    #[serde(deserialize_with = "list")]
    pub accessors: Vec<Accessor>,
    #[serde(deserialize_with = "list")]
    pub buffer_views: Vec<BufferView>,
    #[serde(deserialize_with = "list")]
    pub buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    #[serde(deserialize_with = "whole::many")]
    pub nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    #[serde(deserialize_with = "whole::many")]
    pub children: Vec<usize>,
    #[serde(deserialize_with = "whole::maybe")]
    pub mesh: Option<usize>,
    /// Column-major.
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    /// x, y, z, w
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    #[serde(deserialize_with = "whole::named")]
    pub attributes: std::collections::BTreeMap<String, usize>,
    #[serde(default, deserialize_with = "whole::maybe")]
    pub indices: Option<usize>,
    #[serde(default, deserialize_with = "whole::maybe")]
    pub material: Option<usize>,
    #[serde(default = "triangles", deserialize_with = "whole::one")]
    pub mode: u32,
}

/// Separate triangles; 5 is a strip and 6 a fan.
fn triangles() -> u32 {
    4
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Material {
    pub pbr_metallic_roughness: BaseColour,
    pub alpha_mode: Option<String>,
    pub alpha_cutoff: Option<f32>,
    pub extensions: MaterialExtensions,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct BaseColour {
    /// Linear.
    #[serde(rename = "baseColorFactor", alias = "diffuseFactor")]
    pub factor: Option<[f32; 4]>,
    #[serde(rename = "baseColorTexture", alias = "diffuseTexture")]
    pub texture: Option<TextureInfo>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub specular_glossiness: Option<BaseColour>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    #[serde(deserialize_with = "whole::one")]
    pub index: usize,
    #[serde(default, deserialize_with = "whole::one")]
    pub tex_coord: usize,
    #[serde(default)]
    pub extensions: TextureExtensions,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct TextureExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

/// `uv' = offset + turn · scale · uv`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub offset: [f64; 2],
    /// Radians.
    pub rotation: f64,
    pub scale: Option<[f64; 2]>,
    #[serde(deserialize_with = "whole::maybe")]
    pub tex_coord: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Texture {
    #[serde(deserialize_with = "whole::maybe")]
    pub sampler: Option<usize>,
    #[serde(deserialize_with = "whole::maybe")]
    pub source: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sampler {
    #[serde(deserialize_with = "whole::maybe")]
    pub wrap_s: Option<u32>,
    #[serde(deserialize_with = "whole::maybe")]
    pub wrap_t: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Image {
    pub uri: Option<String>,
    #[serde(deserialize_with = "whole::maybe")]
    pub buffer_view: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    #[serde(default, deserialize_with = "whole::maybe")]
    pub buffer_view: Option<usize>,
    #[serde(default, deserialize_with = "whole::one")]
    pub byte_offset: usize,
    #[serde(deserialize_with = "whole::one")]
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    #[serde(deserialize_with = "whole::one")]
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Sparse>,
}

/// Values that replace some of an accessor's values, or zeros.
#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    #[serde(deserialize_with = "whole::one")]
    pub count: usize,
    pub indices: Part,
    pub values: Part,
}

/// Values in a buffer view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Part {
    #[serde(deserialize_with = "whole::one")]
    pub buffer_view: usize,
    #[serde(default, deserialize_with = "whole::one")]
    pub byte_offset: usize,
    /// Defaults to that of the accessor.
    #[serde(default, deserialize_with = "whole::maybe")]
    pub component_type: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    #[serde(deserialize_with = "whole::one")]
    pub buffer: usize,
    #[serde(default, deserialize_with = "whole::one")]
    pub byte_offset: usize,
    #[serde(deserialize_with = "whole::one")]
    pub byte_length: usize,
    #[serde(default, deserialize_with = "whole::maybe")]
    pub byte_stride: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    #[serde(deserialize_with = "whole::one")]
    pub byte_length: usize,
}

/// A list of limited length.
fn list<'de, D: Deserializer<'de>, T: Deserialize<'de>>(json: D) -> Result<Vec<T>, D::Error> {
    struct List<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for List<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of at most {MOST} entries")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
            let mut found = Vec::new();
            while let Some(entry) = entries.next_element()? {
                if found.len() == MOST {
                    return Err(A::Error::invalid_length(MOST + 1, &self));
                }
                found.push(entry);
            }
            Ok(found)
        }
    }
    json.deserialize_seq(List(PhantomData))
}
