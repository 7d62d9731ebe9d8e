//! Options that select a clip and describe a film.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::cli::source::whole;
use crate::identify::ClipConfig;
use crate::video::{ContactModel, EXPOSURES, Film, FilmSettings, MattingSettings, ROW_TIMES};

/// What the command line chooses of a clip.
#[derive(clap::Args)]
pub(super) struct ChoiceArguments {
    /// Use these cameras only, for example 0,3,5
    #[arg(long, value_delimiter = ',', value_name = "NUMBERS")]
    cameras: Option<Vec<i64>>,
    /// Use the first so many frames only
    #[arg(long, value_name = "COUNT")]
    frames: Option<usize>,
    /// Number of the first frame to use
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    first_frame: Option<i64>,
}

impl ChoiceArguments {
    /// Whether any option was given.
    pub fn are_given(&self) -> bool {
        self.cameras.is_some() || self.frames.is_some() || self.first_frame.is_some()
    }

    /// Overrides the settings with the given options.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for zero frames.
    pub fn apply(&self, clip: &mut ClipConfig) -> Result<()> {
        if self.frames == Some(0) {
            return Err(Error::new(ErrorKind::Input, "a clip needs at least two frames to show motion")
                .at("--frames")
                .found(0)
                .wanted("2 or more")
                .fix("leave it out for all frames"));
        }
        if let Some(cameras) = &self.cameras {
            clip.cameras.clone_from(cameras);
        }
        clip.frames = self.frames.unwrap_or(clip.frames);
        clip.first_frame = self.first_frame.or(clip.first_frame);
        Ok(())
    }
}

fn outside(option: &str, found: impl std::fmt::Display, wanted: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, format!("the value of {option} is outside its range"))
        .at(option)
        .found(found)
        .wanted(wanted)
        .fix("correct it, or leave it out")
}

/// Heading of these options.
const FILM: &str = "Films (a GIF, a video, or a folder of pictures from one camera)";

/// What the command line says of a film.
#[derive(clap::Args)]
pub(super) struct FilmArguments {
    /// Frames per second, if the file does not say or is slow motion
    #[arg(long, value_name = "RATE", help_heading = FILM, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Angle of view along the longer side of the image [default: what the file says of its lens, or 50]
    #[arg(long, value_name = "DEGREES", help_heading = FILM, allow_negative_numbers = true)]
    field_of_view: Option<f64>,
    /// How far the camera looks down [default: found with the fall, about 10]
    #[arg(long, value_name = "DEGREES", help_heading = FILM, allow_negative_numbers = true)]
    elevation: Option<f64>,
    /// Of several objects that fall together the one to use; by itself the largest (see what `gradreel check` says)
    #[arg(long, value_name = "NUMBER", help_heading = FILM, value_parser = clap::value_parser!(u64).range(1..=100))]
    object: Option<u64>,
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
    /// How the contact is treated: by its restitution where it is shorter than the time between two pictures (auto), or simulated
    /// whatever the film shows of it (resolved) [default: auto]
    #[arg(long, value_name = "HOW", value_enum, hide_possible_values = true, help_heading = FILM)]
    contact: Option<ContactModel>,
    /// How long each picture was exposed, as 1/60, 4ms or 0.004 (seconds); 0 for no blur [default: found from the fall]
    #[arg(long, value_name = "TIME", help_heading = FILM, value_parser = exposure)]
    exposure: Option<f64>,
    /// Time from one row of the picture to the next, as 15us or 1.5e-5 (seconds), negative where the picture is read from below; 0 for
    /// all at once [default: found from the fall]
    #[arg(long, value_name = "TIME", help_heading = FILM, allow_hyphen_values = true, value_parser = row_time)]
    row_time: Option<f64>,
}

/// A time \[s\] as typed: a number or a fraction, with s, ms, us or µs after it or nothing.
fn time(text: &str, range: &RangeInclusive<f64>, wanted: &str) -> Result<f64, String> {
    let text = text.trim();
    let units = [("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("μs", 1e-6), ("s", 1.0)];
    let unit = units.iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, *factor)));
    let (number, factor) = unit.unwrap_or((text, 1.0));
    let value = match number.split_once('/') {
        Some((above, below)) => {
            above.trim().parse::<f64>().ok().zip(below.trim().parse::<f64>().ok()).map(|(a, b)| a / b)
        }
        None => number.trim().parse().ok(),
    };
    value.map(|value| value * factor).filter(|value| range.contains(value)).ok_or_else(|| wanted.to_owned())
}

