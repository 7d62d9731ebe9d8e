//! Meshes: the same body in every format, and files that are damaged or not closed.

use std::path::Path;

use gradreel_models::scenes::{Mesh, Shape, fill, positions_of};

const OCTAHEDRON: &str = include_str!("../../../examples/scenes/octahedron.obj");

/// Corners and faces of the octahedron.
fn corners() -> (Vec<[f32; 3]>, Vec<[usize; 3]>) {
    let numbers = |line: &str| line.split_whitespace().skip(1).map(|w| w.parse().unwrap()).collect::<Vec<f32>>();
    let of = |kind: &str| OCTAHEDRON.lines().filter(|l| l.starts_with(kind)).map(numbers).collect::<Vec<_>>();
    let faces = of("f ").iter().map(|f| [0, 1, 2].map(|k| f[k] as usize - 1)).collect();
    (of("v ").iter().map(|v| [v[0], v[1], v[2]]).collect(), faces)
}

fn binary_stl() -> Vec<u8> {
    let (vertices, faces) = corners();
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, 0);
    bytes.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|&v| vertices[v]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ascii_stl() -> Vec<u8> {
    let (vertices, faces) = corners();
    let mut text = "solid octahedron\n".to_owned();
    for face in faces {
        text += "facet normal 0 0 0\nouter loop\n";
        for v in face {
            let [x, y, z] = vertices[v];
            text += &format!("vertex {x:e} {y:e} {z:e}\n");
        }
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid octahedron\n").into_bytes()
}

fn ascii_ply() -> Vec<u8> {
    let (vertices, faces) = corners();
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment x\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    vertices.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z} 255\n"));
    faces.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text.into_bytes()
}

fn binary_ply(big: bool) -> Vec<u8> {
    let (vertices, faces) = corners();
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_index\nend_header\n",
        vertices.len(),
        faces.len()
    )
    .into_bytes();
    let number = |x: f32| if big { f64::from(x).to_be_bytes() } else { f64::from(x).to_le_bytes() };
    vertices.iter().flatten().for_each(|&x| bytes.extend(number(x)));
    for face in faces {
        bytes.push(3);
        let index = |v: usize| if big { (v as i32).to_be_bytes() } else { (v as i32).to_le_bytes() };
        face.iter().for_each(|&v| bytes.extend(index(v)));
    }
    bytes
}

fn files() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("obj", OCTAHEDRON.as_bytes().to_vec()),
        ("stl", binary_stl()),
        ("stl", ascii_stl()),
        ("ply", ascii_ply()),
        ("ply", binary_ply(false)),
        ("ply", binary_ply(true)),
    ]
}

#[test]
fn every_format_holds_the_same_body() {
    for (ending, bytes) in files() {
        let mesh = Mesh::from_bytes(&bytes, ending).unwrap();
        approx::assert_relative_eq!(mesh.volume(), 4.0 / 3.0, max_relative = 1e-12);
        assert_eq!(mesh.bounds(), [[-1.0; 3], [1.0; 3]]);
    }
}

#[test]
fn a_mesh_is_filled_to_its_volume_also_through_corners_and_edges() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/scenes/octahedron.obj");
    let filled = |spacing: f64, scale: f64| {
        let shape = Shape::Mesh { file: file.clone(), scale, translate_m: [0.1, 0.2, 0.3] };
        fill(&shape, spacing, 0, Path::new(".")).unwrap()
    };
    // An odd count along each axis: the lines of the grid pass exactly through corners and edges.
    for cells in [21.0, 20.0] {
        let spacing = 2.0 / cells;
        let volume = filled(spacing, 1.0).len() as f64 * spacing.powi(3);
        approx::assert_relative_eq!(volume, 4.0 / 3.0, max_relative = 0.04);
    }
    // Faces that look inwards enclose the same; mirrored in one axis.
    let mirrored = OCTAHEDRON.replace("v 1 0 0", "v 9 0 0").replace("v -1 0 0", "v 1 0 0").replace("v 9", "v -1");
    let mesh = Mesh::from_bytes(mirrored.as_bytes(), "obj").unwrap();
    assert!(mesh.volume() < 0.0);
    assert_eq!(mesh.crossings(0.1, 0.1, &(0..8).collect::<Vec<_>>()).len(), 2);
    assert_eq!(mesh.crossings(0.0, 0.0, &(0..8).collect::<Vec<_>>()).len(), 2);
}

#[test]
fn holes_and_faces_that_look_different_ways_are_named() {
    let refused = |text: &str| Mesh::from_bytes(text.as_bytes(), "obj").unwrap_err().to_string();
    let holed = refused(&OCTAHEDRON.replace("f 4 5 2\n", ""));
    assert!(holed.contains("the mesh has holes") && holed.contains("3 open edges"), "{holed}");
    let flipped = refused(&OCTAHEDRON.replace("f 4 5 2", "f 4 2 5"));
    assert!(flipped.contains("look different ways"), "{flipped}");
    assert!(refused("v 0 0 0\n").contains("no faces"));
    assert!(refused(&OCTAHEDRON.replace("f 4 5 2", "f 4 5 7")).contains("line 15"));
    assert!(refused(&OCTAHEDRON.replace("v 0 1 0", "v 0 nan 0")).contains("no place"));
    assert!(refused(&OCTAHEDRON.replace("v 0 1 0", "v 0 1")).contains("line 4"));
    assert!(Mesh::from_bytes(b"", "fbx").unwrap_err().to_string().contains(".fbx"));
}

#[test]
fn truncated_and_altered_files_are_refused_or_read_but_never_panic() {
    for (ending, bytes) in files() {
        for end in 0..bytes.len() {
            let cut = Mesh::from_bytes(&bytes[..end], ending);
            // A text may end a little early and still say all.
            assert!(cut.is_err() || end + 20 > bytes.len(), "{ending}: {end} of {} bytes pass", bytes.len());
        }
        for at in 0..bytes.len() {
            for byte in [0, 0xff, b'9', b'-', b'\n'] {
                let mut altered = bytes.clone();
                altered[at] = byte;
                let _any = Mesh::from_bytes(&altered, ending);
                let _any = positions_of(&altered);
            }
        }
    }
    // Announced sizes beyond the file reserve nothing.
    let huge = b"ply\nformat binary_little_endian 1.0\nelement vertex 18446744073709551615\nproperty float x\n\
                 property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    assert!(Mesh::from_bytes(huge, "ply").unwrap_err().to_string().contains("cut short"));
}
