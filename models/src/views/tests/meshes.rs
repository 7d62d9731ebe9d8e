//! Textured meshes: the same in every format, their colours where they belong, and files that nobody should trust.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::views::Ring;
use crate::views::objects::{Object, Placement, TexturedMesh, View};
use gradreel::{ErrorKind, Key};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::mesh_files::{Model, SIDES, cube, cube_glb, glb, gltf, obj, texture, textured};

const SIZE: usize = 48;
const PLACEMENT: Placement = Placement { scale: 0.5, shift: [0.0; 3] };

/// A folder that goes away with the test.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub fn root(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.root().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }
}

pub fn read(bytes: &[u8], ending: &str) -> TexturedMesh {
    TexturedMesh::from_bytes(bytes, ending, Path::new("nowhere")).unwrap()
}

/// All sixteen views of a mesh.
fn views(mesh: TexturedMesh) -> Vec<View> {
    let object = Object::of_mesh(Arc::new(mesh), 0.3, Key::new(4));
    let ring = Ring::published(16);
    (0..16).map(|view| object.seen(&PLACEMENT, &ring.pose(view), ring.focal, SIZE, 2)).collect()
}

/// Two meshes look the same: silhouettes exactly, colours within two bytes.
#[track_caller]
pub fn assert_same(ours: TexturedMesh, theirs: TexturedMesh) {
    for (view, (ours, theirs)) in views(ours).iter().zip(&views(theirs)).enumerate() {
        assert!(ours.coverage.contains(&1.0), "view {view} shows nothing");
        assert!(ours.coverage == theirs.coverage, "silhouettes of view {view}");
        let far = ours.colours.iter().zip(&theirs.colours).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(far <= 4.01 / 255.0, "view {view}: colours are off by {far}");
    }
}

fn cube_obj(folder: &Folder) -> TexturedMesh {
    folder.write("cube.mtl", "newmtl other\nKd 1 0 0\nnewmtl sides\nKd 1 1 1\nmap_Kd -s 1 1 1 maps/side colours.png\n");
    folder.write("maps/side colours.png", texture(|_, _| 255));
    let path = folder.write("cube.obj", obj(&cube(), "mtllib cube.mtl\nusemtl sides\n"));
    TexturedMesh::read(&path).unwrap()
}

#[test]
fn a_cube_looks_the_same_in_every_format() {
    let folder = Folder::new();
    let in_one = || read(&cube_glb(), "glb");
    assert_eq!(in_one().triangles(), 12);
    assert_same(cube_obj(&folder), in_one());
    // with a buffer and an image beside it
    let png = texture(|_, _| 255);
    let (mut root, bytes) = gltf(&cube(), textured(), None);
    root["buffers"][0]["uri"] = "parts/cube%20data.bin".into();
    root["images"] = json!([{"uri": "side%20colours.png"}]);
    root["textures"] = json!([{"source": 0}]);
    folder.write("parts/cube data.bin", &bytes);
    folder.write("side colours.png", &png);
    let path = folder.write("cube.gltf", root.to_string());
    assert_same(TexturedMesh::read(&path).unwrap(), in_one());
    // with both inside
    let data = |bytes: &[u8]| format!("data:application/octet-stream;base64,{}", crate::report::base64::encode(bytes));
    root["buffers"][0]["uri"] = data(&bytes).into();
    root["images"][0]["uri"] = data(&png).into();
    assert_same(read(root.to_string().as_bytes(), "gltf"), in_one());
}

