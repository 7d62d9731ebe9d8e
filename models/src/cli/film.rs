//! Options that say what is known of a film.

use std::path::PathBuf;

use crate::cli::source::whole;
use crate::video::{FilmSettings, MattingSettings};

/// Heading of these options.
const FILM: &str = "Films (a GIF, a video, or a folder of pictures from one camera)";

/// What the command line says of a film.
#[derive(clap::Args)]
pub(super) struct FilmArguments {
    /// Frames per second, if the file does not say or is slow motion
    #[arg(long, value_name = "RATE", help_heading = FILM)]
    fps: Option<f64>,
    /// Angle of view along the longer side of the image [default: what the file says of its lens, or 50]
    #[arg(long, value_name = "DEGREES", help_heading = FILM)]
    field_of_view: Option<f64>,
    /// How far the camera looks down [default: found with the fall, about 10]
    #[arg(long, value_name = "DEGREES", help_heading = FILM, allow_negative_numbers = true)]
    elevation: Option<f64>,
    /// Folder with a mask for each frame, white where the object is
    #[arg(long, value_name = "FOLDER", help_heading = FILM)]
    masks: Option<PathBuf>,
    /// Picture of the background without the object
    #[arg(long, value_name = "FILE", help_heading = FILM, conflicts_with = "masks")]
    background: Option<PathBuf>,
    /// Network that tells the object from the background, an ONNX file
    ///
    /// Networks for matting or salient objects work, such as U²-Net, ISNet, RMBG, BiRefNet and MODNet: one picture
    /// [1, 3, height, width] goes in, and [1, 1, height, width] or [1, height, width] is the first output. Colours are normalised as
    /// U²-Net and BiRefNet want it; for others set clip.film.matting.mean and clip.film.matting.deviation in the file of --config
    /// (ISNet, RMBG-1.4: 0.5 and 1; MODNet: 0.5 and 0.5), and clip.film.matting.size where a network leaves the size of its pictures
    /// open.
    #[arg(long, value_name = "FILE.onnx", help_heading = FILM, conflicts_with_all = ["masks", "background"])]
    matting: Option<PathBuf>,
}

impl FilmArguments {
    /// Whether anything was said.
    pub fn are_given(&self) -> bool {
        let numbers = [self.fps, self.field_of_view, self.elevation];
        numbers.iter().any(Option::is_some) || self.says_what_tells()
    }

    fn says_what_tells(&self) -> bool {
        [&self.masks, &self.background, &self.matting].iter().any(|path| path.is_some())
    }

    /// Lets what was said replace what the settings have.
    pub fn apply(&self, film: &mut FilmSettings) {
        film.frames_per_s = self.fps.unwrap_or(film.frames_per_s);
        film.field_of_view = self.field_of_view.unwrap_or(film.field_of_view);
        film.elevation = self.elevation.or(film.elevation);
        if self.says_what_tells() {
            film.masks = self.masks.as_deref().map(whole);
            film.background = self.background.as_deref().map(whole);
            // what the settings say of the network's pictures goes on to hold
            let settings = film.matting.take().unwrap_or_default();
            film.matting = self.matting.as_deref().map(|file| MattingSettings { model: whole(file), ..settings });
        }
    }
}
