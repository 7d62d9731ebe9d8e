//! Passes over small films, in which each picture tells its number by its grey.

use std::path::{Path, PathBuf};
use std::process::Command;

use gif::{Encoder, Frame, Repeat};
use gradreel::ErrorKind;
use tempfile::TempDir;

use super::pictures::Picture;
use super::*;
use crate::video::image::Image;

/// A folder for films that ffmpeg makes.
struct Folder(TempDir);

/// Pictures of 96 × 64 pixels, 25 a second, the luma of picture `N` being `40 + 5 N`.
const GREYS: &str = "color=black:size=96x64:rate=25,geq=lum='40+5*N':cb=128:cr=128";

impl Folder {
    /// `None` on a machine without ffmpeg, which CI is not.
    fn new() -> Option<Self> {
        if Command::new("ffmpeg").arg("-version").output().is_err() {
            assert!(std::env::var_os("CI").is_none(), "CI has ffmpeg");
            return None;
        }
        Some(Self(TempDir::new().unwrap()))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs ffmpeg with these arguments, the last of which is the name of the file to be made.
    #[track_caller]
    fn make(&self, arguments: &[&str]) -> PathBuf {
        assert!(self.makes(arguments), "{arguments:?}");
        self.path(arguments[arguments.len() - 1])
    }

    fn makes(&self, arguments: &[&str]) -> bool {
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-y"]).args(arguments).current_dir(self.0.path());
        command.output().unwrap().status.success()
    }

    /// The first `count` of the grey pictures, with further options.
    #[track_caller]
    fn greys(&self, count: usize, more: &[&str], name: &str) -> PathBuf {
        let count = count.to_string();
        let given = [&["-f", "lavfi", "-i", GREYS, "-frames:v", &count], more, &[name]].concat();
        self.make(&given)
    }
}

/// All pictures of a pass.
fn read(film: &Path, fps: Option<f64>, pass: Pass) -> Result<Vec<Picture>> {
    Source::open(film, fps)?.pictures(pass)?.collect()
}

/// The number that a picture's grey tells; full range of an 8-bit picture from the range of video.
fn told(image: &Image) -> usize {
    let grey = f64::from(image.pixels[image.pixels.len() / 2][1]);
    ((grey * 219.0 / 255.0 + 16.0 - 40.0) / 5.0).round() as usize
}

#[track_caller]
fn near(found: &[f64], wanted: &[f64], within: f64) {
    let all = found.len() == wanted.len() && found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= within);
    assert!(all, "{found:?} for {wanted:?}");
}

fn times(pictures: &[Picture]) -> Vec<f64> {
    pictures.iter().map(|picture| picture.seconds).collect()
}

#[track_caller]
fn refused(result: Result<Vec<Picture>>, parts: &[&str]) {
    let error = result.expect_err("a film that cannot be used");
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    for part in parts.iter().chain(&["fix: "]) {
        assert!(error.to_string().contains(part), "no {part:?} in: {error}");
    }
}

#[test]
fn a_film_is_passed_over_as_often_as_wanted() {
    let Some(folder) = Folder::new() else { return };
    let film = folder.greys(20, &["-pix_fmt", "yuv420p", "-crf", "1"], "film.mp4");
    let source = Source::open(&film, None).unwrap();
    let info = source.info();
    assert_eq!((info.size, info.count, info.few_colours), ((96, 64), Some(20), false));
    near(&[info.rate.unwrap()], &[25.0], 1e-9);
    for pass in [
        Pass::whole(640),
        Pass { longer: 48, first: 3, last: Some(11), every: 1 },
        Pass { longer: 30, first: 2, last: Some(17), every: 4 },
    ] {
        let pictures: Vec<Picture> = source.pictures(pass).unwrap().map(Result::unwrap).collect();
        let numbers: Vec<usize> = (pass.first..=pass.last.unwrap_or(19)).step_by(pass.every).collect();
        assert_eq!(pictures.iter().map(|picture| picture.number).collect::<Vec<_>>(), numbers);
        assert_eq!(pictures.iter().map(|picture| told(&picture.image)).collect::<Vec<_>>(), numbers);
        near(&times(&pictures), &numbers.iter().map(|k| *k as f64 / 25.0).collect::<Vec<_>>(), 1e-6);
        let longer = pass.longer.min(96);
        let size = (longer, longer * 2 / 3);
        assert!(pictures.iter().all(|picture| (picture.image.width, picture.image.height) == size));
    }
    near(&times(&read(&film, Some(100.0), Pass::whole(64)).unwrap())[..3], &[0.0, 0.01, 0.02], 1e-12);
    let late = Pass { first: 20, ..Pass::whole(64) };
    refused(read(&film, None, late), &["no frame 20", "has 20", "--first-frame"]);
}

