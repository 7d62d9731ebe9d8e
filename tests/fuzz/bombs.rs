//! Small files that claim, or would build, a great deal: each ends within the bounds of every other file.

use gradreel::io::{Archive, npy};

use crate::build::{checkpoint, int, state, tensor, text, zip};
use crate::harness::watched;

/// As large as rubbish may be here.
const MIB: usize = 1 << 20;

fn pickle(parts: &[&[u8]]) -> Vec<u8> {
    checkpoint(&[b"\x80\x04", &parts.concat()[..], b"."].concat())
}

#[test]
fn small_files_stay_small() {
    let dict = |value: &[u8]| [&b"}"[..], &text("w"), value, b"s"].concat();
    // a list of one list 250 000 times, that list of another, and so on: as many paths as there are products
    let doubling: Vec<u8> =
        (0..20u8).flat_map(|i| [&b"]q"[..], &[i + 1], b"(", &[b'h', i].repeat(10_000), b"e"].concat()).collect();
    let wide = [&b"]q\x00(cos\nsystem\n)R"[..], &b"2".repeat(MIB - 100), b"e"].concat();
    let opaque = [&b"cos\nsystem\n"[..], &b"2)R".repeat(MIB / 3 - 100)].concat();
    let memo: Vec<u8> =
        (0..MIB as u32 / 6).flat_map(|i| [&b"Nr"[..], &(i * 24_000 + 7).to_le_bytes()].concat()).collect();
    let repeated = tensor(1 << 18, 0, &[64, 1 << 17], &[0, 1]);
    let large = zip(&[("t/data.pkl", &state(&repeated)), ("t/data/0", &vec![0; MIB])]);
    let bytes = [
        b"ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        [text("storage"), b"ctorch\nByteStorage\n".to_vec(), text("0"), text("cpu"), int(MIB as i64)].concat(),
        [b"tQ".to_vec(), int(0), b"(K\x08".to_vec(), int(MIB as i64), b"t(K\x00K\x01t\x89NtR".to_vec()].concat(),
    ]
    .concat();
    let octets = zip(&[("t/data.pkl", &state(&bytes)), ("t/data/0", &vec![0xff; MIB])]);
    let header = |text: String| [&(text.len() as u64).to_le_bytes()[..], text.as_bytes()].concat();
    let empty = |i: usize| format!(r#""{i}":{{"dtype":"F32","shape":[0],"data_offsets":[0,0]}}"#);
    let long = "1,".repeat(30_000);
    let shape = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({long}), }}");
    let npy = [b"\x93NUMPY\x01\x00", &(shape.len() as u16).to_le_bytes()[..], shape.as_bytes(), &[0; 8]].concat();
    let files: Vec<(&str, Vec<u8>)> = vec![
        ("lists that hold each other", pickle(&[b"Nq\x00", &doubling])),
        ("one value very often", pickle(&[&wide])),
        ("calls of what calls gave", pickle(&[b"(", &opaque, b"t"])),
        ("a memo far apart", pickle(&[b"(", &memo, b"t"])),
        ("marks", pickle(&[&b"(".repeat(MIB)])),
        ("tuples of tuples", pickle(&[b"N", &b"\x85".repeat(MIB)])),
        ("dicts of dicts", pickle(&[&dict(b"}").repeat(MIB / 12)])),
        ("empty tuples", pickle(&[b"(", &b")".repeat(MIB), b"t"])),
        ("a claim of a text of 2^63 bytes", pickle(&[b"\x8d\xff\xff\xff\xff\xff\xff\xff\x7f"])),
        ("a claim of bytes of 2^32", pickle(&[b"B\xff\xff\xff\xff"])),
        ("a place in the memo of 2^32", pickle(&[b"Nr\xff\xff\xff\xffj\xff\xff\xff\xff"])),
        ("an integer of a million digits", pickle(&[b"L", &b"9".repeat(MIB), b"\n"])),
        ("a text of escapes", pickle(&[b"V", &b"\\u00e9".repeat(MIB / 6), b"\n"])),
        ("keys that are long tuples", pickle(&[b"}(", &b"(K\x01K\x02t2".repeat(MIB / 8), b"u"])),
        ("a tensor that repeats its storage", large),
        ("bytes that repeat their storage", octets),
        ("many empty tensors", header(format!("{{{}}}", (0..MIB / 60).map(empty).collect::<Vec<_>>().join(",")))),
        ("a deep header", header("[".repeat(MIB))),
        ("a header of one long name", header(format!("{{\"{}\":1}}", "n".repeat(MIB)))),
        ("an array of very many axes", npy),
        ("a directory of nothing", [&b"PK\x05\x06"[..], &[0; 18]].concat()),
        ("a directory of everything", [&b"PK\x05\x06\0\0\0\0"[..], &[0xff; 12], &[0; 2]].concat()),
        ("zeros", vec![0; MIB]),
    ];
    for (what, file) in files {
        assert!(file.len() < 2 * MIB, "{what}: {} bytes", file.len());
        let read = || {
            drop(npy::from_bytes(&file));
            let Ok(archive) = Archive::from_bytes(file.clone()) else { return false };
            archive.names().for_each(|name| drop(archive.load(name)));
            archive.load_all().is_ok()
        };
        watched(read).unwrap_or_else(|fault| panic!("{what}: {fault}"));
    }
}
