//! Files that hold no numbers at all, named for what they are.
//!
//! What stands at the place of a file of weights is often what a download left there: a pointer of Git LFS, a page that asks
//! to sign in, an error message. The first bytes tell.

use crate::io::checkpoint;
use crate::io::source::Source;
use crate::{Error, ErrorKind, Result};

/// As much of a file as is looked at \[bytes\].
const START: usize = 4096;

const AGAIN: &str = "download the file again; sign in or accept its licence first, if its page asks for that";

/// Binary files that are taken for weights: first bytes, name, what to do.
const KNOWN: [(&[u8], &str, &str); 12] = [
    (b"\x1f\x8b", "a gzip archive", "unpack it, and give the path of the file in it"),
    (b"BZh", "a bzip2 archive", "unpack it, and give the path of the file in it"),
    (b"\xfd7zXZ\0", "an xz archive", "unpack it, and give the path of the file in it"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", "unpack it, and give the path of the file in it"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "unpack it, and give the path of the file in it"),
    (b"Rar!", "a RAR archive", "unpack it, and give the path of the file in it"),
    (b"\x89HDF", "an HDF5 file", "convert it to safetensors with the program that wrote it"),
    (b"GGUF", "a GGUF file", "take the safetensors of the same model"),
    (b"\x89PNG", "a PNG picture", "give the path of the file of weights"),
    (b"\xff\xd8\xff", "a JPEG picture", "give the path of the file of weights"),
    (b"%PDF", "a PDF document", "give the path of the file of weights"),
    (b"\x7fELF", "a program", "give the path of the file of weights"),
];

/// An error that names a file for what it is, if its first bytes (4 kB are enough) say that it holds no numbers: an empty
/// file, a Git LFS pointer, a web page, JSON or other text, a compressed archive, a picture. `wanted` is what it should be.
///
/// ```
/// let page = b"<!DOCTYPE html><html><head><title>Sign in</title></head></html>";
/// let error = gradreel::io::foreign(page, "safetensors").expect("no weights");
/// assert!(error.to_string().contains("a web page, \"Sign in\""));
/// assert!(gradreel::io::foreign(&[8, 0, 0, 0, 0, 0, 0, 0, b'{'], "safetensors").is_none());
/// ```
pub fn foreign(start: &[u8], wanted: &str) -> Option<Error> {
    let start = &start[..start.len().min(START)];
    let (found, fix) = of_binary(start).or_else(|| of_text(start))?;
    Some(Error::new(ErrorKind::Input, "the file holds no weights").found(found).wanted(wanted).fix(fix))
}

/// Refuses a file that is none of numbers.
pub(super) fn refuse_foreign(source: &Source, wanted: &str) -> Result<()> {
    let start = source.head(START)?;
    match checkpoint::is_stream(&start) {
        true => Ok(()),
        false => foreign(&start, wanted).map_or(Ok(()), Err),
    }
}

fn of_binary(start: &[u8]) -> Option<(String, &'static str)> {
    let told = |what: &str, fix| Some((what.to_owned(), fix));
    if start.is_empty() {
        return told("an empty file", "download or copy the file again");
    }
    if start.len() >= 8 && start.iter().all(|byte| *byte == 0) {
        return told("zeros: a download that was never filled", "download or copy the file again");
    }
    if start.get(257..262) == Some(b"ustar") {
        return told("a tar archive", "unpack it, and give the path of the file in it");
    }
    let known = KNOWN.iter().find(|(magic, ..)| start.starts_with(magic));
    known.and_then(|(_, what, fix)| told(what, *fix))
}

fn of_text(start: &[u8]) -> Option<(String, &'static str)> {
    let text = text(start)?;
    let small = text.to_lowercase();
    if text.starts_with("version https://git-lfs") {
        let size = text.lines().find_map(|line| line.strip_prefix("size ")).unwrap_or("?").trim();
        let found = format!("a Git LFS pointer, the text that stands for a file of {size} bytes");
        return Some((found, "fetch the file itself with `git lfs pull`, or download it from its page"));
    }
    if text.starts_with('<') && (small.contains("<html") || small.contains("<!doctype html")) {
        let title = small.find("<title").and_then(|at| {
            let (_, rest) = text.get(at..)?.split_once('>')?;
            rest.split('<').next()
        });
        let title = title.map(str::trim).filter(|title| !title.is_empty());
        return Some((title.map_or("a web page".to_owned(), |title| format!("a web page, {:?}", short(title))), AGAIN));
    }
    let begins = format!("which begins with {:?}", short(text));
    match text.as_bytes() {
        [b'<', ..] => Some((format!("XML text, {begins}"), AGAIN)),
        [b'{' | b'[', ..] if text.contains("\"weight_map\"") => {
            let fix = "give the path of one of the files that it names, or merge them into one";
            Some(("JSON text: the index of a model in several files".to_owned(), fix))
        }
        [b'{' | b'[', ..] => Some((format!("JSON text, {begins}"), AGAIN)),
        _ => Some((
            format!("text, {begins}"),
            "give the path of the file of weights; if this should be it, download it again",
        )),
    }
}

/// The start of a text without byte order mark and white space; `None` for what is no text.
fn text(start: &[u8]) -> Option<&str> {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let text = match str::from_utf8(start) {
        Ok(text) => text,
        // a letter may be cut at the end of what is looked at
        Err(e) if e.error_len().is_none() => str::from_utf8(&start[..e.valid_up_to()]).ok()?,
        Err(_) => return None,
    };
    let printed = |c: char| !c.is_control() || matches!(c, '\n' | '\r' | '\t' | '\x0c');
    let text = text.trim_start();
    (!text.is_empty() && text.chars().all(printed)).then_some(text)
}

fn short(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    line.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_download_left_is_named() {
        let tar = [vec![b'a'; 257], b"ustar".to_vec()].concat();
        let cases: [(&[u8], &str); 12] = [
            (b"", "an empty file"),
            (&[0; 64], "zeros"),
            (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n", "a file of 12345 bytes"),
            (b"\xef\xbb\xbf\n<HTML><body>no</body></HTML>", "a web page"),
            (b"<html><head><title>Sign\xc3\xa9</title>", "a web page, \"Sign\u{e9}\""),
            (b"<?xml version='1.0'?><Error><Code>AccessDenied</Code></Error>", "XML text"),
            (b"{\"error\": \"Repository not found\"}", "JSON text, which begins with \"{\\\"error\\\""),
            (b"{\"metadata\": {}, \"weight_map\": {}}", "the index of a model in several files"),
            (b"Entry not found", "text, which begins with \"Entry not found\""),
            (b"\x1f\x8b\x08\0", "a gzip archive"),
            (&tar, "a tar archive"),
            (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
        ];
        for (start, wanted) in cases {
            let error = foreign(start, "weights").expect(wanted).to_string();
            assert!(error.contains(wanted) && error.contains("fix: "), "{error}");
        }
        for numbers in [&b"PK\x03\x04"[..], b"\x80\x02}.", b"\x93NUMPY\x01\0", &[200, 1, 0, 0, 0, 0, 0, 0, b'{', b'"']]
        {
            assert!(foreign(numbers, "weights").is_none());
        }
    }
}
