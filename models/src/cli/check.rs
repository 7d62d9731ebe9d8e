//! `gradreel check`: looks at a clip without computing anything.

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};

use crate::cli::film::FilmArguments;
use crate::cli::output::say;
use crate::cli::reconstruct::{check_body, far_ground, usable};
use crate::identify::{Config, WorldConfig};
use crate::monocular::clip_of_film;
use crate::video::{Film, FilmSettings, OpenOptions, WARNING, inspect_and_open};

/// Arguments of `gradreel check`.
#[derive(clap::Args)]
#[command(after_long_help = LAYOUTS)]
pub(super) struct Arguments {
    /// A film, or the folder of a clip in one of the layouts below
    clip: PathBuf,
    #[command(flatten)]
    film: FilmArguments,
}

/// The layouts of clips, for the help of commands that open one.
pub(super) const LAYOUTS: &str = "\
Layouts of clips, recognised by the files in the folder:
  PAC-NeRF      all_data.json and data/r_{camera}_{frame}.png
  NeRF, D-NeRF  transforms.json, or transforms_train.json, …_val.json and …_test.json
  COLMAP        sparse/0/cameras.txt and images.txt, and frames/{camera}/{number}.png
  Spring-Gaus   camera.json and {camera}/{number}.png; of a real capture give …/dynamic/sequences/{object}/{number}.json
All but PAC-NeRF's need transparent images, or masks under masks/ (white on the object). A file clip.toml in the folder says what
a layout leaves open: up, metres_per_unit, origin, frames_per_s or duration_s, layout, and which cameras are imagined (synthesized
views that nobody filmed), as in imagined = [1, 2]. What is assumed, `gradreel check` prints.

A film is a GIF, a video file (decoded by ffmpeg) or a folder of numbered PNG or JPEG pictures without such a list.";

/// Prints what is there, what is missing and what will be assumed.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if Film::is_at(&arguments.clip) {
        return film(arguments);
    }
    let (mut inventory, clip) = inspect_and_open(&arguments.clip, &OpenOptions::default())?;
    if let Some(mut clip) = clip.filter(|clip| clip.frame_count() > 1) {
        let config = Config::default();
        // what a reconstruction refuses of a clip that can be opened
        let ready = usable(&mut clip, &config).and_then(|()| check_body(&clip, &config));
        match ready.and_then(|()| far_ground(&clip, config.world.ground)) {
            Ok(far) => clip.assumptions.extend(far.map(|far| {
                format!("{WARNING}{far}: reconstruct needs the height of the ground (--ground), or --ground auto")
            })),
            Err(error) => inventory.problems.push(error.to_string()),
        }
        inventory.assumptions = clip.assumptions;
    }
    say!("{inventory}");
    if inventory.is_complete() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the clip is not complete")
        .at(arguments.clip.display())
        .found(format!("{} problems, listed above", inventory.problems.len()))
        .fix("correct the problems listed above, or choose complete cameras and frames with --cameras and --frames"))
}

/// Prints what a film shows: it is made a clip, which is all that a reconstruction would ask of it.
fn film(arguments: &Arguments) -> Result<()> {
    let mut settings = FilmSettings::default();
    arguments.film.apply(&mut settings);
    let gravity = WorldConfig::default().gravity;
    let clip = clip_of_film(&arguments.clip, &settings, &OpenOptions::default(), gravity)?;
    let camera = &clip.cameras[0];
    say!("film {} ({})", clip.name, arguments.clip.display());
    say!(
        "  {} frames of {} × {} pixels, {:.4} s apart",
        clip.frame_count(),
        camera.width,
        camera.height,
        clip.frame_dt()
    );
    clip.assumptions.iter().for_each(|line| say!("  assumed: {line}"));
    if let Some(flight) = clip.flight {
        say!("  the object starts with {:.3?} m/s at {:.3?} m", flight.velocity, flight.centre);
    }
    say!("  ready to open");
    Ok(())
}
