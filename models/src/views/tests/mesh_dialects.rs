//! Textured meshes as different programs write them: the same object each time, or an error that says what is wrong.

use std::fs;

use crate::report::base64;
use crate::views::objects::{FolderSettings, MeshFolder, TexturedMesh};
use gradreel::ErrorKind;
use serde_json::{Value, json};

use super::mesh_files::{Model, cube, cube_glb, glb, gltf, obj, texture, textured};
use super::meshes::{Folder, assert_same, read};

/// A cube without a texture.
fn plain() -> Model {
    Model { uvs: Vec::new(), ..cube() }
}

fn read_file(folder: &Folder, text: impl AsRef<[u8]>) -> TexturedMesh {
    TexturedMesh::read(&folder.write("cube.obj", text)).unwrap_or_else(|e| panic!("{e}"))
}

/// A cube in one colour of a file of materials.
fn painted(materials: impl AsRef<[u8]>, head: &str) -> TexturedMesh {
    let folder = Folder::new();
    folder.write("paint.mtl", materials);
    read_file(&folder, obj(&plain(), head))
}

#[test]
fn every_dialect_of_obj_is_the_same_cube() {
    let text = obj(&cube(), "");
    let same = |bytes: &[u8]| {
        let mesh = read(bytes, "obj");
        assert_eq!(mesh.triangles(), 12);
        assert_same(mesh, read(text.as_bytes(), "obj"));
    };
    same(format!("\u{feff}{text}").as_bytes());
    same(text.replace('\n', " # of the cube\n").as_bytes());
    same(text.replace('\n', "\r\n").as_bytes());
    same(text.replace('\n', "\r").as_bytes());
    same(text.lines().map(|line| line.replacen(' ', " \\\r\n", 1) + "\r\n").collect::<String>().as_bytes());
    same(&[&b"o Geh\xe4use\ng\ns 1\nusemtl\n"[..], text.as_bytes()].concat());
    // Without a library materials are grey, and without a material a library is not needed.
    same(obj(&cube(), "usemtl anything\n").as_bytes());
    same(obj(&cube(), "mtllib nowhere.mtl\nusemtl\n").as_bytes());
    same(obj(&cube(), "mtllib\nusemtl # none\n").as_bytes());
}

#[test]
fn every_dialect_of_materials_is_the_same_colour() {
    let head = "mtllib paint.mtl\nusemtl red\n";
    let materials = "newmtl blue\nKd 0 0 1\nnewmtl red\nKd 1 0 0\n";
    let wanted = || painted(materials, head);
    let same = |materials: &[u8], head: &str| assert_same(painted(materials, head), wanted());
    same("\u{feff}newmtl red\nKd 1 0 0".as_bytes(), head);
    same(materials.replace("0\n", "0 # red or not\n").as_bytes(), head);
    same(materials.replace('\n', "\r").as_bytes(), head);
    same(materials.replace("Kd ", "Kd \\\n").as_bytes(), head);
    same(materials.as_bytes(), "mtllib paint.mtl # all of them\nusemtl red # as a rose\n");
    same(materials.replace("red", "red # as a rose").as_bytes(), head);
    // A `#` may belong to a name: the whole name comes first.
    let hash = materials.replace("blue", "paint #1").replace("red", "paint #2");
    same(hash.as_bytes(), "mtllib paint.mtl\nusemtl paint #2\n");
    // Without a name, none from there on.
    let folder = Folder::new();
    folder.write("paint.mtl", materials);
    for none in ["usemtl", "usemtl # none"] {
        let both = read_file(&folder, obj(&plain(), &format!("mtllib paint.mtl\nusemtl red\n{none}\n")));
        assert_same(both, read(obj(&plain(), "").as_bytes(), "obj"));
    }
    // A name in Latin-1 in one file is the same in UTF-8 in another.
    let latin = |text: &str| -> Vec<u8> { text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect() };
    same(&latin(&materials.replace("red", "röt")), "mtllib paint.mtl\nusemtl röt\n");
    folder.write("gemälde.mtl", materials);
    assert_same(read_file(&folder, latin(&obj(&plain(), "mtllib gemälde.mtl\nusemtl red\n"))), wanted());
}

