//! Meshes and particles.

use std::fs;

use gradreel_models::scenes::{Mesh, positions_of};
use gradreel_models::views::objects::TexturedMesh;
use serde_json::json;

use crate::harness::fuzz;
use crate::mesh_files::{cube, cube_glb, glb, gltf, obj, texture, textured};
use crate::mutate::TEXTS;

const CORNERS: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

/// A tetrahedron as OBJ.
fn tetrahedron() -> Vec<u8> {
    let corners = CORNERS.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces = FACES.iter().map(|[a, b, c]| format!("f {} {}/1 -{}\n", a + 1, b + 1, 4 - c));
    ["# a body\no body\nvt 0 0\nvn 0 0 1\n".to_owned()]
        .into_iter()
        .chain(corners)
        .chain(faces)
        .collect::<String>()
        .into()
}

fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment a body\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    if format == "ascii" {
        CORNERS.iter().for_each(|[x, y, z]| bytes.extend(format!("{x} {y} {z}\n").bytes()));
        FACES.iter().for_each(|[a, b, c]| bytes.extend(format!("3 {a} {b} {c}\n").bytes()));
    } else {
        let little = format == "binary_little_endian";
        let number = |bits: u32| if little { bits.to_le_bytes() } else { bits.to_be_bytes() };
        CORNERS.as_flattened().iter().for_each(|x| bytes.extend(number(x.to_bits())));
        for face in FACES {
            bytes.push(3);
            face.iter().for_each(|corner| bytes.extend(number(*corner)));
        }
    }
    bytes
}

fn stl(ascii: bool) -> Vec<u8> {
    let corners = FACES.map(|face| face.map(|corner| CORNERS[corner as usize]));
    if ascii {
        let facet = |face: &[[f32; 3]; 3]| {
            let corners: String = face.iter().map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).collect();
            format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
        };
        return format!("solid body\n{}endsolid body\n", corners.iter().map(facet).collect::<String>()).into();
    }
    let mut bytes = vec![b' '; 80];
    bytes.extend(4u32.to_le_bytes());
    for face in corners {
        bytes.extend([0; 12]);
        face.as_flattened().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn closed_meshes() {
    let files = [("obj", vec![tetrahedron()]), ("stl", vec![stl(true), stl(false)])];
    for (ending, seeds) in &files {
        fuzz(ending, seeds, &TEXTS, |bytes| Mesh::from_bytes(bytes, ending).is_ok());
    }
    let seeds = ["ascii", "binary_little_endian", "binary_big_endian"].map(ply);
    fuzz("ply", &seeds, &TEXTS, |bytes| {
        drop(positions_of(bytes));
        Mesh::from_bytes(bytes, "ply").is_ok()
    });
}

#[test]
fn particles() {
    let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
    let list = format!("{head}0 0.5 0\n1 2 3\n").into_bytes();
    let array = gradreel::Tensor::from_vec(vec![0.0f32, 0.5, 0.0, 1.0, 2.0, 3.0], [2, 3]);
    let seeds = [list, gradreel::io::npy::to_bytes(&array).unwrap()];
    fuzz("particles", &seeds, &TEXTS, |bytes| positions_of(bytes).is_ok());
}

#[test]
fn textured_meshes() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cube.png"), texture(|_, _| 255)).unwrap();
    let material = "newmtl skin\nKd 0.5 0.6 0.7\nd 1.0\nmap_Kd cube.png\nnewmtl other\nKd 1 0 0\n";
    fs::write(folder.path().join("cube.mtl"), material).unwrap();
    let body = obj(&cube(), "mtllib cube.mtl\nusemtl skin\n");
    let read = |bytes: &[u8], ending: &str| TexturedMesh::from_bytes(bytes, ending, folder.path()).is_ok();
    fuzz("textured-obj", &[body.clone().into_bytes()], &TEXTS, |bytes| read(bytes, "obj"));
    fuzz("mtl", &[material.as_bytes().to_vec()], &TEXTS, |bytes| {
        fs::write(folder.path().join("cube.mtl"), bytes).unwrap();
        read(body.as_bytes(), "obj")
    });

    let (mut root, binary) = gltf(&cube(), json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}), None);
    let plain = glb(&root, &binary);
    fuzz("glb", &[cube_glb(), plain], &TEXTS, |bytes| read(bytes, "glb"));
    fs::write(folder.path().join("cube.bin"), &binary).unwrap();
    root["buffers"][0]["uri"] = "cube.bin".into();
    let beside = root.to_string();
    let (mut root, binary) = gltf(&cube(), textured(), Some(&texture(|_, _| 255)));
    fs::write(folder.path().join("textured.bin"), &binary).unwrap();
    root["buffers"][0]["uri"] = "textured.bin".into();
    let seeds = [beside.into_bytes(), root.to_string().into_bytes()];
    fuzz("gltf", &seeds, &TEXTS, |bytes| read(bytes, "gltf"));
}