/// Camera 0 looks from the file's +x, the next ones from −z, −x and +z, all from above; halves above are brighter.
#[test]
fn colours_are_on_the_side_they_were_painted_on() {
    let folder = Folder::new();
    for mesh in [cube_obj(&folder), read(&cube_glb(), "glb")] {
        let object = Object::of_mesh(Arc::new(mesh), 0.0, Key::new(1));
        assert_eq!(object.half(), [0.5; 3]);
        let ring = Ring::published(4);
        for (view, side) in [0, 5, 1, 4].into_iter().enumerate() {
            let pose = ring.pose(view);
            let seen = object.seen(&PLACEMENT, &pose, ring.focal, 96, 1);
            // where a point of the side is in the picture; the file's (x, y, z) is (x, −z, y)
            let colour = |height: f64| {
                let mut place = [0.0, height, 0.0];
                place[side / 2] = if side % 2 == 0 { 0.25 } else { -0.25 };
                let [u, v, _] = ring.project(&pose, [place[0], -place[2], place[1]], 96);
                [0, 1, 2].map(|c| 0.5 + 0.5 * seen.colours[c * 96 * 96 + v as usize * 96 + u as usize])
            };
            let [upper, lower] = [colour(0.12), colour(-0.12)];
            let truth = SIDES[side].map(|c| f32::from(c) / 255.0);
            let light = upper.iter().sum::<f32>() / truth.iter().sum::<f32>();
            assert!((0.4..=1.01).contains(&light), "view {view}: light {light}");
            for c in 0..3 {
                assert!((upper[c] - light * truth[c]).abs() < 0.02, "view {view}: {upper:?} of {truth:?}");
                assert!((lower[c] - 0.5 * upper[c]).abs() < 0.02, "view {view}: {upper:?} above {lower:?}");
            }
        }
        // the upper side is above the others in the picture
        let seen = object.seen(&PLACEMENT, &ring.pose(0), ring.focal, 96, 1);
        let [u, v, _] = ring.project(&ring.pose(0), [0.0, 0.0, 0.25], 96);
        let at = |c: usize| seen.colours[c * 96 * 96 + v as usize * 96 + u as usize];
        assert!(at(2) > at(0) + 0.3 && at(2) > at(1) + 0.3);
    }
}

#[test]
fn colours_of_corners_and_of_materials() {
    let mut plain = cube();
    plain.uvs.clear();
    // linear 0.5, 0.2, 0.05 as they are shown
    let folder = Folder::new();
    folder.write("plain.mtl", "newmtl paint\r\nKd 0.735357 0.484529 0.247801\r\nillum 2\r\n");
    let path = folder.write("plain.obj", obj(&plain, "mtllib plain.mtl\nusemtl paint\n"));
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.2, 0.05, 1.0]}});
    let (root, bytes) = gltf(&plain, material, None);
    assert_same(TexturedMesh::read(&path).unwrap(), read(&glb(&root, &bytes), "glb"));
    // the same on every corner, in place of the material's grey
    let mut painted = plain.clone();
    painted.colours = vec![[0.735_357, 0.484_529, 0.247_801]; 24];
    assert_same(TexturedMesh::read(&path).unwrap(), read(obj(&painted, "").as_bytes(), "obj"));
    painted.colours = vec![[0.5, 0.2, 0.05]; 24];
    let (root, bytes) = gltf(&painted, json!({}), None);
    assert_same(TexturedMesh::read(&path).unwrap(), read(&glb(&root, &bytes), "glb"));
    // and as the older extension has it
    let glossy =
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.5, 0.2, 0.05, 1.0]}}});
    let (root, bytes) = gltf(&plain, glossy, None);
    assert_same(TexturedMesh::read(&path).unwrap(), read(&glb(&root, &bytes), "glb"));
}