#[test]
fn a_picture_of_any_name_is_found() {
    let folder = Folder::new();
    folder.write("sides #1.png", texture(|_, _| 255));
    folder.write("sides.png", texture(|_, _| 255));
    for line in ["map_Kd sides #1.png", "map_Kd sides.png # of six", "map_kd sides.png", "\u{feff}map_Kd sides.png"] {
        let (mark, line) = line.strip_prefix('\u{feff}').map_or(("", line), |line| ("\u{feff}", line));
        folder.write("cube.mtl", format!("{mark}newmtl a\n{line}\n"));
        assert_same(read_file(&folder, obj(&cube(), "mtllib cube.mtl\nusemtl a\n")), read(&cube_glb(), "glb"));
    }
}

/// The cube as glTF, changed.
fn changed(change: impl FnOnce(&mut Value, &mut Vec<u8>)) -> Vec<u8> {
    let (mut root, mut bytes) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
    change(&mut root, &mut bytes);
    glb(&root, &bytes)
}

/// All numbers of a JSON as floats.
fn floats(value: &mut Value) {
    match value {
        Value::Number(number) => *value = json!(number.as_f64().unwrap()),
        Value::Array(list) => list.iter_mut().for_each(floats),
        Value::Object(map) => map.values_mut().for_each(floats),
        _ => {}
    }
}

#[test]
fn every_dialect_of_gltf_is_the_same_cube() {
    let same = |what: &str, bytes: &[u8]| {
        let mesh = TexturedMesh::from_bytes(bytes, "glb", "nowhere".as_ref());
        let mesh = mesh.unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(mesh.triangles(), 12, "{what}");
        assert_same(mesh, read(&cube_glb(), "glb"));
    };
    for length in [1, 4, 8, 12, 4096] {
        same("bytes behind the end", &[cube_glb(), b"JUNK".repeat(length)[..length].to_vec()].concat());
    }
    let whole = changed(|root, _| {
        floats(root);
        root["meshes"][0]["primitives"][0]["mode"] = json!(4.0);
        root["accessors"][0]["byteOffset"] = json!(0.0);
    });
    assert!(String::from_utf8_lossy(&whole).contains("\"count\":36.0"));
    same("36.0 as a count", &whole);
    // Filled up with zeros instead of blanks.
    let mut filled = cube_glb();
    let end = 20 + u32::from_le_bytes(filled[12..16].try_into().unwrap()) as usize;
    let blanks = filled[..end].iter().rev().take_while(|byte| **byte == b' ').count();
    filled[end - blanks..end].fill(0);
    same("zeros behind the JSON", &filled);

    let (mut root, bytes) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
    let text = base64::encode(&bytes);
    for start in ["data:application/octet-stream;base64,", "data:application/gltf-buffer;base64,", "data:;base64,"] {
        root["buffers"][0]["uri"] = format!("{start}{text}").into();
        same(start, root.to_string().as_bytes());
    }
    root["buffers"][0]["uri"] = format!("data:;base64,{}", text.replace('=', "%3D").replace('/', "%2F")).into();
    same("a URI with codes", root.to_string().as_bytes());
    root["buffers"][0]["uri"] = format!("data:;base64,{}\r\n {}", &text[..40], &text[40..]).into();
    same("lines in a URI", root.to_string().as_bytes());
    same("byte order mark", format!("\u{feff}{root}").as_bytes());
}

