//! Passes over video files, decoded and shrunk by ffmpeg.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use gradreel::{Error, ErrorKind, Result};

use super::brightness::Standard;
use super::limits::{Budget, check_size};
use super::pictures::{Decoded, Undated};
use super::probe::{self, Probed, command, missing, undecodable};
use super::{Info, Kind, Pass, absent, uneven};
use crate::video::clip::WARNING;
use crate::video::image::Image;

/// Nominal rate at which pictures leave the decoder; their actual times are read separately \[1/s\].
const RATE: u32 = 25;

/// Resolution of the printed times \[1/s\].
const TICKS: u32 = 1_000_000_000;

/// Maximum length of ffmpeg's messages that is kept \[bytes\].
const MOST_SAID: usize = 1 << 16;

/// Number of pictures that wait between the decoder and the reader.
const WAITING: usize = 2;

/// What demuxers say of a file that ends too early.
const CUT_OFF: [&str; 3] = ["partial file", "ended prematurely", "Truncating packet"];

/// What decoders say of damaged pictures.
const DAMAGED: [&str; 5] = ["error while decoding", "Invalid NAL unit", "corrupt", "Invalid data found", "damaged"];

/// What is known of a file before it is decoded, and what was heard while it was.
#[derive(Debug, Clone)]
pub(super) struct Decoding {
    probed: Box<Probed>,
    heard: Heard,
}

/// The first complaint of a decoder about damage.
type Heard = Arc<Mutex<Option<String>>>;

impl Decoding {
    /// What the passes so far heard of damage.
    pub fn heard(&self) -> Option<String> {
        let heard = self.heard.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()?;
        Some(format!("{WARNING}the file is damaged: ffmpeg says `{heard}`; pictures behind the damage may be wrong"))
    }
}

/// Looks at a file.
pub(super) fn open(path: &Path) -> Result<(Info, Kind)> {
    let probed = probe::read(path)?;
    Ok((probed.info.clone(), Kind::Stream(Decoding { probed: Box::new(probed), heard: Heard::default() })))
}

/// The filters of a pass: each frame prints its number and time to stderr, wanted ones are shrunk, and even
/// timestamps keep ffmpeg from dropping or repeating frames.
fn filters(probed: &Probed, pass: Pass) -> String {
    let print = "metadata=mode=add:key=shown:value=1,metadata=mode=print:key=shown:file=pipe\\\\:2:direct=1";
    let every = pass.every.max(1);
    let last = pass.last.map_or(String::new(), |last| format!("*lte(n\\,{last})"));
    let select = format!("select=gte(n\\,{0}){last}*not(mod(n-{0}\\,{every}))", pass.first);
    let fields = if probed.is_interlaced { "yadif=0:-1:0," } else { "" };
    // the shown size at most
    let pixel = if probed.pixel == 1.0 { "1" } else { "sar" };
    let (across, down) = (format!("iw*min(1\\,{pixel})"), format!("ih*min(1\\,1/{pixel})"));
    let share = format!("min(1\\,{}/max({across}\\,{down}))", pass.longer.max(1));
    let side = |side: &str| format!("max(1\\,round({side}*{share}))");
    let scale = format!("scale=w={}:h={}:flags=area", side(&across), side(&down));
    let turn = probed.turn.map_or(String::new(), |turn| format!("{turn},"));
    format!("settb=1/{TICKS},{print},{fields}{select},{scale},{turn}setsar=1,settb=1/{RATE},setpts=N,fps={RATE}")
}

