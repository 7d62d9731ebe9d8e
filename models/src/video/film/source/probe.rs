//! What ffprobe tells of a video file.

use std::ffi::OsString;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::Info;
use super::brightness::Transfer;
use super::limits::check_size;
use super::{capture, lens};

/// Maximum length of what ffprobe may say \[bytes\].
const MOST_SAID: u64 = 1 << 22;

/// Maximum ratio of a pixel's sides that is believed.
const MOST_OBLONG: f64 = 4.0;

/// Coarsest time resolution of containers \[s\].
const UNIT: f64 = 0.001;

/// A video stream as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Probed {
    pub info: Info,
    /// Pictures per second of the file's time.
    pub rate: Option<f64>,
    /// Real seconds per second of the file.
    pub real: f64,
    /// Width over height of a pixel as stored.
    pub pixel: f64,
    /// Filter that turns the shrunk pictures; `None` leaves it to ffmpeg, which turns them before.
    pub turn: Option<&'static str>,
    pub has_alpha: bool,
    pub is_interlaced: bool,
    /// The curve of a film of high dynamic range, and whether its colours are those of BT.2020.
    pub transfer: Option<(Transfer, bool)>,
}

/// One of ffmpeg's programs on a local file, restricted to the file protocol: a playlist must not open a
/// connection. The options are for reading it.
pub(super) fn command(program: &str, options: &[&str], path: &Path) -> Command {
    let mut command = Command::new(program);
    let mut file = OsString::from("file:");
    file.push(path);
    command
        .args(["-v", "error", "-protocol_whitelist", "file,pipe"])
        .args(options)
        .arg("-i")
        .arg(file)
        .stdin(Stdio::null());
    command
}

