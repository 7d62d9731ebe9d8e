//! Solids as different programs write them: a box of 1 m × 0.5 m × 0.8 m each time, or an error that says what is wrong.

use gradreel::ErrorKind;
use gradreel_models::scenes::{Mesh, positions_of};

/// Corners of the box are numbered by x, y and z, z fastest.
fn place(corner: usize) -> [f32; 3] {
    let side = |bit: usize, length: f32| if corner & bit == 0 { 0.0 } else { length };
    [side(4, 1.0), side(2, 0.5), side(1, 0.8)]
}

/// The sides, wound to look outwards.
const SIDES: [[usize; 4]; 6] = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];

fn triangles() -> impl Iterator<Item = [usize; 3]> {
    SIDES.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
}

#[track_caller]
fn is_box(what: &str, bytes: &[u8], ending: &str) {
    let mesh = Mesh::from_bytes(bytes, ending).unwrap_or_else(|e| panic!("{what}: {e}"));
    approx::assert_relative_eq!(mesh.volume(), 0.4, max_relative = 1e-7);
    let [low, high] = mesh.bounds();
    assert_eq!(low, [0.0; 3], "{what}");
    assert!(high.iter().zip([1.0, 0.5, 0.8]).all(|(a, b)| (a - b).abs() < 1e-7), "{what}: {high:?}");
}

#[track_caller]
fn is_refused(bytes: &[u8], ending: &str, parts: &[&str]) {
    let error = Mesh::from_bytes(bytes, ending).expect_err(&format!("{parts:?}"));
    assert_eq!(error.kind(), ErrorKind::Input);
    for part in parts.iter().chain(&["fix: "]) {
        assert!(error.to_string().contains(part), "no {part:?} in {error}");
    }
}

fn obj() -> String {
    let mut text = String::new();
    for [x, y, z] in (0..8).map(place) {
        text += &format!("v {x} {y} {z}\n");
    }
    for side in SIDES {
        text += &format!("f {}\n", side.map(|corner| (corner + 1).to_string()).join(" "));
    }
    text
}

