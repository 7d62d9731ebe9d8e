//! Options that say what is known of a film.

use std::path::PathBuf;

use crate::cli::source::whole;
use crate::video::FilmSettings;

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
}

impl FilmArguments {
    /// Whether anything was said.
    pub fn are_given(&self) -> bool {
        let numbers = [self.fps, self.field_of_view, self.elevation];
        numbers.iter().any(Option::is_some) || self.masks.is_some() || self.background.is_some()
    }

    /// Lets what was said replace what the settings have.
    pub fn apply(&self, film: &mut FilmSettings) {
        film.frames_per_s = self.fps.unwrap_or(film.frames_per_s);
        film.field_of_view = self.field_of_view.unwrap_or(film.field_of_view);
        film.elevation = self.elevation.or(film.elevation);
        if self.masks.is_some() || self.background.is_some() {
            film.masks = self.masks.as_deref().map(whole);
            film.background = self.background.as_deref().map(whole);
        }
    }
}
