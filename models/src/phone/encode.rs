//! A video file from pictures, through ffmpeg.

use std::fmt::Write as _;
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use gradreel::{Error, ErrorKind, Result};

use super::plan::Plan;

/// Ticks of the file's clock in a second.
const CLOCK: usize = 90_000;
/// Quality of a film with enough bits.
const QUALITY: &str = "18";

/// A file that is being written.
pub(super) struct Encoder {
    child: Child,
    out: PathBuf,
    /// The file whose pictures are turned by the one that is wanted.
    flat: Option<PathBuf>,
}

impl Encoder {
    /// Begins a file. Pictures have this width and height as they are shown.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a name that is no video file's, or without ffmpeg.
    pub fn new(out: &Path, [width, height]: [usize; 2], plan: &Plan) -> Result<Self> {
        if !out.extension().is_some_and(|end| ["mp4", "mov", "mkv"].iter().any(|known| end == *known)) {
            return Err(Error::new(ErrorKind::Input, "the name of the film does not say which kind of file it is")
                .at(out.display())
                .wanted("a name that ends in .mp4, .mov or .mkv")
                .fix("rename it"));
        }
        if let Some(folder) = out.parent() {
            fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder of the film", &e))?;
        }
        let flat = plan.is_turned.then(|| out.with_extension("flat.mov"));
        let mut filters = vec![];
        if plan.is_turned {
            filters.push("transpose=clock".to_owned());
        }
        if !plan.is_even() {
            filters.push(format!("settb=1/{CLOCK},setpts='{}'", stamps(plan)));
        }
        // H.264 wants even sizes
        filters.push("pad=ceil(iw/2)*2:ceil(ih/2)*2".to_owned());
        let bits = match plan.bit_rate {
            Some(rate) => vec!["-b:v".to_owned(), format!("{rate:.0}")],
            None => vec!["-crf".to_owned(), QUALITY.to_owned()],
        };
        let child = Command::new("ffmpeg")
            .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &format!("{}", plan.rate / plan.slower), "-i", "-"])
            .args(["-vf", &filters.join(","), "-fps_mode", "passthrough"])
            .args(["-enc_time_base", &format!("1/{CLOCK}"), "-c:v", "libx264", "-pix_fmt", "yuv420p"])
            .args(bits)
            .arg(flat.as_deref().unwrap_or(out))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| {
                Error::new(ErrorKind::Input, "video files are written by ffmpeg, which cannot be run")
                    .at(out.display())
                    .found(e)
                    .wanted("ffmpeg, version 5.1 or later, on the path")
                    .fix("install ffmpeg")
            })?;
        Ok(Self { child, out: out.to_owned(), flat })
    }

    /// Adds a picture.
    pub fn add(&mut self, rgb: &[u8]) -> Result<()> {
        let input = self.child.stdin.as_mut().expect("piped");
        let Err(error) = input.write_all(rgb) else { return Ok(()) };
        let said = self.said();
        Err(failed(&self.out, if said.is_empty() { error.to_string() } else { said }))
    }

    /// Ends the file.
    pub fn finish(mut self) -> Result<()> {
        drop(self.child.stdin.take());
        let said = self.said();
        let status = self.child.wait().map_err(|e| failed(&self.out, e.to_string()))?;
        if !status.success() {
            return Err(failed(&self.out, said));
        }
        let Some(flat) = &self.flat else { return Ok(()) };
        // from version 6 on as an option of the input, before as a tag of the stream
        let input = |command: &mut Command| {
            command.arg("-i").arg(flat).args(["-c", "copy"]);
        };
        let turned = |before: &[&str], after: &[&str]| {
            let mut command = Command::new("ffmpeg");
            command.args(["-v", "error", "-y"]).args(before);
            input(&mut command);
            command.args(after).arg(&self.out).stdin(Stdio::null());
            command.output().is_ok_and(|output| output.status.success())
        };
        let done = turned(&["-display_rotation:v:0", "90"], &[]) || turned(&[], &["-metadata:s:v:0", "rotate=90"]);
        fs::remove_file(flat).map_err(|e| Error::io(flat, "remove the pictures that are not turned", &e))?;
        if done { Ok(()) } else { Err(failed(&self.out, "the pictures cannot be turned".to_owned())) }
    }

    fn said(&mut self) -> String {
        let mut text = String::new();
        if let Some(mut stderr) = self.child.stderr.take() {
            // what came before a read error is what it said
            let _ = stderr.read_to_string(&mut text);
        }
        text.trim().to_owned()
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // it has ended, or the film is given up
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn failed(out: &Path, said: String) -> Error {
    Error::new(ErrorKind::Io, "ffmpeg cannot write the film")
        .at(out.display())
        .found(said)
        .fix("see that the folder can be written to, and that ffmpeg has the encoder libx264")
}

/// The time of picture `N` in ticks, as an expression of ffmpeg.
fn stamps(plan: &Plan) -> String {
    let mut text = "0".to_owned();
    let ticks: Vec<i64> = plan.stamps().map(|time| (time * CLOCK as f64).round() as i64).collect();
    for (number, pair) in ticks.windows(2).enumerate() {
        write!(text, "+gte(N,{})*{}", number + 1, pair[1] - pair[0]).expect("a string accepts every write");
    }
    text
}
