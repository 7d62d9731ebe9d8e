//! Textured meshes as files, made by the tests: the same cube as OBJ with MTL and PNG, as GLB and as glTF with files beside it.

use serde_json::{Value, json};

/// Colours of the cube's sides +x, −x, +y, −y, +z, −z in the file's axes (y up); their lower halves are half as bright.
pub const SIDES: [[u8; 3]; 6] =
    [[220, 20, 20], [20, 180, 20], [20, 20, 220], [200, 180, 20], [180, 20, 180], [20, 160, 180]];

/// Corners with their places in the texture (v downwards), and triangles.
#[derive(Clone, Default)]
pub struct Model {
    pub places: Vec<[f32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub colours: Vec<[f32; 3]>,
    pub triangles: Vec<[u16; 3]>,
}

/// A cube from −1 to 1, each side with a column of the texture for itself, its top upwards.
pub fn cube() -> Model {
    let mut model = Model::default();
    for side in 0..6 {
        let (axis, sign) = (side / 2, if side % 2 == 0 { 1.0 } else { -1.0 });
        let up = if axis == 1 { 2 } else { 1 };
        let right = 3 - axis - up;
        for [across, height] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0f32]] {
            let mut place = [0.0; 3];
            (place[axis], place[right], place[up]) = (sign, across, height);
            model.places.push(place);
            model.uvs.push([(side as f32 + 0.5 + 0.4 * across) / 6.0, 0.5 - 0.5 * height]);
        }
        let first = 4 * side as u16;
        model.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    model
}

/// The texture of [`cube`] as PNG: 48 × 16 pixels.
pub fn texture(alpha: impl Fn(usize, usize) -> u8) -> Vec<u8> {
    let pixel = |i: usize| {
        let (column, row) = (i % 48, i / 48);
        let [r, g, b] = SIDES[column / 8].map(|c| if row < 8 { c } else { c / 2 });
        [r, g, b, alpha(column, row)]
    };
    let pixels: Vec<[u8; 4]> = (0..48 * 16).map(pixel).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 48, 16);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(pixels.as_flattened()).unwrap();
    bytes
}

/// The model as OBJ, `head` before its faces.
pub fn obj(model: &Model, head: &str) -> String {
    let mut text = String::from("# a model\n");
    for (i, [x, y, z]) in model.places.iter().enumerate() {
        text += &format!("v {x} {y} {z}");
        if let Some([r, g, b]) = model.colours.get(i) {
            text += &format!(" {r} {g} {b}");
        }
        text += "\n";
    }
    model.uvs.iter().for_each(|[u, v]| text += &format!("vt {u} {}\n", 1.0 - v));
    text += head;
    let textured = !model.uvs.is_empty();
    for triangle in &model.triangles {
        let corner = |c: &u16| if textured { format!("{0}/{0}", c + 1) } else { format!("{}", c + 1) };
        text += &format!("f {}\n", triangle.iter().map(corner).collect::<Vec<_>>().join(" "));
    }
    text
}

/// The model as the JSON and the bytes of a glTF file, with this material; `png` becomes image 0.
pub fn gltf(model: &Model, material: Value, png: Option<&[u8]>) -> (Value, Vec<u8>) {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |data: Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        views.len() - 1
    };
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut attributes = serde_json::Map::new();
    for (name, kind, data) in [
        ("POSITION", "VEC3", floats(model.places.as_flattened())),
        ("TEXCOORD_0", "VEC2", floats(model.uvs.as_flattened())),
        ("COLOR_0", "VEC3", floats(model.colours.as_flattened())),
    ] {
        if !data.is_empty() {
            attributes.insert(name.into(), accessors.len().into());
            let view = add(data);
            accessors
                .push(json!({"bufferView": view, "componentType": 5126, "type": kind, "count": model.places.len()}));
        }
    }
    let order = model.triangles.as_flattened();
    let indices = accessors.len();
    let view = add(order.iter().flat_map(|c| c.to_le_bytes()).collect());
    accessors.push(json!({"bufferView": view, "componentType": 5123, "type": "SCALAR", "count": order.len()}));
    let images: Vec<Value> =
        png.map(|png| json!({"bufferView": add(png.to_vec()), "mimeType": "image/png"})).into_iter().collect();
    let textures: Vec<Value> = images.iter().map(|_| json!({"source": 0})).collect();
    let root = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [material],
        "textures": textures,
        "images": images,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": bytes.len()}],
    });
    (root, bytes)
}

/// A glTF file in one.
pub fn glb(root: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = b"glTF".to_vec();
    bytes.extend([2, length as u32, json.len() as u32].map(u32::to_le_bytes).as_flattened());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// The material of the cube: its texture.
pub fn textured() -> Value {
    json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
}

/// The textured cube in one file.
pub fn cube_glb() -> Vec<u8> {
    let (root, bytes) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
    glb(&root, &bytes)
}