/// Nodes in nodes, by translation, turn and scale or by a matrix, against corners that were moved by hand.
#[test]
fn nodes_put_meshes_in_their_place() {
    let (mut root, bytes) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
    let half = 0.5f64.sqrt();
    root["scenes"] = json!([{"nodes": [9]}, {"nodes": [0, 3]}]);
    root["scene"] = 1.into();
    root["nodes"] = json!([
        {"translation": [0.0, 3.0, 1.0], "children": [1, 2]},
        {"mesh": 0, "scale": [0.5, 1.0, 0.25]},
        // a quarter turn about y: x becomes −z
        {"mesh": 0, "rotation": [0.0, half, 0.0, half], "translation": [4.0, 0.0, 0.0], "scale": [2.0, 1.0, 1.0]},
        // mirrored
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -3, 0, 0, 1]},
    ]);
    let whole = cube();
    let mut moved = Model::default();
    for (number, place) in [
        (|[x, y, z]| [0.5 * x, y + 3.0, 0.25 * z + 1.0]) as fn([f32; 3]) -> [f32; 3],
        |[x, y, z]| [z + 4.0, y + 3.0, -2.0 * x + 1.0],
        |[x, y, z]| [-x - 3.0, y, z],
    ]
    .into_iter()
    .enumerate()
    {
        moved.places.extend(whole.places.iter().map(|x| place(*x)));
        moved.uvs.extend(&whole.uvs);
        moved.triangles.extend(whole.triangles.iter().map(|t| t.map(|corner| corner + 24 * number as u16)));
    }
    let (other, other_bytes) = gltf(&moved, textured(), Some(&texture(|_, _| 255)));
    assert_same(read(&glb(&root, &bytes), "glb"), read(&glb(&other, &other_bytes), "glb"));
}

/// The silhouettes of a ball of triangles and of a ball, ray by ray.
#[test]
fn a_ball_of_triangles_has_the_silhouette_of_a_ball() {
    const AROUND: usize = 128;
    let mut text = String::new();
    for row in 0..=AROUND / 2 {
        for column in 0..AROUND {
            let up = std::f64::consts::PI * row as f64 / (AROUND / 2) as f64;
            let about = std::f64::consts::TAU * column as f64 / AROUND as f64;
            let (x, y, z) = (up.sin() * about.cos(), up.cos(), up.sin() * about.sin());
            text += &format!("v {} {} {}\n", 7.0 + 2.0 * x, 2.0 * y - 5.0, 2.0 * z);
        }
    }
    for row in 0..AROUND / 2 {
        for column in 0..AROUND {
            let corner = |row: usize, column: usize| row * AROUND + column % AROUND + 1;
            let next = column + 1;
            text += &format!("f {} {}\\\n {} ", corner(row, column), corner(row, next), corner(row + 1, next));
            // counted from the end, as files may
            text += &format!("{}\n", corner(row + 1, column) as i64 - 1 - ((AROUND / 2 + 1) * AROUND) as i64);
        }
    }
    let object = Object::of_mesh(Arc::new(read(text.as_bytes(), "obj")), 0.0, Key::new(2));
    let ring = Ring::published(16);
    let placement = Placement { scale: 0.6, shift: [0.1, -0.05, 0.08] };
    let (mut all, mut wrong) = (0, 0);
    for view in 0..16 {
        let pose = ring.pose(view);
        let seen = object.seen(&placement, &pose, ring.focal, SIZE, 1);
        // in the camera's axes
        let centre: [f64; 3] = std::array::from_fn(|row| {
            (0..3).map(|axis| pose[row][axis] * placement.shift[axis]).sum::<f64>() + pose[row][3]
        });
        for pixel in 0..SIZE * SIZE {
            let at = |k: usize| ((k as f64 + 0.5) / SIZE as f64 - 0.5) / ring.focal;
            let ray = [at(pixel % SIZE), at(pixel / SIZE), 1.0];
            let [a, b, c] = [(ray, ray), (ray, centre), (centre, centre)]
                .map(|(x, y)| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>());
            let inside = b * b >= a * (c - 0.3 * 0.3);
            all += usize::from(inside);
            wrong += usize::from(inside != (seen.coverage[pixel] == 1.0));
        }
    }
    assert!(all > 4000 && wrong <= 8, "{wrong} rays differ, {all} meet the ball");
}

