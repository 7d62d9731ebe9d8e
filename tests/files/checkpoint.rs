//! PyTorch checkpoints in both containers.

use gradreel::io::{Archive, Format, TensorFile};
use gradreel::{DType, ErrorKind};

use crate::build::{checkpoint, state, tensor};

fn same_as_expected(archive: &Archive) {
    let expected = Archive::open("tests/vectors/tiny_checkpoint_expected.safetensors").unwrap();
    assert!(archive.names().eq(expected.names()), "{:?}", archive.names().collect::<Vec<_>>());
    for name in expected.names() {
        let (found, wanted) = (archive.entry(name).unwrap(), expected.entry(name).unwrap());
        assert_eq!((found.stored, &found.shape), (wanted.stored, &wanted.shape), "{name}");
        let (found, wanted) = (archive.load(name).unwrap(), expected.load(name).unwrap());
        assert_eq!(found.spec(), wanted.spec(), "{name}");
        let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
        assert_eq!(bits(found.to_vec().unwrap()), bits(wanted.to_vec().unwrap()), "{name}");
    }
}

#[test]
fn the_zip_container_holds_the_expected_tensors() {
    let archive = Archive::open("tests/vectors/tiny_lightning.ckpt").unwrap();
    assert_eq!(archive.format(), Format::TorchZip);
    same_as_expected(&archive);
    assert_eq!(archive.metadata()["epoch"], "3");
    assert_eq!(archive.metadata()["pytorch-lightning_version"], "1.9.0");
}

#[test]
fn the_stream_container_holds_the_expected_tensors() {
    let archive = Archive::open("tests/vectors/tiny_legacy_format.ckpt").unwrap();
    assert_eq!(archive.format(), Format::TorchLegacy);
    same_as_expected(&archive);
}

#[test]
fn a_forbidden_call_is_an_error_of_its_entry_alone() {
    let archive = Archive::open("tests/vectors/tiny_forbidden_call.ckpt").unwrap();
    assert_eq!(archive.names().collect::<Vec<_>>(), ["bad", "w"]);
    assert_eq!(archive.load("w").unwrap().dims(), [2]);
    let error = archive.load("bad").unwrap_err();
    assert!(error.to_string().contains("a call to posix.getcwd, which is never made"), "{error}");
    assert!(archive.load_all().unwrap_err().to_string().contains("bad"));
}

#[test]
fn nested_values_have_dotted_paths() {
    let archive = Archive::open("tests/vectors/nested.pt").unwrap();
    let list = |name: &str| archive.load(name).unwrap().to_vec().unwrap();
    assert_eq!(archive.load("net.w").unwrap().dims(), [3, 2]);
    assert_eq!(list("net.w"), [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
    assert_eq!(list("net.p"), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!(list("net.expanded"), [2.5; 12]);
    assert_eq!((list("list.0"), list("list.1")), (vec![1.0, 2.0], vec![3.0]));
    assert_eq!(list("u16"), [1.0, 65535.0]);
    assert_eq!(archive.metadata()["epoch"], "7");
    let error = archive.load("complex").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("ComplexFloatStorage"), "{error}");

    let part = Archive::open_at("tests/vectors/nested.pt", &["net"]).unwrap();
    assert_eq!(part.names().collect::<Vec<_>>(), ["expanded", "p", "w"]);
    let error = Archive::open_at("tests/vectors/nested.pt", &["net", "ema"]).unwrap_err();
    assert!(error.to_string().contains("[\"net\", \"ema\"]"), "{error}");
    let inside = Archive::open_at("tests/vectors/tiny_lightning.ckpt", &["optimizer_states", "0"]).unwrap();
    assert!(inside.names().all(|name| name.starts_with("state.") || name.starts_with("param_groups.")));
}

#[test]
fn a_view_is_gathered_by_its_strides() {
    let numbers: Vec<u8> = [1.0f32, 2.0, 3.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let pickle = state(&tensor(4, 1, &[2, 2], &[1, 1]));
    let file = crate::build::zip(&[("top/data.pkl", &pickle), ("top/data/0", &numbers)]);
    let w = Archive::from_bytes(file).unwrap().load("w").unwrap();
    assert_eq!(w.slice::<f32>(), [2.0, 3.0, 3.0, 4.0]);
}

#[test]
fn a_checkpoint_is_written_again_as_safetensors() {
    let file = TensorFile::read("tests/vectors/tiny_lightning.ckpt").unwrap();
    let again = TensorFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
    assert!(file.tensors.keys().eq(again.tensors.keys()));
    assert_eq!(file.get("half").unwrap().dtype(), DType::F16);
    assert_eq!(again.get("bf16").unwrap().slice::<f32>(), file.get("bf16").unwrap().slice::<f32>());
}

#[test]
fn a_forged_call_in_a_state_dict_leaves_no_trace() {
    let file = std::env::temp_dir().join(format!("gradreel-{}-called", std::process::id()));
    let call = format!("cos\nsystem\n(X{}touch {}tR", "\0\0\0\0", file.display());
    let mut call = call.into_bytes();
    let len = (6 + file.display().to_string().len()) as u32;
    let at = call.iter().position(|b| *b == b'X').unwrap() + 1;
    call[at..at + 4].copy_from_slice(&len.to_le_bytes());
    let archive = Archive::from_bytes(checkpoint(&state(&call))).unwrap();
    assert!(archive.load("w").unwrap_err().to_string().contains("os.system"));
    assert!(!file.exists());
}