/// Starts ffmpeg.
pub(super) fn pass(path: &Path, decoding: &Decoding, pass: Pass) -> Result<Decoded> {
    let probed = &decoding.probed;
    let before: &[&str] = if probed.turn.is_some() { &["-noautorotate"] } else { &[] };
    let mut command = command("ffmpeg", before, path);
    let format = if probed.has_alpha { "rgba" } else { "rgb24" };
    command.args(["-nostdin", "-map", "0:V:0", "-vf", &filters(probed, pass)]);
    command.args(["-f", "image2pipe", "-c:v", "pam", "-pix_fmt", format]);
    if let Some(last) = pass.last {
        let count = (last + 1).saturating_sub(pass.first).div_ceil(pass.every.max(1));
        command.args(["-frames:v", &count.max(1).to_string()]);
    }
    let mut child = command
        .arg("pipe:1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| missing(path, "ffmpeg", &e))?;
    let (stdout, stderr) = (child.stdout.take().expect("piped"), child.stderr.take().expect("piped"));
    let (send_time, times) = channel();
    let told = std::thread::spawn(move || told(BufReader::new(stderr), |time| send_time.send(time).is_ok()));
    let (send, pictures) = sync_channel(WAITING);
    let reading = Reading {
        path: path.to_path_buf(),
        probed: probed.clone(),
        pass,
        pipe: BufReader::new(stdout),
        times,
        start: None,
        seen: 0,
        size: None,
        budget: Budget::default(),
    };
    let reader = std::thread::spawn(move || reading.all(&send));
    Ok(Box::new(Running {
        child,
        threads: Some((reader, told)),
        pictures: Some(pictures),
        path: path.to_path_buf(),
        pass,
        count: 0,
        heard: Arc::clone(&decoding.heard),
    }))
}

/// An ffmpeg process and the pictures that it yields. It is killed when this is dropped.
struct Running {
    child: Child,
    threads: Option<(JoinHandle<usize>, JoinHandle<String>)>,
    pictures: Option<Receiver<Result<Undated>>>,
    path: PathBuf,
    pass: Pass,
    /// Number of pictures so far.
    count: usize,
    heard: Heard,
}

impl Iterator for Running {
    type Item = Result<Undated>;

    fn next(&mut self) -> Option<Self::Item> {
        match self.pictures.as_ref()?.recv() {
            Ok(Ok(picture)) => {
                self.count += 1;
                Some(Ok(picture))
            }
            Ok(Err(error)) => {
                self.pictures = None;
                Some(Err(error))
            }
            Err(_) => {
                self.pictures = None;
                self.ended().err().map(Err)
            }
        }
    }
}

impl Running {
    /// Checks that all wanted pictures came.
    fn ended(&mut self) -> Result<()> {
        let status = self.child.wait().map_err(|e| Error::io(&self.path, "decode the film", &e))?;
        let (reader, told) = self.threads.take().expect("ended once");
        let (seen, said) = (reader.join().unwrap_or(0), told.join().unwrap_or_default());
        if let Some(line) = said.lines().find(|line| DAMAGED.iter().any(|word| line.contains(word))) {
            // without the decoder's address
            let line = line.split_once("] ").map_or(line, |(_, line)| line).trim().to_owned();
            self.heard.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).get_or_insert(line);
        }
        if self.pass.last.is_some_and(|last| seen > last) {
            return Ok(());
        }
        if seen == 0 && (!status.success() || !said.trim().is_empty()) {
            return Err(undecodable(&self.path, &said));
        }
        if seen > 0 && (!status.success() || CUT_OFF.iter().any(|end| said.contains(end))) {
            return Err(cut_off(&self.path, seen, &said));
        }
        if self.count == 0 {
            return Err(absent(&self.path, self.pass.first, Some(seen)));
        }
        Ok(())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // the process may have ended already; the threads end with its pipes
        self.pictures = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
        if let Some((reader, told)) = self.threads.take() {
            let _ = (reader.join(), told.join());
        }
    }
}

fn cut_off(path: &Path, seen: usize, said: &str) -> Error {
    // the last may be incomplete
    let whole = seen.saturating_sub(1);
    Error::new(ErrorKind::Input, "the film is cut off or damaged")
        .at(path.display())
        .found(format!("{whole} whole frames, then: {}", said.lines().next().unwrap_or("an error of ffmpeg").trim()))
        .wanted("a whole file")
        .fix(format!("copy it again, or use the frames before the damage (--frames {whole})"))
}

fn changed(path: &Path, number: usize) -> Error {
    Error::new(ErrorKind::Input, "the frames of the film differ in size")
        .at(path.display())
        .found(format!("frame {number} has another size, or another kind of pixels, than those before it"))
        .wanted("frames of one size and kind")
        .fix(format!("use the frames before it (--frames {number}), or export the film again at one size"))
}

/// Reads pictures from a pipe, and their times as they are told.
struct Reading {
    path: PathBuf,
    probed: Box<Probed>,
    pass: Pass,
    pipe: BufReader<ChildStdout>,
    times: Receiver<(usize, Option<f64>)>,
    /// The file's time of its first picture \[s\].
    start: Option<f64>,
    /// Number of frames that the decoder has passed on.
    seen: usize,
    size: Option<(usize, usize)>,
    budget: Budget,
}