#[test]
fn what_a_texture_masks_is_not_there() {
    // the upper half of every side is transparent
    let png = texture(|_, row| if row < 8 { 0 } else { 255 });
    let covered = |mode: &str| {
        let mut material = textured();
        material["alphaMode"] = mode.into();
        let (root, bytes) = gltf(&cube(), material, Some(&png));
        let seen = views(read(&glb(&root, &bytes), "glb"));
        seen.iter().flat_map(|view| &view.coverage).sum::<f32>()
    };
    let (whole, masked, blended) = (covered("OPAQUE"), covered("MASK"), covered("BLEND"));
    assert!(masked < 0.95 * whole && masked > 0.4 * whole && masked == blended, "{masked} of {whole}");
}

#[test]
fn what_cannot_be_used_is_refused() {
    let folder = Folder::new();
    let secret = Folder::new();
    let outside = secret.write("secret.png", texture(|_, _| 255));
    let quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\n";
    let head = |name: &str| format!("mtllib {name}\n{quad}usemtl a\nf 1 2 3\n");
    folder.write("outside.mtl", format!("newmtl a\nmap_Kd {}\n", outside.display()));
    folder.write("above.mtl", format!("newmtl a\nmap_Kd maps/../../{}\n", "secret.png"));
    folder.write("windows.mtl", "newmtl a\nmap_Kd C:\\maps\\wood.png\n");
    folder.write("missing.mtl", "newmtl a\nmap_Kd wood.png\n");
    folder.write("text.mtl", "newmtl a\nmap_Kd text.mtl\n");
    folder.write("red.mtl", "newmtl a\nKd red\n");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&outside, folder.root().join("link.png")).unwrap();
        folder.write("link.mtl", "newmtl a\nmap_Kd link.png\n");
    }
    let mut wrong: Vec<(&str, Vec<u8>, Vec<&str>)> = vec![
        ("obj", format!("{quad}f 1 2 99").into(), vec!["line 5", "f 1 2 99", "3 corners"]),
        ("obj", format!("{quad}f 1/1 2/2 3/1").into(), vec!["line 5", "1 texture places"]),
        ("obj", format!("{quad}f 0 1 2").into(), vec!["line 5"]),
        ("obj", format!("{quad}f 1 2").into(), vec!["line 5", "at least three"]),
        ("obj", format!("{quad}f -4 -1 -2").into(), vec!["line 5"]),
        ("obj", "v 0 0\n".into(), vec!["line 1", "v x y z"]),
        ("obj", "v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), vec!["place", "NaN"]),
        ("obj", "v 0 1e999 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), vec!["place", "inf"]),
        ("obj", "v 5 5 5\nv 5 5 5\nv 5 5 5\nf 1 2 3\n".into(), vec!["no faces", "1 triangles"]),
        ("obj", "".into(), vec!["no faces", "0 triangles"]),
        ("obj", head("nowhere.mtl").into(), vec!["materials", "nowhere.mtl"]),
        ("obj", head("../../../etc/passwd").into(), vec!["folder of the mesh", "../../../etc/passwd"]),
        ("obj", head("outside.mtl").into(), vec!["folder of the mesh", "secret.png"]),
        ("obj", head("above.mtl").into(), vec!["folder of the mesh", "secret.png"]),
        ("obj", head("windows.mtl").into(), vec!["folder of the mesh", "wood.png"]),
        ("obj", head("missing.mtl").into(), vec!["texture", "wood.png", "large and small letters"]),
        ("obj", head("text.mtl").into(), vec!["PNG or JPEG", "text.mtl"]),
        ("obj", head("red.mtl").into(), vec!["red.mtl: line 2", "Kd red"]),
        ("obj", head("missing.mtl").replace("usemtl a", "usemtl b").into(), vec!["usemtl b"]),
        ("glb", b"glTF".into(), vec!["cut short"]),
        ("glb", b"glTF\x01\0\0\0\x0c\0\0\0".into(), vec!["version"]),
        ("gltf", "{".into(), vec!["glTF 2.0"]),
        ("gltf", "{}".into(), vec!["no faces"]),
        ("gltf", format!("{{\"nodes\": [{}{{}}]}}", "{},".repeat(1 << 18)).into(), vec!["262144 entries"]),
        ("obj", "v 0 0 0\n".repeat(6_000_003).into(), vec!["too many triangles"]),
        ("stl", "".into(), vec![".stl", ".glb"]),
    ];
    #[cfg(unix)]
    wrong.push(("obj", head("link.mtl").into(), vec!["folder of the mesh", "link"]));
    let changes: [(&str, Value, &str); 18] = [
        ("/meshes/0/primitives/0/attributes/POSITION", 77.into(), "accessor 77"),
        ("/meshes/0/primitives/0/material", 5.into(), "material 5"),
        ("/materials/0/pbrMetallicRoughness/baseColorTexture/index", 3.into(), "texture 3"),
        ("/accessors/0/count", 1_000_000_000_000u64.into(), "accessor 0"),
        ("/accessors/0/count", 25.into(), "accessor 0"),
        ("/accessors/0/count", 23.into(), "places in the texture"),
        ("/accessors/0/type", "VEC2".into(), "places"),
        ("/accessors/0/componentType", 5130.into(), "5130"),
        ("/accessors/0/sparse", json!({"count": 1}), "indices"),
        ("/accessors/2/componentType", 5126.into(), "accessor 2"),
        ("/bufferViews/0/byteStride", u64::MAX.into(), "accessor 0"),
        ("/bufferViews/0/byteOffset", u64::MAX.into(), "buffer view 0"),
        ("/buffers/0/byteLength", 1_000_000_000.into(), "buffer 0"),
        ("/buffers/0/uri", "../../etc/passwd".into(), "folder of the mesh"),
        ("/buffers/0/uri", "data:text/plain,abc".into(), "data:"),
        ("/nodes/0/children", json!([0]), "no tree"),
        ("/scenes/0/nodes", json!([4]), "node 4"),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), "KHR_draco_mesh_compression"),
    ];
    for (place, value, part) in changes {
        let (mut root, bytes) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
        let (parent, last) = place.rsplit_once('/').unwrap();
        let parent = if parent.is_empty() { &mut root } else { root.pointer_mut(parent).unwrap() };
        match parent {
            Value::Array(list) => list[last.parse::<usize>().unwrap()] = value,
            parent => parent[last] = value,
        }
        wrong.push(("glb", glb(&root, &bytes), vec![part]));
    }
    for (ending, bytes, parts) in wrong {
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).into_owned();
        let path = folder.write(&format!("wrong.{ending}"), &bytes);
        let error = TexturedMesh::read(&path).err().unwrap_or_else(|| panic!("{parts:?} is accepted: {shown}"));
        let told = error.to_string();
        assert_eq!(error.kind(), ErrorKind::Input, "{told}");
        for part in parts.iter().chain(&["wrong.", "fix: "]) {
            assert!(told.contains(part), "no {part:?} in {told}\n{shown}");
        }
    }
}

/// Files cut at every length, and with bytes changed: an error or a mesh, never a panic.
#[test]
fn damaged_files_are_errors() {
    let folder = Folder::new();
    cube_obj(&folder);
    let text = fs::read(folder.root().join("cube.obj")).unwrap();
    let binary = cube_glb();
    for (bytes, ending) in [(&text, "obj"), (&binary, "glb")] {
        let try_to_read = |bytes: &[u8]| {
            if let Err(error) = TexturedMesh::from_bytes(bytes, ending, folder.root()) {
                assert_eq!(error.kind(), ErrorKind::Input, "{error}");
            }
        };
        for length in 0..bytes.len() {
            try_to_read(&bytes[..length]);
        }
        if ending == "glb" {
            let short = |length: usize| TexturedMesh::from_bytes(&bytes[..length], ending, folder.root()).is_err();
            assert!((0..bytes.len()).all(short), "every byte counts");
        }
        for place in 0..bytes.len() {
            for byte in [0, 0xff, bytes[place] ^ 1, bytes[place].wrapping_add(1), b'9', b'-', b'\n'] {
                let mut changed = bytes.clone();
                changed[place] = byte;
                try_to_read(&changed);
            }
        }
    }
}
