//! `gradreel check`: inspects a clip without reconstructing it.

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::cli::film::{ChoiceArguments, FilmArguments};
use crate::cli::ground::GroundArguments;
use crate::cli::imagine::ImagineArguments;
use crate::cli::output::say;
use crate::cli::reconstruct::{check_is_clip, check_motion, check_start, far_ground, options, read_config, ready};
use crate::cli::seen::Seen;
use crate::identify::Config;
use crate::report::film::{AXES, PAGE, publish};
use crate::runtime::interrupt;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Clip, Film, WARNING, inspect_and_open};

/// Arguments of `gradreel check`.
#[derive(clap::Args)]
#[command(after_long_help = LAYOUTS)]
pub(super) struct Arguments {
    /// A film, or the folder of a clip in one of the layouts below
    clip: PathBuf,
    /// Settings as TOML, as `gradreel reconstruct` takes them
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print what is found as JSON
    #[arg(long)]
    json: bool,
    /// Folder for the page of a film [default: runs/check-<film>, runs/check-<film>-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    choice: ChoiceArguments,
    #[command(flatten)]
    film: FilmArguments,
    #[command(flatten)]
    ground: GroundArguments,
    #[command(flatten)]
    imagine: ImagineArguments,
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

/// Reports what is present, what is missing and what will be assumed.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let looked = settings(arguments).and_then(|config| match Film::is_at(&arguments.clip) {
        true => film(arguments, &config),
        false => calibrated(arguments, &config),
    });
    match looked {
        Ok(complete) => complete,
        Err(error) => {
            if arguments.json {
                Seen::refused(&arguments.clip, &error).print()?;
            }
            Err(error)
        }
    }
}

/// The settings that a reconstruction would use to open the clip.
fn settings(arguments: &Arguments) -> Result<Config> {
    if let Some(folder) = &arguments.out {
        super::place::check(folder, Some(&arguments.clip))?;
    }
    let mut config = match &arguments.config {
        None => Config::default(),
        Some(path) => read_config(path)?,
    };
    check_is_clip(&arguments.clip)?;
    arguments.film.check_is_of(&arguments.clip)?;
    arguments.choice.apply(&mut config.clip)?;
    arguments.film.apply(&mut config.clip.film)?;
    arguments.imagine.apply(&mut config);
    arguments.ground.apply(&mut config);
    config.check()?;
    if let (Some(folder), false) = (&arguments.out, Film::is_at(&arguments.clip) || !arguments.clip.exists()) {
        return Err(Error::new(ErrorKind::Input, "only of a film there is a page to be written")
            .at("--out")
            .found(format!("{} for a clip of calibrated cameras", folder.display()))
            .fix("leave it out"));
    }
    Ok(config)
}

/// Reports on the folder of a calibrated clip; the inner result is an error if the clip cannot be used.
fn calibrated(arguments: &Arguments, config: &Config) -> Result<Result<()>> {
    let (mut inventory, mut clip) = inspect_and_open(&arguments.clip, &options(config))?;
    // a single frame is valid as views for another clip
    if let Some(clip) = clip.as_mut().filter(|clip| clip.frame_count() > 1) {
        inventory.problems.extend(start(clip, config).err().map(|error| error.to_string()));
        inventory.assumptions.clone_from(&clip.assumptions);
    }
    match (arguments.json, &clip) {
        (true, Some(clip)) => Seen::of_opened(clip, &inventory, &arguments.clip).print()?,
        (true, None) => Seen::of_inventory(&inventory, &arguments.clip).print()?,
        (false, _) => say!("{inventory}"),
    }
    if inventory.is_complete() {
        return Ok(Ok(()));
    }
    Ok(Err(Error::new(ErrorKind::Input, "the clip is not complete")
        .at(arguments.clip.display())
        .found(format!("{} problems, listed above", inventory.problems.len()))
        .fix("correct the problems listed above, or choose complete cameras and frames with --cameras and --frames")))
}

/// The checks that a reconstruction performs on an opened clip before it begins.
fn start(clip: &mut Clip, config: &Config) -> Result<()> {
    check_motion(clip, config)?;
    check_start(clip, config)?;
    if let Some(far) = far_ground(clip, config.world.ground)?.filter(|_| !config.world.find_ground) {
        let said = format!("{WARNING}{far}: reconstruct needs the height of the ground (--ground), or --ground auto");
        clip.assumptions.push(said);
    }
    Ok(())
}

/// Reports on a film, which is converted to a clip with all checks of a reconstruction, and writes its page.
fn film(arguments: &Arguments, config: &Config) -> Result<Result<()>> {
    interrupt::install()?;
    let clip = ready(&arguments.clip, config, arguments.quiet)?;
    let folder = match &arguments.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), &format!("check-{}", clip.name))?,
    };
    publish(&folder, &clip, &arguments.clip.display().to_string(), &config.to_toml()?)?;
    let page = folder.path(PAGE);
    if arguments.json {
        return Seen { page: Some(page.display().to_string()), ..Seen::of(&clip, &arguments.clip) }.print().map(Ok);
    }
    let camera = &clip.cameras[0];
    say!("film {} ({})", clip.name, arguments.clip.display());
    say!(
        "  {} frames of {} × {} pixels, {:.4} s apart",
        clip.frame_count(),
        camera.width,
        camera.height,
        clip.frame_dt()
    );
    for phase in clip.story.iter().flat_map(|story| &story.phases) {
        let (first, last) = (phase.frames.start(), phase.frames.end());
        say!("  {:<8} frames {first} to {last}, {:.3} s to {:.3} s", phase.doing.name(), phase.begin.0, phase.end.0);
    }
    clip.said().for_each(|line| say!("  {line}"));
    if let Some(flight) = &clip.flight {
        let deviations = flight.velocity_deviation();
        say!("  the object starts with {:.3?} m/s (± {deviations:.3?}) at {:.3?} m", flight.velocity, flight.centre);
        say!("  axes: x {}, y {}, z {}", AXES[0], AXES[1], AXES[2]);
    }
    let warnings = clip.assumptions.iter().filter(|line| line.starts_with(WARNING)).count();
    match warnings {
        0 => say!("  ready to open"),
        _ => say!("  ready to open, but for what the warning says"),
    }
    say!("  page: {}", page.display());
    Ok(Ok(()))
}
