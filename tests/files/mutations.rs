//! Thousands of damaged files: any answer is right, except a panic or a tensor that is not what it claims to be.

use gradreel::io::{Archive, npy};
use proptest::prelude::*;

const CORPUS: [&str; 8] = [
    "tiny_lightning.ckpt",
    "tiny_legacy_format.ckpt",
    "tiny_forbidden_call.ckpt",
    "nested.pt",
    "tiny_checkpoint_expected.safetensors",
    "kinds.npz",
    "fortran_f4.npy",
    "big_endian_f8.npy",
];

fn read(bytes: Vec<u8>) {
    if let Ok(x) = npy::from_bytes(&bytes) {
        assert_eq!(x.to_vec().unwrap().len(), x.len());
    }
    let Ok(archive) = Archive::from_bytes(bytes) else { return };
    for name in archive.names() {
        if let Ok(x) = archive.load(name) {
            assert_eq!(x.shape(), &archive.entry(name).unwrap().shape);
            assert_eq!(x.to_vec().unwrap().len(), x.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(
        file in 0..CORPUS.len(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        inserts in prop::collection::vec((any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 1..9)), 0..2),
        cut in prop::option::weighted(0.1, any::<prop::sample::Index>()),
    ) {
        let mut bytes = std::fs::read(format!("tests/vectors/{}", CORPUS[file])).unwrap();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        for (at, piece) in inserts {
            let at = at.index(bytes.len());
            bytes.splice(at..at, piece);
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        read(bytes);
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), magic in 0..4usize) {
        let magic: &[u8] = [&b"PK\x03\x04"[..], b"\x80\x02", b"\x93NUMPY", b""][magic];
        read([magic, &bytes].concat());
    }
}