#[test]
fn every_picture_has_its_own_time() {
    let Some(folder) = Folder::new() else { return };
    // the first interval is half as long, and one picture is late
    let uneven = "settb=1/1000,setpts='(if(eq(N,0),0,N-0.5)+if(gt(N,6),0.75,0))*40'";
    let more = ["-vf", uneven, "-fps_mode", "passthrough", "-enc_time_base", "1/1000", "-pix_fmt", "yuv420p"];
    let film = folder.greys(10, &more, "film.mp4");
    let wanted: Vec<f64> = (0..10)
        .map(|k| 0.04 * (if k == 0 { 0.0 } else { f64::from(k) - 0.5 } + if k > 6 { 0.75 } else { 0.0 }))
        .collect();
    let pictures = read(&film, None, Pass::whole(96)).unwrap();
    near(&times(&pictures), &wanted, 6e-4);
    // of a part too, time counts from the film's beginning
    near(&times(&read(&film, None, Pass { first: 7, ..Pass::whole(96) }).unwrap()), &wanted[7..], 6e-4);
    // an edit list hides the first pictures: those that are shown count
    let long = folder.greys(20, &["-pix_fmt", "yuv420p", "-crf", "1", "-g", "20", "-bf", "0"], "long.mp4");
    assert!(folder.makes(&["-ss", "0.2", "-i", "long.mp4", "-c", "copy", "cut.mp4"]), "{long:?}");
    let pictures = read(&folder.path("cut.mp4"), None, Pass::whole(96)).unwrap();
    assert_eq!(pictures.iter().map(|picture| told(&picture.image)).collect::<Vec<_>>(), (5..20).collect::<Vec<_>>());
    near(&times(&pictures), &(0..15).map(|k| 0.04 * f64::from(k)).collect::<Vec<_>>(), 1e-3);
    // a stream without any times
    let raw = folder.greys(6, &["-pix_fmt", "yuv420p", "-f", "m4v"], "raw.m4v");
    near(&times(&read(&raw, None, Pass::whole(96)).unwrap()), &[0.0, 0.04, 0.08, 0.12, 0.16, 0.2], 1e-6);
}

#[test]
fn slow_motion_is_undone_as_the_file_says() {
    let Some(folder) = Folder::new() else { return };
    let tag = ["-metadata", "com.android.capture.fps=100.000000", "-movflags", "use_metadata_tags"];
    let film = folder.greys(5, &[&tag[..], &["-pix_fmt", "yuv420p"]].concat(), "film.mp4");
    let source = Source::open(&film, None).unwrap();
    let info = source.info();
    assert_eq!(info.capture_rate, Some(100.0));
    near(&[info.rate.unwrap()], &[100.0], 1e-9);
    assert!(
        info.said
            .iter()
            .any(|line| line.contains("100 frames per second, as the file's tag com.android.capture.fps says"))
    );
    near(&times(&read(&film, None, Pass::whole(96)).unwrap()), &[0.0, 0.01, 0.02, 0.03, 0.04], 1e-6);
    // what a person says weighs more
    let given = Source::open(&film, Some(50.0)).unwrap();
    assert!(given.info().said.is_empty() && given.info().rate == Some(50.0));
    near(&times(&read(&film, Some(50.0), Pass::whole(96)).unwrap())[..2], &[0.0, 0.02], 1e-12);
}