impl Reading {
    /// Sends all pictures; returns the number of frames that were decoded for them.
    fn all(mut self, send: &SyncSender<Result<Undated>>) -> usize {
        let standard = self.probed.transfer.map(|(transfer, is_wide)| Standard::of(transfer, is_wide));
        let numbers = (self.pass.first..).step_by(self.pass.every.max(1));
        for number in numbers {
            let next = self.picture(number).transpose();
            let Some(next) = next else { break };
            let next = next.map(|mut picture| {
                standard.iter().for_each(|standard| standard.apply(&mut picture.image));
                picture
            });
            let failed = next.is_err();
            if send.send(next).is_err() || failed {
                break;
            }
        }
        while let Ok((number, _)) = self.times.recv() {
            self.seen = number + 1;
        }
        self.seen
    }

    fn picture(&mut self, number: usize) -> Result<Option<Undated>> {
        let Some(image) = picture(&self.path, &mut self.pipe)? else { return Ok(None) };
        let size = (image.width, image.height);
        let wanted = *self.size.get_or_insert(size);
        if size != wanted {
            return Err(uneven(&self.path, number, size, wanted));
        }
        let mut time = None;
        while self.seen <= number {
            let Ok((told, seconds)) = self.times.recv() else { break };
            self.budget.spend(&self.path, self.probed.info.stored)?;
            if told < self.seen {
                // the filters start anew with pictures of another size or kind
                return Err(changed(&self.path, self.seen));
            }
            if told == 0 {
                self.start = seconds;
            }
            self.seen = told + 1;
            time = if told == number { seconds } else { None };
        }
        let seconds = match (time, self.start) {
            (Some(time), Some(start)) => Some((time - start) * self.probed.real),
            // a stream without timestamps
            _ => self.probed.info.rate.map(|rate| number as f64 / rate),
        };
        Ok(Some(Undated { number, seconds, image }))
    }
}

/// Passes on the numbers and times of the decoded frames until `pass_on` refuses; returns ffmpeg's other messages.
fn told(mut stderr: impl BufRead, pass_on: impl Fn((usize, Option<f64>)) -> bool) -> String {
    let mut said = String::new();
    let mut line = Vec::new();
    // output before a read error is sufficient
    while stderr.by_ref().take(MOST_SAID as u64).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
        let text = String::from_utf8_lossy(&line);
        if let Some(rest) = text.strip_prefix("frame:") {
            let number = rest.split_whitespace().next().and_then(|word| word.parse::<usize>().ok());
            let ticks =
                rest.split_once(" pts:").and_then(|(_, rest)| rest.split_whitespace().next()?.parse::<i64>().ok());
            if let Some(number) = number {
                pass_on((number, ticks.map(|ticks| ticks as f64 / f64::from(TICKS))));
            }
        } else if !text.starts_with("shown=") && said.len() < MOST_SAID {
            said.push_str(&text);
        }
        line.clear();
    }
    said
}

/// The next picture of a sequence of PAM images; `None` at its end, and within a picture that an ended process left
/// incomplete.
fn picture(path: &Path, pipe: &mut impl BufRead) -> Result<Option<Image>> {
    let (mut width, mut height, mut depth) = (0, 0, 0);
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
            Some("DEPTH") => depth = number(),
            Some("ENDHDR") => break,
            _ => {}
        }
    }
    check_size(path, (width, height))?;
    let mut bytes = vec![0; width * height * depth];
    match pipe.read_exact(&mut bytes) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(None),
        read => read.map_err(failed)?,
    }
    let pixels = match depth {
        4 => bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect(),
        3 => bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2], 255]).collect(),
        _ => return Err(undecodable(path, &format!("pictures of {depth} channels"))),
    };
    Ok(Some(Image { width, height, pixels, has_alpha: depth == 4 }))
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    #[test]
    fn times_are_told_from_errors() {
        let text = "frame:0    pts:83333333    pts_time:0.0833333\nshown=1\n[h264] error\nframe:1 pts:NOPTS pts_time:NOPTS\nshown=1\n";
        let times = RefCell::new(Vec::new());
        let said = told(text.as_bytes(), |time| {
            times.borrow_mut().push(time);
            true
        });
        assert_eq!((times.into_inner(), said.as_str()), (vec![(0, Some(0.083_333_333)), (1, None)], "[h264] error\n"));
    }
}
