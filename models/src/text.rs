//! Reading of text files: limited size, UTF-8, byte order mark removed.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

/// Largest size of a settings or scene file \[bytes\].
pub(crate) const SETTINGS: u64 = 16 << 20;

/// The UTF-8 byte order mark, which some editors write at the start of a file.
const MARK: &[u8] = &[0xef, 0xbb, 0xbf];

/// Reads a text file.
///
/// `what` names the contents in errors, as in `"the scene"`; `fix` is the advice on which file is meant; `most` is the
/// largest accepted size \[bytes\].
///
/// # Errors
/// [`ErrorKind::Input`], naming the file, if it does not exist, is a folder, is too large, or is not UTF-8.
pub(crate) fn read(path: &Path, what: &str, fix: &str, most: u64) -> Result<String> {
    let bytes = bytes(path, what, fix, most)?;
    Ok(of(&bytes).map_err(|e| e.within(path.display()))?.to_owned())
}

/// Reads a file of at most `most` bytes. Never reads further, so that endless devices are safe.
///
/// # Errors
/// [`ErrorKind::Input`], naming the file, if it does not exist, is a folder, or is too large.
pub(crate) fn bytes(path: &Path, what: &str, fix: &str, most: u64) -> Result<Vec<u8>> {
    let fault = |e: std::io::Error| Error::io(path, &format!("read {what}"), &e).fix(fix);
    let refused = |found: String, wanted: String| {
        let error = Error::new(ErrorKind::Input, format!("cannot read {what}")).at(path.display());
        error.found(found).wanted(wanted).fix(fix)
    };
    if path.is_dir() {
        return Err(refused("a folder".into(), "a file".into()));
    }
    let mut bytes = Vec::new();
    File::open(path).map_err(fault)?.take(most + 1).read_to_end(&mut bytes).map_err(fault)?;
    if bytes.len() as u64 > most {
        return Err(refused(format!("more than {most} bytes"), format!("at most {most} bytes")));
    }
    Ok(bytes)
}

/// Decodes the bytes of a file as UTF-8, without a byte order mark.
///
/// # Errors
/// [`ErrorKind::Input`] if the bytes are not UTF-8; the caller adds the file name.
pub(crate) fn of(bytes: &[u8]) -> Result<&str> {
    std::str::from_utf8(unmarked(bytes)).map_err(|e| {
        let found = match bytes {
            [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "text in UTF-16".to_owned(),
            _ => {
                let before = unmarked(bytes)[..e.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
                format!("a byte that is not UTF-8 in line {}", before + 1)
            }
        };
        Error::new(ErrorKind::Input, "the file is not text in UTF-8")
            .found(found)
            .wanted("text in UTF-8")
            .fix("save the file as UTF-8 in an editor, or give the right file")
    })
}

/// The bytes after a byte order mark, or all of them if there is none.
pub(crate) fn unmarked(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(MARK).unwrap_or(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_is_no_text() {
        assert_eq!(of(b"\xef\xbb\xbfa = 1").unwrap(), "a = 1");
        assert_eq!(of(b"a = 1").unwrap(), "a = 1");
        assert_eq!(unmarked(b"\xef\xbb"), b"\xef\xbb");
        // only the first one is a mark
        assert_eq!(of(b"\xef\xbb\xbf\xef\xbb\xbf").unwrap(), "\u{feff}");
    }

    #[test]
    fn what_is_no_text_is_named() {
        let told = |bytes: &[u8]| of(bytes).unwrap_err().to_string();
        assert!(told(b"\xff\xfea\0").contains("UTF-16"));
        assert!(told(b"a\nb\n\xe9").contains("line 3"));
    }

    #[test]
    fn a_file_is_read_within_its_size() {
        let folder = std::env::temp_dir().join(format!("gradreel-text-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("note.toml");
        std::fs::write(&file, "\u{feff}12345678").unwrap();
        assert_eq!(read(&file, "the note", "write one", 11).unwrap(), "12345678");
        for (path, most, found) in [(&file, 10, "more than 10 bytes"), (&folder, 10, "a folder")] {
            let error = read(path, "the note", "write one", most).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Input);
            let told = error.to_string();
            assert!(told.contains(found) && told.contains("the note") && told.contains("gradreel-text"), "{told}");
        }
        std::fs::write(&file, b"caf\xe9").unwrap();
        let told = read(&file, "the note", "write one", 10).unwrap_err().to_string();
        assert!(told.contains("note.toml") && told.contains("UTF-8"), "{told}");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn a_device_without_end_is_too_large() {
        assert!(
            read(Path::new("/dev/zero"), "the scene", "write one", 1 << 16)
                .unwrap_err()
                .to_string()
                .contains("more than 65536")
        );
    }
}
