//! Video files, decoded by ffmpeg.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

use gradreel::{Error, ErrorKind, Result};

use super::pile::{Pile, check_size};
use super::{Clock, Decoded, Wanted};
use crate::video::image::Image;

/// Nominal rate at which pictures leave the decoder; their actual times are read separately \[1/s\].
const RATE: u32 = 25;

/// Resolution of the printed times \[1/s\].
const TICKS: u32 = 1_000_000_000;

/// Coarsest time resolution of containers \[s\].
const UNIT: f64 = 0.001;

/// Maximum length of ffmpeg's messages that is kept \[bytes\].
const MOST_SAID: usize = 1 << 16;

/// Decodes the wanted frames with their times, rotated as the file's metadata state.
pub(super) fn read(path: &Path, wanted: Wanted) -> Result<Decoded> {
    // pass each frame once: its time is printed to stderr, and even timestamps keep ffmpeg from dropping or
    // repeating frames
    let print = "metadata=mode=add:key=shown:value=1,metadata=mode=print:file=pipe\\\\:2";
    let filter = format!("select=gte(n\\,{}),settb=1/{TICKS},{print},settb=1/{RATE},setpts=N,fps={RATE}", wanted.first);
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
    let told = child.stderr.take().map(|stderr| std::thread::spawn(move || told(BufReader::new(stderr))));
    let mut pipe = BufReader::new(child.stdout.take().expect("piped"));
    let mut pile = Pile::default();
    let read = loop {
        match picture(path, &mut pipe).and_then(|image| image.map(|image| pile.add(path, wanted, image)).transpose()) {
            Ok(Some(())) => {}
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    drop(pipe);
    let status = child.wait().map_err(|e| Error::io(path, "decode the film", &e))?;
    let (times, said) = told.and_then(|thread| thread.join().ok()).unwrap_or_default();
    read?;
    if !status.success() {
        return Err(undecodable(path, &said));
    }
    let count = pile.images.len();
    let shown = match times.get(..count).map(|times| times.iter().copied().collect::<Option<Vec<f64>>>()) {
        Some(Some(shown)) => shown,
        // a stream without timestamps
        _ => {
            let rate = rate(path)?;
            (0..count).map(|k| k as f64 / rate).collect()
        }
    };
    Ok(Decoded { clock: Some(Clock { shown, until: None, unit: UNIT }), ..Decoded::of(pile) })
}

/// The times of the decoded frames, and ffmpeg's other messages.
fn told(mut stderr: impl BufRead) -> (Vec<Option<f64>>, String) {
    let (mut times, mut said) = (Vec::new(), String::new());
    let mut line = Vec::new();
    // output before a read error is sufficient
    while stderr.by_ref().take(MOST_SAID as u64).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
        let text = String::from_utf8_lossy(&line);
        if text.starts_with("frame:") {
            let ticks =
                text.split_once(" pts:").and_then(|(_, rest)| rest.split_whitespace().next()?.parse::<i64>().ok());
            times.push(ticks.map(|ticks| ticks as f64 / f64::from(TICKS)));
        } else if !text.starts_with("shown=") && said.len() < MOST_SAID {
            said.push_str(&text);
        }
        line.clear();
    }
    (times, said)
}

/// One of ffmpeg's programs on a local file, restricted to the file protocol: a playlist must not open a
/// connection.
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

/// A tag of the file or its video stream whose name ends with `name`.
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
fn picture(path: &Path, pipe: &mut impl BufRead) -> Result<Option<Image>> {
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
    check_size(path, (width, height))?;
    let mut bytes = vec![0; width * height * 4];
    pipe.read_exact(&mut bytes).map_err(failed)?;
    let pixels = bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    Ok(Some(Image { width, height, pixels, has_alpha: true }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_from_errors() {
        let text = "frame:0    pts:83333333    pts_time:0.0833333\nshown=1\n[h264] error\nframe:1 pts:NOPTS pts_time:NOPTS\nshown=1\n";
        let (times, said) = told(text.as_bytes());
        assert_eq!((times, said.as_str()), (vec![Some(0.083_333_333), None], "[h264] error\n"));
    }
}