#[test]
fn pictures_are_turned_and_their_pixels_are_squares() {
    let Some(folder) = Folder::new() else { return };
    // the left quarter is white
    let input = "color=black:size=96x64:rate=25,drawbox=x=0:y=0:w=24:h=64:color=white:t=fill";
    folder.make(&["-f", "lavfi", "-i", input, "-frames:v", "2", "-pix_fmt", "yuv420p", "flat.mp4"]);
    let turned = [
        &["-display_rotation:v:0", "90", "-i", "flat.mp4", "-c", "copy", "turned.mp4"][..],
        &["-i", "flat.mp4", "-c", "copy", "-metadata:s:v:0", "rotate=90", "turned.mp4"],
    ];
    assert!(turned.into_iter().any(|arguments| folder.makes(arguments)));
    let film = folder.path("turned.mp4");
    let source = Source::open(&film, None).unwrap();
    assert_eq!((source.info().size, source.info().stored), ((64, 96), (64, 96)));
    let picture = source.pictures(Pass::whole(48)).unwrap().next().unwrap().unwrap().image;
    assert_eq!((picture.width, picture.height), (32, 48));
    let grey = |row: usize| picture.pixels[row * 32 + 16][0];
    // as ffmpeg itself turns them
    let raw = folder.make(&["-i", "turned.mp4", "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "gray", "turned.raw"]);
    let raw = std::fs::read(raw).unwrap();
    assert_eq!(raw.len(), 64 * 96);
    for row in [2, 45] {
        assert!(grey(row).abs_diff(raw[2 * row * 64 + 32]) < 20, "row {row}: {}", grey(row));
    }
    assert!(grey(2).abs_diff(grey(45)) > 200);

    let more = ["-vf", "setsar=2/3", "-pix_fmt", "yuv420p"];
    let oblong = folder.greys(2, &more, "oblong.mp4");
    let source = Source::open(&oblong, None).unwrap();
    assert_eq!((source.info().size, source.info().stored), ((64, 64), (96, 64)));
    assert!(source.info().said.iter().any(|line| line.contains("0.667 times as wide")), "{:?}", source.info().said);
    let picture = source.pictures(Pass::whole(640)).unwrap().next().unwrap().unwrap().image;
    assert_eq!((picture.width, picture.height), (64, 64));
}

#[test]
fn ten_bits_and_high_dynamic_range() {
    let Some(folder) = Folder::new() else { return };
    let deep = folder.greys(3, &["-pix_fmt", "yuv420p10le", "-c:v", "ffv1"], "deep.mkv");
    let pictures = read(&deep, None, Pass::whole(96)).unwrap();
    assert_eq!(pictures.iter().map(|picture| told(&picture.image)).collect::<Vec<_>>(), [0, 1, 2]);
    // HLG: the signal 0.75 is white
    let white = "color=black:size=32x32:rate=25,format=yuv420p10le,geq=lum='64+876*0.75':cb=512:cr=512";
    let hdr = ["-color_trc", "arib-std-b67", "-color_primaries", "bt2020", "-colorspace", "bt2020nc"];
    let made = [&["-f", "lavfi", "-i", white, "-frames:v", "2", "-c:v", "ffv1"][..], &hdr, &["hlg.mkv"]].concat();
    let film = folder.make(&made);
    let source = Source::open(&film, None).unwrap();
    assert!(source.info().said.iter().any(|line| line.contains("HDR (HLG)")), "{:?}", source.info().said);
    let picture = source.pictures(Pass::whole(32)).unwrap().next().unwrap().unwrap().image;
    assert!(picture.pixels.iter().all(|pixel| pixel.iter().all(|value| *value >= 248)), "{:?}", picture.pixels[0]);
}

#[test]
fn what_is_no_film_is_refused_with_the_cause() {
    let Some(folder) = Folder::new() else { return };
    let sound = folder.make(&["-f", "lavfi", "-i", "sine=duration=0.2", "sound.mp4"]);
    refused(read(&sound, None, Pass::whole(96)), &["sound.mp4", "no video stream", "audio"]);
    let noise = "nullsrc=size=96x64:rate=25,geq=random(1)*255:128:128";
    let make = |name: &str, flags: &str| {
        let more = ["-frames:v", "40", "-g", "5", "-pix_fmt", "yuv420p", "-movflags", flags, name];
        folder.make(&[&["-f", "lavfi", "-i", noise][..], &more].concat())
    };
    // the index in front: the frames up to the cut are there
    let film = make("front.mp4", "+faststart");
    let bytes = std::fs::read(&film).unwrap();
    std::fs::write(&film, &bytes[..bytes.len() / 2]).unwrap();
    refused(read(&film, None, Pass::whole(96)), &["front.mp4", "cut off", "whole frames", "--frames"]);
    let part = read(&film, None, Pass { last: Some(9), ..Pass::whole(96) }).unwrap();
    assert_eq!(part.len(), 10);
    // the index at the end: nothing is there
    let film = make("back.mp4", "-faststart");
    let bytes = std::fs::read(&film).unwrap();
    std::fs::write(&film, &bytes[..bytes.len() / 2]).unwrap();
    refused(read(&film, None, Pass::whole(96)), &["back.mp4", "moov", "index"]);
}

/// Decoders conceal damage in mid-film; it must not pass in silence.
#[test]
fn damage_in_mid_film_is_said() {
    let Some(folder) = Folder::new() else { return };
    let noise = "nullsrc=size=96x64:rate=25,geq=random(1)*255:128:128";
    let film = folder.make(&["-f", "lavfi", "-i", noise, "-frames:v", "40", "-pix_fmt", "yuv420p", "film.mp4"]);
    let source = Source::open(&film, None).unwrap();
    assert_eq!(source.pictures(Pass::whole(96)).unwrap().filter(Result::is_ok).count(), 40);
    assert_eq!(source.heard(), None);
    let mut bytes = std::fs::read(&film).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 2000].iter_mut().for_each(|byte| *byte ^= 0xa5);
    std::fs::write(&film, bytes).unwrap();
    let source = Source::open(&film, None).unwrap();
    source.pictures(Pass::whole(96)).unwrap().for_each(drop);
    assert!(source.heard().is_some_and(|heard| heard.contains("the file is damaged")), "{:?}", source.heard());
}

#[test]
fn pictures_that_change_their_size_are_refused() {
    let Some(folder) = Folder::new() else { return };
    let part = |size: &str, name: &str| {
        let input = format!("testsrc=size={size}:rate=25");
        let film = folder.make(&["-f", "lavfi", "-i", &input, "-frames:v", "30", "-pix_fmt", "yuv420p", name]);
        std::fs::read(film).unwrap()
    };
    let film = folder.path("film.ts");
    // of another shape, and of the same
    for other in ["64x64", "192x128"] {
        std::fs::write(&film, [part("96x64", "a.ts"), part(other, "b.ts")].concat()).unwrap();
        refused(read(&film, None, Pass::whole(48)), &["film.ts", "differ in size", "--frames"]);
        assert_eq!(read(&film, None, Pass { last: Some(24), ..Pass::whole(48) }).unwrap().len(), 25);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_pass_that_is_left_ends_its_decoder() {
    let Some(folder) = Folder::new() else { return };
    let film =
        folder.make(&["-f", "lavfi", "-i", "testsrc=size=320x240:rate=25", "-t", "40", "-crf", "40", "long.mp4"]);
    let running = || {
        let processes = std::fs::read_dir("/proc").unwrap().flatten();
        let lines = processes.filter_map(|process| std::fs::read(process.path().join("cmdline")).ok());
        let name = film.to_str().unwrap().as_bytes().to_vec();
        lines.filter(|line| line.windows(name.len()).any(|part| part == name)).count()
    };
    let source = Source::open(&film, None).unwrap();
    let mut pictures = source.pictures(Pass::whole(320)).unwrap();
    assert_eq!(pictures.next().unwrap().unwrap().number, 0);
    assert_eq!(running(), 1);
    drop(pictures);
    assert_eq!(running(), 0);
}

/// A GIF of plain frames of 30 × 20 pixels with these greys and delays \[0.01 s\].
fn drawn(path: &Path, frames: &[(u8, u16)]) {
    let mut encoder = Encoder::new(std::fs::File::create(path).unwrap(), 30, 20, &[]).unwrap();
    encoder.set_repeat(Repeat::Infinite).unwrap();
    for (grey, delay) in frames {
        let mut frame = Frame::from_rgb(30, 20, &vec![*grey; 30 * 20 * 3]);
        frame.delay = *delay;
        encoder.write_frame(&frame).unwrap();
    }
}

#[test]
fn frames_of_a_gif_are_held_for_their_time() {
    let folder = TempDir::new().unwrap();
    let film = folder.path().join("film.gif");
    // a frame at rest for a second, and one without a delay, which is shown for a tenth of a second
    drawn(&film, &[(10, 4), (20, 4), (30, 100), (40, 0), (50, 4)]);
    let source = Source::open(&film, None).unwrap();
    assert_eq!((source.info().size, source.info().count, source.info().few_colours), ((30, 20), Some(5), true));
    let pictures: Vec<Picture> = source.pictures(Pass::whole(15)).unwrap().map(Result::unwrap).collect();
    near(&times(&pictures), &[0.0, 0.04, 0.08, 1.08, 1.18], 1e-9);
    let greys: Vec<u8> = pictures.iter().map(|picture| picture.image.pixels[7][0]).collect();
    assert_eq!(greys, [10, 20, 30, 40, 50]);
    assert_eq!((pictures[0].image.width, pictures[0].image.height), (15, 10));
    let part = read(&film, None, Pass { longer: 99, first: 1, last: Some(3), every: 2 }).unwrap();
    assert_eq!(part.iter().map(|p| (p.number, p.image.width)).collect::<Vec<_>>(), [(1, 30), (3, 30)]);
    // cut off within the last frame
    let bytes = std::fs::read(&film).unwrap();
    std::fs::write(&film, &bytes[..bytes.len() - 8]).unwrap();
    let cut = Source::open(&film, None).unwrap();
    assert_eq!(cut.info().count, Some(4));
    assert!(cut.info().said[0].contains("it has 4 whole frames"), "{:?}", cut.info().said);
    assert_eq!(cut.pictures(Pass::whole(99)).unwrap().map(Result::unwrap).count(), 4);
}

#[test]
fn a_folder_has_the_time_that_is_given() {
    let folder = TempDir::new().unwrap();
    for k in 0..4u8 {
        let file = std::fs::File::create(folder.path().join(format!("{}.png", k + 8))).unwrap();
        let mut encoder = png::Encoder::new(file, 8, 4);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[10 * k; 8 * 4 * 3]).unwrap();
    }
    refused(read(folder.path(), None, Pass::whole(8)), &["how fast", "--fps"]);
    let part = read(folder.path(), Some(50.0), Pass { longer: 4, first: 1, last: None, every: 2 }).unwrap();
    let found: Vec<(usize, u8, usize)> = part.iter().map(|p| (p.number, p.image.pixels[0][0], p.image.width)).collect();
    assert_eq!(found, [(1, 10, 4), (3, 30, 4)]);
    near(&times(&part), &[0.02, 0.06], 1e-12);
    refused(read(folder.path(), Some(50.0), Pass { first: 4, ..Pass::whole(8) }), &["no frame 4", "has 4"]);
}
