//! safetensors: written whole or not at all, listed without being read.

use std::path::PathBuf;

use gradreel::io::{Archive, Format, Stored, TensorFile, npy};
use gradreel::{DType, ErrorKind, Tensor};

/// A folder that is removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("gradreel-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).unwrap();
    }
}

#[test]
fn a_written_file_is_read_back_bit_for_bit() {
    let folder = Folder::new("written");
    let path = folder.0.join("weights.safetensors");
    let mut file = TensorFile::default();
    let x = vec![1.0f32, -0.0, f32::MIN_POSITIVE / 4.0, f32::NAN];
    file.tensors.insert("x".into(), Tensor::from_vec(x.clone(), [4, 1]));
    file.tensors.insert("half".into(), Tensor::full(0.1, [3], DType::F16));
    file.tensors.insert("none".into(), Tensor::zeros([0, 2], DType::F64));
    file.tensors.insert("index".into(), Tensor::from_vec(vec![u32::MAX], []));
    file.metadata.insert("note".into(), "made by a test".into());
    file.write(&path).unwrap();
    file.write(&path).unwrap();
    let left: Vec<_> = std::fs::read_dir(&folder.0).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["weights.safetensors"], "nothing partial is left");

    let archive = Archive::open(&path).unwrap();
    assert_eq!(archive.format(), Format::Safetensors);
    assert_eq!(archive.names().collect::<Vec<_>>(), ["half", "index", "none", "x"]);
    assert_eq!(archive.metadata()["note"], "made by a test");
    assert_eq!(archive.entry("half").unwrap().stored, Stored::F16);
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(archive.load("x").unwrap().slice()), bits(&x));
    assert_eq!(archive.load("index").unwrap().slice::<u32>(), [u32::MAX]);
    assert_eq!(archive.load("none").unwrap().dims(), [0, 2]);
    let half = archive.load_as("half", DType::F64).unwrap();
    assert_eq!(half.slice::<f64>()[0], 0.0999755859375);
    let error = archive.load("y").unwrap_err();
    assert!(error.to_string().contains("half"), "{error}");
    let error = Archive::open(folder.0.join("nothing")).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Input);
    assert!(TensorFile::default().write(folder.0.join("no/such/folder")).is_err());
}

#[test]
fn a_file_without_tensors_is_read_back() {
    for metadata in [&[][..], &[("note", "nothing yet")]] {
        let mut file = TensorFile::default();
        file.metadata.extend(metadata.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
        let read = TensorFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
        assert!(read.tensors.is_empty());
        assert_eq!(read.metadata, file.metadata);
    }
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = Folder::new("failed");
    // a folder cannot be replaced by a file
    let path = folder.0.join("taken");
    std::fs::create_dir(&path).unwrap();
    assert!(npy::write(&path, &Tensor::zeros([2], DType::F32)).is_err());
    assert!(TensorFile::default().write(&path).is_err());
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 1);
}

fn file(header: &str, data: usize) -> Vec<u8> {
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes());
    bytes.extend(vec![0xff; data]);
    bytes
}

#[test]
fn every_type_of_the_format_is_read_or_named() {
    let archive = Archive::from_bytes(file(
        r#"{"a":{"dtype":"I64","shape":[1],"data_offsets":[0,8]},"b":{"dtype":"BOOL","shape":[1],"data_offsets":[8,9]},
            "c":{"dtype":"F8_E4M3","shape":[1],"data_offsets":[9,10]},"d":{"dtype":"U16","shape":[],"data_offsets":[10,12]}}"#,
        12,
    ))
    .unwrap();
    assert_eq!(archive.load("a").unwrap().slice::<f64>(), [-1.0]);
    assert!(archive.load_as("a", DType::U32).unwrap_err().to_string().contains("-1 as element 0"));
    assert_eq!(archive.load_as("a", DType::F32).unwrap().slice::<f32>(), [-1.0]);
    assert!(archive.load("b").unwrap_err().to_string().contains("0 to 1"));
    assert_eq!(archive.load("c").unwrap_err().kind(), ErrorKind::Unsupported);
    assert_eq!(archive.load("d").unwrap().slice::<u32>(), [65535]);
}

#[test]
fn hostile_headers_are_refused() {
    let one =
        |shape: &str, offsets: &str| format!(r#"{{"a":{{"dtype":"F32","shape":{shape},"data_offsets":{offsets}}}}}"#);
    Archive::from_bytes(file(&one("[2]", "[0,8]"), 8)).unwrap();
    let cases = [
        file(&one("[2]", "[0,8]"), 7),
        file(&one("[3]", "[0,8]"), 8),
        file(&one("[2]", "[8,0]"), 8),
        file(&one("[2]", "[4,12]"), 12),
        file(&one("[4611686018427387904,4]", "[0,0]"), 0),
        file(&one("[18446744073709551615]", "[0,8]"), 8),
        file(&one("[0,4611686018427387904,4]", "[0,0]"), 0),
        file(&format!("{{\"a\":{}{}}}", "[".repeat(5000), "]".repeat(5000)), 0),
        u64::MAX.to_le_bytes().to_vec(),
        (1u64 << 40).to_le_bytes().to_vec(),
        Vec::new(),
        b"not a file of tensors".to_vec(),
    ];
    for (i, bytes) in cases.into_iter().enumerate() {
        let archive = Archive::from_bytes(bytes);
        let error = archive.and_then(|archive| archive.load_all()).expect_err(&format!("case {i}"));
        assert_eq!(error.kind(), ErrorKind::Input, "case {i}: {error}");
    }
}
