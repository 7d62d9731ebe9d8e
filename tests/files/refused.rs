//! What stands at the place of a file of tensors and is none.

use std::path::Path;

use gradreel::ErrorKind;
use gradreel::io::{Archive, TensorFile, npy};

use crate::build::{state, tensor, zip};

#[test]
fn what_a_download_left_is_named_by_every_reader() {
    let cases: [(&[u8], &str, &str); 8] = [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\nsize 99\n", "a Git LFS pointer", "git lfs pull"),
        (b"<!DOCTYPE html><html><head><title>Sign in</title></head></html>", "a web page, \"Sign in\"", "sign in"),
        (b"\n\n<html><body>404</body></html>", "a web page", "download"),
        (b"{\"error\": \"Invalid username\"}", "JSON text", "download"),
        (b"Repository not found", "text, which begins with \"Repository not found\"", "download"),
        (b"", "an empty file", "again"),
        (&[0; 4000], "zeros", "again"),
        (b"\x1f\x8b\x08\x00\x00\x00", "a gzip archive", "unpack"),
    ];
    for (bytes, found, fix) in cases {
        let errors = [
            Archive::from_bytes(bytes.to_vec()).unwrap_err(),
            TensorFile::from_bytes(bytes).unwrap_err(),
            npy::from_bytes(bytes).unwrap_err(),
        ];
        for error in errors {
            let told = error.to_string();
            assert!(told.contains(found) && told.contains(fix), "{told}");
            assert_eq!(error.kind(), ErrorKind::Input);
        }
    }
}

#[test]
fn names_that_stand_twice_are_refused() {
    let file = |header: &str, data: usize| {
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header.bytes());
        bytes.extend(vec![0; data]);
        bytes
    };
    let one = |shape: &str| format!(r#"{{"dtype":"F32","shape":{shape},"data_offsets":[0,24]}}"#);
    let (a, b) = (one("[2,3]"), one("[3,2]"));
    Archive::from_bytes(file(&format!(r#"{{"w":{a}}}"#), 24)).unwrap();
    for header in [
        format!(r#"{{"w":{a},"w":{b}}}"#),
        format!(r#"{{"w":{a},"\u0077":{b}}}"#),
        format!(r#"{{"__metadata__":{{"k":"1","k":"2"}},"w":{a}}}"#),
        format!(r#"{{"__metadata__":{{}},"__metadata__":{{}},"w":{a}}}"#),
        r#"{"w":{"dtype":"F32","shape":[6],"shape":[2,3],"data_offsets":[0,24]}}"#.to_owned(),
    ] {
        let error = Archive::from_bytes(file(&header, 24)).unwrap_err();
        let told = error.to_string();
        assert!(told.contains("twice") || told.contains("duplicate field"), "{told}");
        assert_eq!(error.kind(), ErrorKind::Input);
    }
    let array = npy::to_bytes(&gradreel::Tensor::full(1.0, [2], gradreel::DType::F32)).unwrap();
    let error = Archive::from_bytes(zip(&[("w.npy", &array), ("w.npy", &array)])).unwrap_err();
    assert!(error.to_string().contains("two entries of one name"), "{error}");
}

#[test]
fn what_is_no_regular_file_is_refused_at_once() {
    let folder = std::env::temp_dir();
    let mut paths = vec![(folder, "a folder")];
    if cfg!(unix) {
        paths.push(("/dev/zero".into(), "a device"));
        let pipe = std::env::temp_dir().join(format!("gradreel-{}-pipe", std::process::id()));
        if std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
            paths.push((pipe, "a pipe"));
        }
    }
    for (path, found) in &paths {
        let errors = [
            Archive::open(path).unwrap_err(),
            TensorFile::read(path).unwrap_err(),
            npy::read(path).unwrap_err(),
            // SAFETY: nothing is mapped.
            unsafe { Archive::open_mapped(path) }.unwrap_err(),
        ];
        for error in errors {
            assert!(error.kind() == ErrorKind::Input && error.to_string().contains(found), "{error}");
        }
    }
    paths.into_iter().filter(|(_, found)| *found == "a pipe").for_each(|(path, _)| std::fs::remove_file(path).unwrap());
}

fn cut(path: &Path, len: u64) {
    std::fs::File::options().write(true).open(path).unwrap().set_len(len).unwrap();
}

/// A file above what is read at once, most of which takes no room on the disk.
#[test]
fn a_file_that_is_shortened_while_it_is_open_is_an_error() {
    let path = std::env::temp_dir().join(format!("gradreel-{}-cut.safetensors", std::process::id()));
    let elements = (128 << 20) / 4;
    let header = format!(
        r#"{{"a":{{"dtype":"F32","shape":[2],"data_offsets":[0,8]}},"b":{{"dtype":"F32","shape":[{elements}],"data_offsets":[8,{}]}}}}"#,
        8 + 4 * elements
    );
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.bytes());
    bytes.extend([1.0f32, 2.0].iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(&path, &bytes).unwrap();
    cut(&path, bytes.len() as u64 + 4 * elements);
    let archive = Archive::open(&path).unwrap();
    assert!(!archive.is_held());
    assert_eq!(archive.map("a").unwrap().slice::<f32>(), [1.0, 2.0]);
    cut(&path, bytes.len() as u64 + 100);
    let errors = [archive.load("b").unwrap_err(), archive.map("b").unwrap_err()];
    let rewritten = archive.rewrite(path.with_extension("copy"), |_, entry| entry.stored, |_, _| ());
    assert_eq!(archive.load("a").unwrap().slice::<f32>(), [1.0, 2.0], "what is there is read");
    std::fs::remove_file(&path).unwrap();
    for error in errors.into_iter().chain(rewritten.err()) {
        assert!(error.to_string().contains("became shorter"), "{error}");
        assert_eq!(error.kind(), ErrorKind::Input);
    }

    // a small file was read when it was opened
    std::fs::write(&path, zip(&[("t/data.pkl", &state(&tensor(4, 0, &[4], &[1]))), ("t/data/0", &[1; 16])])).unwrap();
    let archive = Archive::open(&path).unwrap();
    let mapped = archive.map("w").unwrap();
    cut(&path, 0);
    assert_eq!(mapped.slice::<f32>(), [f32::from_le_bytes([1; 4]); 4]);
    std::fs::remove_file(&path).unwrap();
}
