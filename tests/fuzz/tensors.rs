//! Files of tensors, and networks.

use std::fs;

use gradreel::io::{Archive, npy};
use gradreel_models::video::{Film, FilmSettings, MattingSettings, OpenOptions};

use crate::build;
use crate::harness::fuzz;
use crate::mutate;
use crate::onnx_file::Network;

fn corpus(names: &[&str]) -> Vec<Vec<u8>> {
    names.iter().map(|name| fs::read(format!("tests/vectors/{name}")).unwrap()).collect()
}

/// Reads a file in every way; what is read must be what the file listed.
fn read(bytes: &[u8]) -> bool {
    let array = npy::from_bytes(bytes).is_ok();
    let Ok(archive) = Archive::from_bytes(bytes.to_vec()) else { return array };
    for name in archive.names() {
        for x in [archive.load(name), archive.map(name)].into_iter().flatten() {
            assert_eq!(x.shape(), &archive.entry(name).unwrap().shape, "{name}");
        }
    }
    drop(archive.load_all());
    true
}

#[test]
fn safetensors_and_npy() {
    let seeds = corpus(&["tiny_checkpoint_expected.safetensors", "kinds.npz", "fortran_f4.npy", "big_endian_f8.npy"]);
    let tokens: [&[u8]; 9] = [
        b"\"dtype\":\"F64\"",
        b"\"shape\":[0]",
        b"[18446744073709551615]",
        b"'|O'",
        b"(2,)",
        b"(2L, 3L)",
        b"True",
        b"{",
        b"-1",
    ];
    fuzz("safetensors-npy", &seeds, &tokens, read);
}

#[test]
fn checkpoints() {
    let seeds = corpus(&["tiny_lightning.ckpt", "tiny_legacy_format.ckpt", "tiny_forbidden_call.ckpt", "nested.pt"]);
    fuzz("checkpoints", &seeds, &mutate::OPCODES, read);
}

/// Pickles alone, so that no mutation is spent on the container.
#[test]
fn pickles() {
    let mut pickles = ["tiny_lightning.ckpt", "tiny_forbidden_call.ckpt", "nested.pt"]
        .map(|name| {
            let file = fs::read(format!("tests/vectors/{name}")).unwrap();
            let start = file.windows(2).position(|w| w == b"\x80\x02").unwrap();
            let end = file.windows(4).position(|w| w == b"PK\x07\x08").unwrap();
            file[start..end].to_vec()
        })
        .to_vec();
    // text, a module, and an object of another kind
    pickles.push(
        b"(dp0\nVw\np1\nctorch._utils\n_rebuild_tensor_v2\np2\n(P('storage', <class 'torch.FloatStorage'>, '0', 'cpu', 30)\n\
          I0\n(I2\nI3\ntp3\n(I3\nI1\ntp4\nI00\nccollections\nOrderedDict\np5\n(tRp6\ntp7\nRp8\nsS'a\\x21'\nF1.5\ns."
            .to_vec(),
    );
    let tensor = build::tensor(30, 0, &[2, 3], &[3, 1]);
    let parts = [&b"}("[..], &build::text("w"), &tensor, b"u"].concat();
    pickles.push(
        [
            &b"\x80\x02ctorch.nn\nLinear\n)\x81}("[..],
            &build::text("_parameters"),
            &parts,
            &build::text("_buffers"),
            b"}",
            &build::text("_modules"),
            b"}ub.",
        ]
        .concat(),
    );
    pickles.push([&b"\x80\x04cmy\nTrainer\n)\x81}("[..], &build::text("net"), &tensor, b"K\x01(K\x02\x91ub."].concat());
    pickles.push([&b"\x80\x02}("[..], &build::text("a"), &tensor, &build::text("b"), &tensor, b"u."].concat());
    let storages: Vec<(String, Vec<u8>)> = (0..12).map(|i| (format!("top/data/{i}"), vec![i; 120])).collect();
    let container = |pickle: &[u8]| {
        let mut entries: Vec<(&str, &[u8])> = vec![("top/data.pkl", pickle)];
        entries.extend(storages.iter().map(|(name, data)| (&**name, &data[..])));
        build::zip(&entries)
    };
    fuzz("pickles", &pickles, &mutate::OPCODES, |pickle| read(&container(pickle)));
}

/// Networks in ONNX files, each of which looks at a film of two pictures.
#[test]
fn networks() {
    const SIDE: usize = 16;
    let folder = tempfile::tempdir().unwrap();
    let (film, model) = (folder.path().join("film"), folder.path().join("net.onnx"));
    fs::create_dir(&film).unwrap();
    for frame in 0..2 {
        let inside = |x: usize, y: usize| (5..11).contains(&x) && (4 + frame..10 + frame).contains(&y);
        let paint = |x: usize, y: usize| if inside(x, y) { [180, 40, 30, 255] } else { [210, 220, 215, 255] };
        crate::builder::write_png(&film.join(format!("{frame}.png")), (SIDE, SIDE), false, &paint);
    }
    // whatever is not green is the object
    let network = |side| Network::of(side, [0.5, -8.0, -0.5], 4.0);
    let seeds = [
        network(Some(SIDE as u64)).bytes(),
        Network { last: ("Identity", &[]), ..network(Some(SIDE as u64)) }.bytes(),
        Network { last: ("Squeeze", &[1]), ..network(Some(SIDE as u64)) }.bytes(),
    ];
    let matting = MattingSettings { model: model.clone(), mean: [0.0; 3], deviation: [1.0; 3], ..Default::default() };
    let settings = FilmSettings { frames_per_s: 24.0, matting: Some(matting), ..FilmSettings::default() };
    let operators: [&[u8]; 6] = [b"Conv", b"Resize", b"Reshape", b"Tile", b"Expand", b"\xff\xff\xff\xff\x0f"];
    fuzz("onnx", &seeds, &operators, |bytes| {
        fs::write(&model, bytes).unwrap();
        Film::read(&film, &settings, &OpenOptions::default()).is_ok()
    });
}