#[test]
fn every_dialect_of_obj_is_the_same_box() {
    let plain = obj();
    is_box("plain", plain.as_bytes(), "obj");
    is_box("byte order mark", format!("\u{feff}{plain}").as_bytes(), "obj");
    is_box("comments", plain.replace('\n', " # of eight\n").as_bytes(), "obj");
    is_box("comments after a tab", plain.replace('\n', "\t#8\n").as_bytes(), "obj");
    is_box("windows", plain.replace('\n', "\r\n").as_bytes(), "obj");
    is_box("old mac", plain.replace('\n', "\r").as_bytes(), "obj");
    is_box("tabs", plain.replace(' ', "\t ").as_bytes(), "obj");
    let turns: String = plain.lines().map(|line| line.replacen(' ', " \\\n", 1) + "\n").collect();
    is_box("lines that go on", turns.as_bytes(), "obj");
    is_box("lines that go on, windows", turns.replace('\n', "\r\n").as_bytes(), "obj");
    is_box("a blank behind the backslash", turns.replace("\\\n", "\\ \n").as_bytes(), "obj");
    is_box("a comment ends with a backslash", format!("# C:\\box\\\n{plain}").as_bytes(), "obj");
    let noise = format!("mtllib nowhere.mtl\no\ng a b\ns off\nusemtl\nvn 0 0\nvt\nl 1 2\np 1\nvp 0.1\n{plain}g\n");
    is_box("groups and an empty usemtl", noise.as_bytes(), "obj");
    let mut counted = plain.clone();
    for corner in (1..=8).rev() {
        counted = counted.replace(&format!(" {corner}"), &format!(" -{}", 9 - corner));
    }
    let counted: String = plain
        .lines()
        .zip(counted.lines())
        .map(|(v, f)| if v.starts_with('v') { v } else { f }.to_owned() + "\n")
        .collect();
    assert!(counted.contains("f -8 -7 -5 -6"));
    is_box("counted from the end", counted.as_bytes(), "obj");
    let with_normals = plain.replace("f 1 2 4 3", "f 1//9 2/7/9 4/7 3/");
    is_box("textures and normals that are nowhere", with_normals.as_bytes(), "obj");
    let mut latin = plain.clone().into_bytes();
    latin.splice(0..0, *b"# Geh\xe4use\no Geh\xe4use\n");
    is_box("latin-1", &latin, "obj");
    let wide: Vec<u8> = std::iter::once(0xfeff).chain(plain.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    is_box("utf-16", &wide, "obj");
}

#[test]
fn what_is_wrong_in_an_obj_is_named() {
    let plain = obj();
    is_refused(plain.replace("f 1 2 4 3", "f 1 2 4 3 quad").as_bytes(), "obj", &["line 9", "f 1 2 4 3 quad"]);
    is_refused(plain.replace("f 1 2 4 3", "f 1 \\\n2 4 33").as_bytes(), "obj", &["line 9", "8 corners"]);
    is_refused(plain.replace("v 1 0 0\n", "v 1 # 0 0\n").as_bytes(), "obj", &["line 5", "v x y z"]);
    is_refused(&[b'v', 0, 1, 2, 3], "obj", &["not text"]);
    // Every line goes on, and none ends: in time that grows with the length.
    let begin = std::time::Instant::now();
    is_refused("\\\n".repeat(500_000).as_bytes(), "obj", &["no faces"]);
    assert!(begin.elapsed().as_secs() < 5);
}

fn ascii_stl() -> String {
    let mut text = "solid box\n".to_owned();
    for triangle in triangles() {
        text += " facet normal 0 0 0\n  outer loop\n";
        triangle.iter().map(|corner| place(*corner)).for_each(|[x, y, z]| text += &format!("   vertex {x} {y} {z}\n"));
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid box\n"
}

fn binary_stl(header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend(12u32.to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flat_map(|corner| place(*corner)).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn every_dialect_of_stl_is_the_same_box() {
    let text = ascii_stl();
    is_box("text", text.as_bytes(), "stl");
    is_box("capitals", text.to_uppercase().as_bytes(), "stl");
    is_box("mixed", text.replace("solid", "Solid").replace("vertex", "Vertex").as_bytes(), "stl");
    is_box("byte order mark", format!("\u{feff}{text}").as_bytes(), "stl");
    is_box("empty lines before", format!("\r\n \n{text}").as_bytes(), "stl");
    is_box("a comment before", format!("; made by hand\n{text}").as_bytes(), "stl");
    is_box("no name", text.replace(" box", "").as_bytes(), "stl");
    is_box("a name of vertices", text.replace(" box", " vertex of facet endloop").as_bytes(), "stl");
    is_box("old mac", text.replace('\n', "\r").as_bytes(), "stl");
    is_box("windows", text.replace('\n', "\r\n").as_bytes(), "stl");
    is_box("one facet a line", text.replace("\n  ", " ").as_bytes(), "stl");
    is_box(
        "exponents",
        text.replace("0.8", "+8.0E-01").replace("0.5", "5e-1").replace(" 1 ", " 1.000e+000 ").as_bytes(),
        "stl",
    );
    let latin: Vec<u8> = text.replace("box", "Gehäuse").chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    is_box("latin-1", &latin, "stl");
    let mut quads = "solid\n".to_owned();
    for side in SIDES {
        let corners = side.map(place).map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).concat();
        quads += &format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n");
    }
    is_box("facets of four corners", (quads + "endsolid").as_bytes(), "stl");

    is_box("binary", &binary_stl(b"export"), "stl");
    is_box("binary that begins as text", &binary_stl(b"solid box"), "stl");
    for behind in [&b"\n"[..], b"JUNK", &[0; 50], &[0; 100], &[7; 4096 - 684], &[b' '; 49]] {
        for header in [&b"export"[..], b"solid box"] {
            let bytes = [&binary_stl(header), behind].concat();
            is_box(&format!("{} bytes behind", behind.len()), &bytes, "stl");
        }
    }
}

#[test]
fn what_is_wrong_in_an_stl_is_named() {
    let with_count = |count: u32| {
        let mut bytes = binary_stl(b"solid");
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        bytes
    };
    is_refused(&with_count(13), "stl", &["cut short", "13 triangles", "12 triangles at most"]);
    is_refused(&with_count(u32::MAX), "stl", &["cut short", "4294967295 triangles"]);
    is_refused(&with_count(11), "stl", &["another number of triangles", "1 more behind the 11"]);
    is_refused(&with_count(0), "stl", &["another number of triangles", "12 more behind the 0"]);
    let text = ascii_stl();
    is_refused(text.replace("vertex 0 0 0.8", "vertex 0 0 0,8").as_bytes(), "stl", &["line 5", "vertex 0 0 0,8"]);
    is_refused(text.replacen("   vertex 0 0 0\n", "", 1).as_bytes(), "stl", &["too few corners", "line 6"]);
    is_refused(text.replace("endsolid", "").as_bytes(), "stl", &["cut short", "12 facets", "endsolid"]);
    is_refused(b"<!DOCTYPE html>\n<html>", "stl", &["no STL", "<!DOCTYPE html>"]);
    is_refused(b"", "stl", &["no STL"]);
}

/// A PLY header of the box, its corners as text, and what describes its faces.
fn ascii_ply(faces: &str, rows: &str) -> String {
    let corners: String = (0..8).map(place).map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n{faces}\
         end_header\n{corners}{rows}"
    )
}

/// The sides as strips, whose ends are marked.
fn strips() -> Vec<i64> {
    SIDES.iter().flat_map(|[a, b, c, d]| [*a as i64, *b as i64, *d as i64, *c as i64, -1]).collect()
}

fn listed(numbers: &[i64]) -> String {
    let numbers: Vec<String> = numbers.iter().map(i64::to_string).collect();
    format!("{} {}\n", numbers.len(), numbers.join(" "))
}

#[test]
fn faces_strips_and_fans_of_a_ply_are_the_same_box() {
    let faces = "element face 6\nproperty list uchar int vertex_indices\n";
    let rows: String = SIDES.iter().map(|side| listed(&side.map(|corner| corner as i64))).collect();
    let plain = ascii_ply(faces, &rows);
    is_box("faces", plain.as_bytes(), "ply");
    is_box("windows", plain.replace('\n', "\r\n").as_bytes(), "ply");
    is_box("old mac", plain.replace('\n', "\r").as_bytes(), "ply");
    is_box("byte order mark", format!("\u{feff}{plain}").as_bytes(), "ply");
    is_box(
        "another name and type",
        plain.replace("uchar int vertex_indices", "int float vertex_index").as_bytes(),
        "ply",
    );
    is_box("an empty element", plain.replace("end_header", "element edge 0\nend_header").as_bytes(), "ply");
    let mut latin = plain.clone().into_bytes();
    latin.splice(4..4, *b"comment Geh\xe4use\n");
    is_box("latin-1", &latin, "ply");
    assert_eq!(positions_of(format!("\u{feff}{plain}").as_bytes()).unwrap().len(), 8);

    let strip = "element tristrips 1\nproperty list int int vertex_indices\n";
    is_box("strips", ascii_ply(strip, &listed(&strips())).as_bytes(), "ply");
    let without_end = &strips()[..29];
    is_box("no mark at the end", ascii_ply(strip, &listed(without_end)).as_bytes(), "ply");
    let several: String = strips().chunks(10).map(listed).collect();
    is_box("three rows of strips", ascii_ply(&strip.replace('1', "3"), &several).as_bytes(), "ply");
    // Around the sides in one strip, its ends two fans: every other triangle is wound the other way round.
    let around = [&[0, 1, 2, 3, 6, 7, 4, 5, 0, 1, -1][..], &[0, 2, 4, 6, -1], &[1, 5, 3, 7]].concat();
    is_box("one strip around", ascii_ply(strip, &listed(&around)).as_bytes(), "ply");
    let fans: Vec<i64> = SIDES.iter().flat_map(|side| side.map(|corner| corner as i64)).collect();
    let fans: Vec<i64> = fans.chunks(4).flat_map(|fan| [fan, &[-1][..]].concat()).collect();
    is_box("fans", ascii_ply(&strip.replace("strips", "fans"), &listed(&fans)).as_bytes(), "ply");
}

#[test]
fn binary_strips_of_either_byte_order_are_the_same_box() {
    for (order, big) in [("little", false), ("big", true)] {
        for kind in ["int", "uint"] {
            for end in ["\n", "\r\n", "\r"] {
                let header = format!(
                    "ply\nformat binary_{order}_endian 1.0\nelement vertex 8\nproperty uchar flags\nproperty float x\n\
                     property double y\nproperty float z\nelement tristrips 1\nproperty list ushort {kind} vertex_indices\n\
                     end_header\n"
                );
                let mut bytes = header.replace('\n', end).into_bytes();
                let mut put = |number: &[u8]| match big {
                    true => bytes.extend(number.iter().rev()),
                    false => bytes.extend(number),
                };
                for [x, y, z] in (0..8).map(place) {
                    put(&[9]);
                    put(&x.to_le_bytes());
                    put(&f64::from(y).to_le_bytes());
                    put(&z.to_le_bytes());
                }
                put(&30u16.to_le_bytes());
                strips().iter().for_each(|number| put(&(*number as i32).to_le_bytes()));
                is_box(&format!("{order} {kind} {end:?}"), &bytes, "ply");
            }
        }
    }
}

#[test]
fn what_is_wrong_in_a_ply_is_named() {
    let strip = "element tristrips 1\nproperty list int int vertex_indices\n";
    let grid = "element range_grid 1\nproperty list uchar int vertex_indices\n";
    is_refused(ascii_ply(grid, "1 0\n").as_bytes(), "ply", &["no faces that can be read", "1 range_grid", "tristrips"]);
    is_refused(ascii_ply("", "").as_bytes(), "ply", &["no faces that can be read", "8 vertex"]);
    is_refused(ascii_ply(strip, "4 0 1 -2 3\n").as_bytes(), "ply", &["tristrips 0", "-2"]);
    is_refused(ascii_ply(strip, "4 0 1 2 99\n").as_bytes(), "ply", &["corner 99"]);
    is_refused(ascii_ply(strip, "3 0 1.5 2\n").as_bytes(), "ply", &["tristrips 0", "1.5"]);
    is_refused(ascii_ply(strip, "900 0 1 2\n").as_bytes(), "ply", &["cut short", "tristrips 0"]);
    is_refused(ascii_ply(strip, "1e18 0 1 2\n").as_bytes(), "ply", &["too many"]);
    is_refused(ascii_ply(&strip.replace("int int", "int half"), "").as_bytes(), "ply", &["header", "int half"]);
    is_refused(b"<html>\n", "ply", &["header", "<html>", "`ply`"]);
}

/// A device without end, a folder and a pipe: refused at once.
#[cfg(unix)]
#[test]
fn files_without_end_are_refused() {
    use gradreel_models::scenes::{Shape, fill};
    let folder = tempfile::TempDir::new().unwrap();
    for ending in ["obj", "stl", "ply"] {
        let path = folder.path().join(format!("endless.{ending}"));
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        let error = Mesh::read(&path).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains("no file") && error.to_string().contains("endless."), "{error}");
    }
    let error = Mesh::read(folder.path()).unwrap_err();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("a folder"), "{error}");
    let particles =
        Shape::Particles { file: std::path::PathBuf::from("endless.ply"), scale: 1.0, translate_m: [0.0; 3] };
    let error = fill(&particles, 0.1, 0, folder.path()).unwrap_err();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("endless.ply"), "{error}");
    // Longer than is read, on a disk that holds its length alone.
    let long = folder.path().join("long.stl");
    std::fs::File::create(&long).unwrap().set_len((256 << 20) + 1).unwrap();
    let error = Mesh::read(&long).unwrap_err();
    assert!(error.kind() == ErrorKind::Input && error.to_string().contains("at most"), "{error}");
}