/// Adds an accessor's sparse numbers.
fn make_sparse(root: &mut Value, bytes: &mut Vec<u8>, indices: &[u8], kind: u32, values: &[f32]) {
    let mut view = |data: &[u8]| {
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        let views = root["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
        let number = views.len() - 1;
        bytes.extend(data);
        root["buffers"][0]["byteLength"] = bytes.len().into();
        number
    };
    let values: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    let (indices_at, values_at) = (view(indices), view(&values));
    root["accessors"][0]["sparse"] = json!({
        "count": values.len() / 12,
        "indices": {"bufferView": indices_at, "componentType": kind},
        "values": {"bufferView": values_at, "byteOffset": 0},
    });
}

#[test]
fn sparse_numbers_take_the_place_of_others() {
    let moved = |corner: usize| cube().places[corner].map(|x| 3.0 * x);
    let mut by_hand = cube();
    [2, 7].into_iter().for_each(|corner| by_hand.places[corner] = moved(corner));
    let (root, bytes) = gltf(&by_hand, textured(), Some(&texture(|_, _| 255)));
    let wanted = glb(&root, &bytes);
    let values = [moved(2), moved(7)].concat();
    for (indices, kind) in [(&[2, 7][..], 5121), (&[2, 0, 7, 0][..], 5123), (&[2, 0, 0, 0, 7, 0, 0, 0][..], 5125)] {
        let found = changed(|root, bytes| make_sparse(root, bytes, indices, kind, &values));
        assert_same(read(&found, "glb"), read(&wanted, "glb"));
    }
    // All places, in that of zeros that no view holds.
    let all: Vec<u8> = (0..24).collect();
    let found = changed(|root, bytes| {
        root["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        make_sparse(root, bytes, &all, 5121, by_hand.places.as_flattened());
    });
    assert_same(read(&found, "glb"), read(&wanted, "glb"));
}

#[test]
fn what_is_wrong_in_a_gltf_is_named() {
    let values = [0.0; 6];
    let refused = |bytes: &[u8], parts: &[&str]| {
        let error =
            TexturedMesh::from_bytes(bytes, "glb", "nowhere".as_ref()).err().unwrap_or_else(|| panic!("{parts:?}"));
        assert_eq!(error.kind(), ErrorKind::Input);
        parts.iter().for_each(|part| assert!(error.to_string().contains(part), "no {part:?} in {error}"));
    };
    refused(&changed(|root, bytes| make_sparse(root, bytes, &[2, 24], 5121, &values)), &["accessor 0", "24"]);
    refused(&changed(|root, bytes| make_sparse(root, bytes, &[2], 5121, &values)), &["accessor 0", "bytes"]);
    refused(&changed(|root, bytes| make_sparse(root, bytes, &[2, 3], 5127, &values)), &["5127"]);
    let many = changed(|root, bytes| {
        make_sparse(root, bytes, &[2, 3], 5121, &values);
        root["accessors"][0]["sparse"]["count"] = 25.into();
    });
    refused(&many, &["25 sparse elements"]);
    refused(&changed(|root, _| root["accessors"][0]["bufferView"] = Value::Null), &["accessor 0", "no buffer view"]);
    let zeros = changed(|root, bytes| {
        root["accessors"][0]["bufferView"] = Value::Null;
        make_sparse(root, bytes, &[2, 3], 5121, &values);
        root["accessors"][0]["count"] = 6_000_000.into();
    });
    refused(&zeros, &["6000000 zeros"]);
    refused(&changed(|root, _| root["bufferViews"][0]["byteStride"] = 0.into()), &["accessor 0", "0 bytes apart"]);
    for number in [json!(36.5), json!(-36), json!(-36.0), json!("36"), json!(1e300)] {
        refused(&changed(|root, _| root["accessors"][2]["count"] = number), &["a whole number, not below 0"]);
    }
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"] {
        refused(&changed(|root, _| root["extensionsRequired"] = json!([name])), &[name, "extension"]);
    }
    // The announced length ends within a part.
    let mut short = cube_glb();
    let length = short.len() as u32 - 4;
    short[8..12].copy_from_slice(&length.to_le_bytes());
    refused(&short, &["cut short", &length.to_string()]);
}

#[cfg(unix)]
#[test]
fn files_without_end_are_refused() {
    let folder = Folder::new();
    for name in ["endless.obj", "endless.glb", "endless.mtl"] {
        std::os::unix::fs::symlink("/dev/zero", folder.root().join(name)).unwrap();
    }
    for name in ["endless.obj", "endless.glb"] {
        let error = TexturedMesh::read(&folder.root().join(name)).err().unwrap();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains("no file"), "{error}");
    }
    let path = folder.write("cube.obj", obj(&cube(), "mtllib endless.mtl\nusemtl a\n"));
    let error = TexturedMesh::read(&path).err().unwrap();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("endless.mtl"), "{error}");
}

#[test]
fn a_file_in_the_place_of_a_folder_is_refused() {
    let folder = Folder::new();
    let path = folder.write("cube.glb", cube_glb());
    let error = MeshFolder::open(&path, FolderSettings::default(), &|| ()).err().unwrap();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("cube.glb"), "{error}");
    fs::remove_file(&path).unwrap();
    let error = MeshFolder::open(&path, FolderSettings::default(), &|| ()).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Input);
}