/// Reads what the file says of its first video stream. Cover pictures of music are no video.
pub(super) fn read(path: &Path) -> Result<Probed> {
    let mut child = command("ffprobe", &[], path)
        .args(["-show_streams", "-show_format", "-of", "json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| missing(path, "ffprobe", &e))?;
    let stderr = child.stderr.take().expect("piped");
    let said = std::thread::spawn(move || {
        let mut said = Vec::new();
        // what comes before a read error is enough, and the rest must not fill the pipe
        let mut stderr = stderr;
        let _ = stderr.by_ref().take(1 << 16).read_to_end(&mut said);
        let _ = std::io::copy(&mut stderr, &mut std::io::sink());
        String::from_utf8_lossy(&said).into_owned()
    });
    let mut text = Vec::new();
    let read = child.stdout.take().expect("piped").take(MOST_SAID).read_to_end(&mut text);
    let status = child.wait().map_err(|e| Error::io(path, "look at the film", &e))?;
    let said = said.join().unwrap_or_default();
    read.map_err(|e| Error::io(path, "read what ffprobe says", &e))?;
    if !status.success() {
        return Err(undecodable(path, &said));
    }
    let told: Value = serde_json::from_slice(&text).map_err(|e| undecodable(path, &e.to_string()))?;
    described(path, &told)
}

/// The description in ffprobe's words.
fn described(path: &Path, told: &Value) -> Result<Probed> {
    let streams = told["streams"].as_array().map_or(&[][..], Vec::as_slice);
    let is_video = |stream: &&Value| stream["codec_type"] == "video" && stream["disposition"]["attached_pic"] != 1;
    let Some(stream) = streams.iter().find(is_video) else { return Err(pictureless(path, streams)) };
    let number = |value: &Value| value.as_f64().or_else(|| value.as_str()?.parse().ok());
    let text = |name: &str| stream[name].as_str().unwrap_or_default();
    let side = |name: &str| stream[name].as_u64().and_then(|side| usize::try_from(side).ok()).unwrap_or(0);
    let (width, height) = (side("width"), side("height"));
    check_size(path, (width, height))?;
    let tags = || {
        let of = |value: &'static str| [&stream[value], &told["format"][value]];
        let tags = of("tags").into_iter().filter_map(Value::as_object).flatten();
        tags.filter_map(|(name, value)| Some((name.as_str(), value.as_str()?)))
    };
    let tag = |end: &str| tags().find(|(name, _)| name.ends_with(end)).map(|(_, value)| value.trim().to_owned());
    let mut said = Vec::new();

    let rotation = stream["side_data_list"].as_array().into_iter().flatten().find_map(|data| number(&data["rotation"]));
    let rotation = rotation.unwrap_or(0.0);
    let is_upended = ((rotation.abs() + 45.0) / 90.0).floor() as i64 % 2 == 1;
    let mut pixel = ratio(text("sample_aspect_ratio"), ':').unwrap_or(1.0);
    if !(1.0 / MOST_OBLONG..=MOST_OBLONG).contains(&pixel) {
        said.push(format!(
            "the file says that its pixels are {pixel:.3} times as wide as high: they are taken for squares"
        ));
        pixel = 1.0;
    }
    let turned = |(width, height)| if is_upended { (height, width) } else { (width, height) };
    let part = |side: usize, share: f64| ((side as f64 * share).round() as usize).max(1);
    let size = turned((part(width, pixel.min(1.0)), part(height, (1.0 / pixel).min(1.0))));
    if (pixel - 1.0).abs() > 0.02 {
        said.push(format!("its pixels are {pixel:.3} times as wide as high, as the file says: they are made squares"));
    }

    let rate = ratio(text("avg_frame_rate"), '/').or_else(|| ratio(text("r_frame_rate"), '/'));
    let speed = capture::speed(tags(), rate);
    said.extend(speed.said);
    let seconds = number(&stream["duration"]).or_else(|| number(&told["format"]["duration"]));
    let counted = seconds.zip(rate).map(|(seconds, rate)| (seconds * rate).round()).filter(|count| *count >= 1.0);
    let count = number(&stream["nb_frames"]).filter(|count| *count >= 1.0).or(counted).map(|count| count as usize);
    let transfer = Transfer::of(text("color_transfer"));
    said.extend(transfer.map(Transfer::said));
    let focal = tag("camera.focal_length.35mm_equivalent").and_then(|text| text.parse::<f64>().ok());
    let format = text("pix_fmt");
    let is_interlaced = matches!(text("field_order"), "tt" | "bb" | "tb" | "bt");
    if is_interlaced {
        said.push("the film is interlaced: one picture is made of each two fields".to_owned());
    }
    Ok(Probed {
        info: Info {
            size,
            stored: turned((width, height)),
            count,
            rate: rate.map(|rate| rate / speed.real),
            capture_rate: speed.capture_rate,
            unit: UNIT,
            few_colours: false,
            focal: focal.and_then(lens::share),
            said,
        },
        rate,
        real: speed.real,
        pixel,
        turn: turn(stream, rotation),
        has_alpha: ["rgba", "bgra", "argb", "abgr", "yuva", "gbrap", "ya8", "ya16", "pal8"]
            .iter()
            .any(|name| format.starts_with(name))
            || tag("alpha_mode").is_some_and(|mode| mode == "1"),
        is_interlaced,
        transfer: transfer.map(|transfer| (transfer, text("color_primaries") == "bt2020")),
    })
}

/// The filter for a rotation by a quarter of a turn or several, counted against the clock; `None` if the display
/// matrix mirrors pictures or turns them by another angle.
fn turn(stream: &Value, rotation: f64) -> Option<&'static str> {
    let data = stream["side_data_list"].as_array()?.iter().find_map(|data| data["displaymatrix"].as_str())?;
    let rows = data.lines().filter_map(|line| line.split_once(':'));
    let row = |(_, row): (&str, &str)| {
        row.split_whitespace().map(|word| word.parse::<f64>().ok()).collect::<Option<Vec<_>>>()
    };
    let matrix: Vec<Vec<f64>> = rows.map(row).collect::<Option<_>>()?;
    let [[a, b, _], [c, d, _], _] =
        &matrix.iter().map(|row| <[f64; 3]>::try_from(row.as_slice()).ok()).collect::<Option<Vec<_>>>()?[..]
    else {
        return None;
    };
    if a * d - b * c <= 0.0 {
        return None;
    }
    match rotation.rem_euclid(360.0) {
        0.0 => Some("null"),
        90.0 => Some("transpose=cclock"),
        180.0 => Some("hflip,vflip"),
        270.0 => Some("transpose=clock"),
        _ => None,
    }
}

/// The positive ratio in `30000/1001` or `4:3`.
fn ratio(text: &str, between: char) -> Option<f64> {
    let (over, under) = text.split_once(between)?;
    let ratio = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
    (ratio.is_finite() && ratio > 0.0).then_some(ratio)
}

/// A file without a video stream.
fn pictureless(path: &Path, streams: &[Value]) -> Error {
    let mut kinds: Vec<&str> = streams.iter().filter_map(|stream| stream["codec_type"].as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    Error::new(ErrorKind::Input, "the file has no moving picture")
        .at(path.display())
        .found(if kinds.is_empty() {
            "no video stream".into()
        } else {
            format!("no video stream, only {}", kinds.join(", "))
        })
        .wanted("a video stream that ffmpeg decodes")
        .fix("give the film itself, or export it again with its pictures")
}

/// ffmpeg or ffprobe cannot be started.
pub(super) fn missing(path: &Path, program: &str, error: &std::io::Error) -> Error {
    Error::new(ErrorKind::Input, "video files are decoded by ffmpeg, which cannot be run")
        .at(path.display())
        .found(format!("{program}: {error}"))
        .wanted("ffmpeg and ffprobe, version 5.1 or later, on the path")
        .fix("install ffmpeg, or export the film as GIF or as a folder of PNG images")
}

/// ffmpeg or ffprobe ended with an error.
pub(super) fn undecodable(path: &Path, said: &str) -> Error {
    let lines: Vec<&str> = said.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let has = |part: &str| lines.iter().any(|line| line.contains(part));
    let fix = if has("moov atom not found") {
        "copy the whole file again: its index, which is written last, is missing"
    } else if ["Unrecognized option", "Option not found", "No such filter", "Error reinitializing filters"]
        .iter()
        .any(|part| has(part))
    {
        "install ffmpeg 5.1 or later"
    } else {
        "copy or export the film again, for example as H.264"
    };
    Error::new(ErrorKind::Input, "ffmpeg cannot decode the film")
        .at(path.display())
        .found(lines.first().copied().unwrap_or("no word why"))
        .wanted("a whole video file that ffmpeg 5.1 or later can read")
        .fix(fix)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(stream: Value, format: Value) -> Result<Probed> {
        described("film.mp4".as_ref(), &serde_json::json!({ "streams": [stream], "format": format }))
    }

    #[test]
    fn a_file_is_described_as_it_is_shown() {
        let stream = serde_json::json!({
            "codec_type": "video", "width": 1440, "height": 1080, "sample_aspect_ratio": "4:3", "pix_fmt": "yuv420p10le",
            "avg_frame_rate": "30000/1001", "nb_frames": "90", "color_transfer": "arib-std-b67", "color_primaries": "bt2020",
            "side_data_list": [{ "rotation": -90 }],
        });
        let tags = serde_json::json!({ "tags": {
            "com.android.capture.fps": "240.0", "com.apple.quicktime.camera.focal_length.35mm_equivalent": "26" } });
        let found = of(stream, tags).unwrap();
        assert_eq!((found.info.size, found.info.stored), ((810, 1440), (1080, 1440)));
        assert_eq!((found.info.count, found.real, found.transfer), (Some(90), 0.125, Some((Transfer::Hlg, true))));
        assert!(
            (found.info.rate.unwrap() - 239.76).abs() < 0.01
                && (found.info.focal.unwrap() - 26.0 / 43.27).abs() < 1e-12
        );
        assert_eq!(found.info.said.len(), 3, "{:?}", found.info.said);
    }

    #[test]
    fn quarter_turns_are_told_from_mirrors() {
        let data = |rotation: i32, matrix: [i32; 4]| {
            let [a, b, c, d] = matrix.map(|x| x << 16);
            let text = format!("\n00000000: {a} {b} 0\n00000001: {c} {d} 0\n00000002: 0 56623104 1073741824\n");
            let stream = serde_json::json!({ "side_data_list": [{ "displaymatrix": text, "rotation": rotation }] });
            turn(&stream, f64::from(rotation))
        };
        assert_eq!(data(90, [0, -1, 1, 0]), Some("transpose=cclock"));
        assert_eq!(data(-90, [0, 1, -1, 0]), Some("transpose=clock"));
        assert_eq!(data(-180, [-1, 0, 0, -1]), Some("hflip,vflip"));
        assert_eq!(data(0, [-1, 0, 0, 1]), None, "a mirror");
        assert_eq!(data(45, [1, -1, 1, 1]), None);
        assert_eq!(turn(&serde_json::json!({}), 0.0), None);
    }

    #[test]
    fn what_has_no_pictures_is_refused() {
        let cover =
            serde_json::json!({ "codec_type": "video", "width": 9, "height": 9, "disposition": { "attached_pic": 1 } });
        let music = serde_json::json!({ "streams": [{ "codec_type": "audio" }, cover], "format": {} });
        let told = described("song.mp4".as_ref(), &music).unwrap_err().to_string();
        assert!(told.contains("no video stream") && told.contains("audio"), "{told}");
        let huge = serde_json::json!({ "codec_type": "video", "width": 20_000, "height": 20_000 });
        assert!(of(huge, Value::Null).unwrap_err().to_string().contains("too large"));
        let told = undecodable("a.mp4".as_ref(), "[mov] moov atom not found\na.mp4: Invalid data").to_string();
        assert!(told.contains("moov atom not found") && told.contains("index"), "{told}");
    }
}
