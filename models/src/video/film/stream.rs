//! Video files, decoded by ffmpeg.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use gradreel::{Error, ErrorKind, Result};

use super::{Decoded, Wanted, check_bytes};
use crate::video::image::Image;

/// Decodes the wanted frames at the stream's mean rate, turned the way the file says they were filmed.
pub(super) fn read(path: &Path, wanted: Wanted) -> Result<Decoded> {
    let rate = rate(path)?;
    let frames = format!("select=gte(n\\,{})", wanted.first);
    let filter = format!("fps={rate},{frames}");
    let mut command = decoder("ffmpeg", path);
    command.args(["-vf", &filter, "-f", "image2pipe", "-c:v", "pam", "-pix_fmt", "rgba"]);
    if wanted.count < usize::MAX {
        command.args(["-frames:v", &wanted.count.to_string()]);
    }
    let mut child = command
        .arg("pipe:1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| missing(path, "ffmpeg", &e))?;
    let errors = child.stderr.take().map(|mut stderr| {
        std::thread::spawn(move || {
            let mut text = String::new();
            // what it has said up to an unreadable byte is enough
            let _ = stderr.read_to_string(&mut text);
            text
        })
    });
    let mut pipe = BufReader::new(child.stdout.take().expect("piped"));
    let mut images = Vec::new();
    let read = loop {
        match picture(path, &mut pipe, images.len()) {
            Ok(Some(image)) => images.push(image),
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    drop(pipe);
    let status = child.wait().map_err(|e| Error::io(path, "decode the film", &e))?;
    let said = errors.and_then(|thread| thread.join().ok()).unwrap_or_default();
    read?;
    if !status.success() {
        return Err(undecodable(path, &said));
    }
    Ok(Decoded { images, frames_per_s: Some(rate), few_colours: false })
}

/// One of ffmpeg's programs on a local file, and nothing but files: a playlist must not open a connection.
fn decoder(program: &str, path: &Path) -> Command {
    let mut command = Command::new(program);
    let mut file = std::ffi::OsString::from("file:");
    file.push(path);
    command.args(["-v", "error", "-protocol_whitelist", "file,pipe", "-i"]).arg(file).stdin(Stdio::null());
    command
}

/// The mean frame rate of the first video stream \[1/s\].
fn rate(path: &Path) -> Result<f64> {
    let output = decoder("ffprobe", path)
        .args(["-select_streams", "v:0", "-show_entries", "stream=avg_frame_rate", "-of", "csv=p=0"])
        .output()
        .map_err(|e| missing(path, "ffprobe", &e))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let ratio = text.trim().trim_end_matches(',').split_once('/');
    let rate = ratio.and_then(|(over, under)| Some(over.parse::<f64>().ok()? / under.parse::<f64>().ok()?));
    match rate.filter(|rate| output.status.success() && *rate > 0.0 && rate.is_finite()) {
        Some(rate) => Ok(rate),
        None => Err(undecodable(path, &String::from_utf8_lossy(&output.stderr))),
    }
}

/// A tag of the file or its video stream, by how its name ends.
pub(super) fn tag(path: &Path, name: &str) -> Option<String> {
    let entries = "format_tags:stream_tags";
    let output = decoder("ffprobe", path)
        .args(["-select_streams", "v:0", "-show_entries", entries, "-of", "default=noprint_wrappers=1"])
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut tags = text.lines().filter_map(|line| line.split_once('='));
    tags.find(|(key, _)| key.ends_with(name)).map(|(_, value)| value.to_owned())
}

fn missing(path: &Path, program: &str, error: &std::io::Error) -> Error {
    Error::new(ErrorKind::Input, "video files are decoded by ffmpeg, which cannot be run")
        .at(path.display())
        .found(format!("{program}: {error}"))
        .fix("install ffmpeg, or export the film as GIF or as a folder of PNG images")
}

fn undecodable(path: &Path, said: &str) -> Error {
    let said = said.trim();
    Error::new(ErrorKind::Input, "ffmpeg cannot decode the film")
        .at(path.display())
        .found(if said.is_empty() { "no video stream" } else { said.lines().next().unwrap_or_default() })
        .fix("copy or export the film again")
}

/// The next picture of a sequence of PAM images; `None` at its end.
fn picture(path: &Path, pipe: &mut impl BufRead, before: usize) -> Result<Option<Image>> {
    let (mut width, mut height) = (0, 0);
    let failed = |e: std::io::Error| Error::io(path, "read what ffmpeg decoded", &e);
    loop {
        let mut line = String::new();
        if pipe.by_ref().take(256).read_line(&mut line).map_err(failed)? == 0 {
            return Ok(None);
        }
        let mut words = line.split_whitespace();
        let mut number = || words.nth(1).and_then(|word| word.parse().ok()).unwrap_or(0);
        match line.split_whitespace().next() {
            Some("WIDTH") => width = number(),
            Some("HEIGHT") => height = number(),
            Some("ENDHDR") => break,
            _ => {}
        }
    }
    check_bytes(path, width, height, before + 1)?;
    let mut bytes = vec![0; width * height * 4];
    pipe.read_exact(&mut bytes).map_err(failed)?;
    let pixels = bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    Ok(Some(Image { width, height, pixels, has_alpha: true }))
}