fn exposure(text: &str) -> Result<f64, String> {
    time(text, &EXPOSURES, "a time from 0 to 10 s, as 1/60, 4ms or 0.004")
}

fn row_time(text: &str) -> Result<f64, String> {
    time(text, &ROW_TIMES, "a time from -1ms to 1ms, as 15us or 1.5e-5")
}

impl FilmArguments {
    /// Names of the given options.
    fn given(&self) -> Vec<&'static str> {
        let options = [
            (self.fps.is_some(), "--fps"),
            (self.field_of_view.is_some(), "--field-of-view"),
            (self.elevation.is_some(), "--elevation"),
            (self.object.is_some(), "--object"),
            (self.masks.is_some(), "--masks"),
            (self.background.is_some(), "--background"),
            (self.matting.is_some(), "--matting"),
            (self.contact.is_some(), "--contact"),
            (self.exposure.is_some(), "--exposure"),
            (self.row_time.is_some(), "--row-time"),
        ];
        options.into_iter().filter(|(given, _)| *given).map(|(_, name)| name).collect()
    }

    /// Whether any option was given.
    pub fn are_given(&self) -> bool {
        !self.given().is_empty()
    }

    /// Rejects film options for a clip that is not a film.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the given options.
    pub fn check_is_of(&self, path: &Path) -> Result<()> {
        if !self.are_given() || Film::is_at(path) || !path.exists() {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "calibrated cameras take no options of films")
            .at(path.display())
            .found(self.given().join(", "))
            .wanted("these options with a GIF, a video, or a folder of pictures without a list of cameras")
            .fix("leave them out: times, lenses and masks are those that the clip's folder says (clip.toml, masks/)"))
    }

    /// Overrides the settings with the given options.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a number outside its range; 0 is not accepted here.
    pub fn apply(&self, film: &mut FilmSettings) -> Result<()> {
        let ranges: [(&str, Option<f64>, RangeInclusive<f64>, &str); 3] = [
            ("--fps", self.fps, 0.1..=1e6, "0.1 to 1e6 frames per second"),
            ("--field-of-view", self.field_of_view, 1.0..=150.0, "1 to 150 degrees"),
            ("--elevation", self.elevation, -85.0..=85.0, "-85 to 85 degrees"),
        ];
        for (option, value, range, wanted) in ranges {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return Err(outside(option, value, wanted));
            }
        }
        film.frames_per_s = self.fps.unwrap_or(film.frames_per_s);
        film.field_of_view = self.field_of_view.unwrap_or(film.field_of_view);
        film.elevation = self.elevation.or(film.elevation);
        film.contact = self.contact.unwrap_or(film.contact);
        film.exposure = self.exposure.or(film.exposure);
        film.row_time = self.row_time.or(film.row_time);
        film.object = self.object.map(|number| number as usize).or(film.object);
        if self.masks.is_some() || self.background.is_some() || self.matting.is_some() {
            film.masks = self.masks.as_deref().map(whole);
            film.background = self.background.as_deref().map(whole);
            // keep the settings of the network's input
            let settings = film.matting.take().unwrap_or_default();
            film.matting = self.matting.as_deref().map(|file| MattingSettings { model: whole(file), ..settings });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_as_people_write_them() {
        for (text, seconds) in [("1/60", 1.0 / 60.0), ("1/250 s", 0.004), ("4ms", 0.004), ("0.004", 0.004), ("0", 0.0)]
        {
            assert!((exposure(text).unwrap() - seconds).abs() < 1e-12, "{text}");
        }
        assert!((row_time("15us").unwrap() - 1.5e-5).abs() < 1e-18 && row_time("-15 µs").unwrap() < 0.0);
        for text in ["", "fast", "-1/60", "1/0", "nan", "11", "1//2"] {
            assert!(exposure(text).unwrap_err().contains("0 to 10 s"), "{text}");
        }
        assert!(row_time("2ms").is_err());
    }
}
