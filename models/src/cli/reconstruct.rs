//! `gradreel reconstruct`: reconstructs a clip.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::backend::cpu::pool;
use gradreel::{Error, ErrorKind, Result};

use crate::cli::film::{ChoiceArguments, FilmArguments};
use crate::cli::ground::GroundArguments;
use crate::cli::imagine::{self, ImagineArguments};
use crate::cli::output::{say, tell};
use crate::cli::published::{self, PublishedArguments, Unfit};
use crate::cli::unit::{self, Named, number_in};
use crate::field::{bounding_sphere, hull};
use crate::identify::{
    Config, MaterialConfig, OwnLaw, Reconstruction, Run, Standing, WorldConfig, half_of_imagined, reconstruct,
};
use crate::monocular;
use crate::physics::Law;
use crate::report::reconstruction::{publish, quantities};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::text;
use crate::vector::minus;
use crate::video::{Camera, Clip, Film, OpenOptions};

/// Arguments of `gradreel reconstruct`.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct Arguments {
    /// A GIF, a video file or a folder of pictures from one camera; or a folder with calibrated cameras: PAC-NeRF, NeRF/D-NeRF,
    /// COLMAP or Spring-Gaus layout (see `gradreel check --help`)
    clip: PathBuf,
    /// Folder for the results [default: runs/<clip>, runs/<clip>-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the run in --out where it was interrupted
    #[arg(long, requires = "out")]
    resume: bool,
    /// Settings as TOML; what it does not name keeps its default (see config.toml of any run)
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// What the object is made of: elastic, plasticine, newtonian, non_newtonian or sand, auto to let each of these try,
    /// or the name of a law [default: elastic]
    #[arg(long, value_name = "NAME", conflicts_with = "resume")]
    material: Option<String>,
    /// A file with a law of your own in WGSL; it is copied into the folder of the run (see docs/guide/laws.md)
    #[arg(long, value_name = "FILE.wgsl", conflicts_with_all = ["resume", "material"])]
    law: Option<PathBuf>,
    /// Values to start from, for example young=10kPa,yield_stress=500, in SI units if without a unit; the law's own for those not named
    #[arg(long, value_delimiter = ',', value_name = "NAME=VALUE", value_parser = Named::read, conflicts_with = "resume")]
    start: Vec<Named>,
    /// Young's modulus to start from [Pa, or with a unit: 100kPa]
    #[arg(long, value_name = "PA", value_parser = |text: &str| number_in(text, "Pa"))]
    #[arg(allow_negative_numbers = true, conflicts_with = "resume")]
    young: Option<f64>,
    /// Poisson ratio to start from
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true, conflicts_with = "resume")]
    poisson: Option<f64>,
    /// Density of the object [kg/m³]; a wrong one scales Young's modulus alike
    #[arg(long, value_name = "KG/M3", value_parser = |text: &str| number_in(text, "kg/m³"))]
    #[arg(allow_negative_numbers = true, conflicts_with = "resume")]
    density: Option<f64>,
    /// The object spins as it flies: find its initial angular velocity as well
    #[arg(long, conflicts_with = "resume")]
    spin: bool,
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
    #[command(flatten)]
    published: PublishedArguments,
}

const EXAMPLES: &str = "\
Examples:
  gradreel reconstruct examples/clips/bird.gif                 the bundled film
  gradreel reconstruct examples/clips/bird                     the same from seven calibrated cameras
  gradreel reconstruct my.gif                                  one camera of which nothing is known; also .mp4, .mov, or a folder
  gradreel reconstruct frames --fps 240 --masks masks          slow motion as a folder of pictures, with a mask for each
  gradreel reconstruct my.mp4 --matting u2net.onnx             a matting network tells the object from the background
  gradreel reconstruct my/clip --cameras 0,4 --out runs/two    two cameras only
  gradreel reconstruct my/clip --material plasticine --start yield_stress=500
  gradreel reconstruct my/clip --out runs/two --resume         go on after Ctrl-C
  gradreel reconstruct examples/clips/bird.gif --method published   the chain of the paper, from one camera

A film must show the object fall freely in three frames at least, and hit the ground: gravity gives the pixels their metres. Hands,
waiting and further bounces may be in it; the part to use is found. The object is told from the background by --masks, --matting or --background, by the film's transparency, a plain background, or
by what is seen while it is elsewhere; the camera stands still.

Look at a clip first with `gradreel check my/clip`. The results are in index.html of the output folder.";

/// Maximum distance of the ground from the object, in distances of the cameras from it.
const FAR_GROUND: f64 = 10.0;

/// Reconstructs a clip into a folder.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    let progress = Progress::new(arguments.quiet);
    let (mut run, mut clip) = if arguments.resume { resume(arguments)? } else { begin(arguments)? };
    // buffers that wait for their next use count towards what may be in memory
    pool::set_limit(pool::limit().min(run.config.world.memory_mib << 19));
    let go_on = |error: Error, run: &Run| match error.kind() {
        ErrorKind::Interrupted => error.fix(format!(
            "go on with `gradreel reconstruct {} --out {} --resume`",
            arguments.clip.display(),
            run.folder.root().display()
        )),
        _ => error,
    };
    imagine::imagined(&mut clip, &mut run, &progress).map_err(|error| go_on(error, &run))?;
    if !arguments.quiet {
        let imagined = match clip.imagined.iter().filter(|imagined| **imagined).count() {
            0 => String::new(),
            count => format!(" ({count} imagined)"),
        };
        tell!(
            "{}: {} cameras{imagined}, {} frames → {}",
            clip.name,
            clip.cameras.len(),
            clip.frame_count(),
            run.folder.root().display()
        );
        clip.said().for_each(|line| tell!("  {line}"));
    }
    let found = match run.config.published.is_some() {
        true => published::finish(&clip, &mut run, &progress, arguments.quiet).map_err(|error| go_on(error, &run))?,
        false => {
            let found = reconstruct(&clip, &mut run, &progress).map_err(|error| go_on(error, &run))?;
            publish(&found, &run, &clip, &progress)?;
            found
        }
    };
    summarise(&found, &run);
    Ok(())
}

impl Arguments {
    /// Options for which the published method has no use.
    fn unfit(&self) -> [Unfit; 1] {
        [Unfit {
            option: "--imagine or --views",
            given: self.imagine.are_given(),
            reason: "the published method makes views of every frame itself",
            fix: "leave it out; the model is chosen with --weights FILE",
        }]
    }

    /// The first option given that sets a starting value of a material parameter.
    fn told_of_material(&self) -> Option<&'static str> {
        let told = [("--start", !self.start.is_empty()), ("--young", self.young.is_some())];
        let told = told.into_iter().chain([("--poisson", self.poisson.is_some())]);
        told.filter(|(_, given)| *given).map(|(option, _)| option).next()
    }

    /// Starting values of a law's parameters from the command line.
    fn starts(&self, law: &Law) -> Result<BTreeMap<String, f64>> {
        let mut values = unit::of_law(&self.start, law, "--start")?;
        for (name, option, value) in [("young", "--young", self.young), ("poisson", "--poisson", self.poisson)] {
            let Some(value) = value else { continue };
            if values.insert(name.to_owned(), value).is_some() {
                return Err(Error::new(ErrorKind::Input, "two values of a parameter to start from")
                    .at(format!("{option} and --start {name}"))
                    .fix("give one of them"));
            }
        }
        Ok(values)
    }
}

fn begin(arguments: &Arguments) -> Result<(Run, Clip)> {
    if let Some(folder) = &arguments.out {
        super::place::check(folder, Some(&arguments.clip))?;
    }
    let mut config = match &arguments.config {
        None => Config::default(),
        Some(path) => read_config(path)?,
    };
    arguments.film.check_is_of(&arguments.clip)?;
    arguments.choice.apply(&mut config.clip)?;
    if let Some(material) = &arguments.material {
        config.material =
            MaterialConfig { name: material.clone(), law: None, own: OwnLaw::default(), ..config.material };
    }
    if let Some(law) = &arguments.law {
        config = config.with_law(Law::read(law)?);
    }
    if let (true, Some(option)) = (config.chooses_family(), arguments.told_of_material()) {
        return Err(Error::new(ErrorKind::Input, "values of a material whose family is still to be chosen")
            .at(option)
            .found("the material `auto`")
            .fix("leave it out, or name the family with --material"));
    }
    let law = config.law()?;
    config.material.start.extend(arguments.starts(&law)?);
    arguments.film.apply(&mut config.clip.film)?;
    arguments.imagine.apply(&mut config);
    arguments.published.apply(&mut config, arguments.imagine.seed())?;
    config.world.density = arguments.density.unwrap_or(config.world.density);
    arguments.ground.apply(&mut config);
    config.estimate.spin |= arguments.spin;
    config.check()?;
    match config.published {
        Some(_) => published::check(&config, &arguments.unfit())?,
        None => arguments.imagine.check_seed()?,
    }
    config.material.held =
        (!config.chooses_family()).then_some(config.held(&law)?.into_iter().map(str::to_owned).collect());
    // open the clip first, so that an unusable one leaves no folder
    let clip = ready(&arguments.clip, &config, arguments.quiet)?;
    let folder = match &arguments.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), &clip.name)?,
    };
    Ok((Run::create(folder, config, &clip)?, clip))
}

/// Reads a configuration file, to be completed by the command line before it is validated.
pub(super) fn read_config(path: &Path) -> Result<Config> {
    let fix = "give the path of a TOML file to --config";
    let text = text::read(path, "the configuration", fix, text::SETTINGS)?;
    let mut config = Config::read(&text).map_err(|e| e.at(path.display()))?;
    config.read_law(path.parent().unwrap_or(Path::new(".")))?;
    Ok(config)
}

fn resume(arguments: &Arguments) -> Result<(Run, Clip)> {
    let given = [
        arguments.film.are_given(),
        arguments.choice.are_given(),
        arguments.ground.are_given(),
        arguments.imagine.are_given(),
    ];
    if given.contains(&true) {
        return Err(Error::new(ErrorKind::Input, "what is used of the clip, and known of it, belongs to the run")
            .at("--resume")
            .found("options about the clip, too")
            .fix("leave them out to go on with the run, or begin another one"));
    }
    let folder = arguments.out.as_deref().unwrap_or(Path::new("."));
    let mut run = Run::open(RunFolder::resume(folder)?)?;
    let mut clip = open(&arguments.clip, &run.config, arguments.quiet)?;
    imagine::given(&mut clip, &run.config)?;
    run.go_on(&clip)?;
    Ok((run, clip))
}

/// Opens a clip and performs all checks required for a reconstruction.
pub(super) fn ready(path: &Path, config: &Config, quiet: bool) -> Result<Clip> {
    let mut clip = open(path, config, quiet)?;
    if let Some(published) = &config.published {
        published::check_clip(&clip, published)?;
    }
    check_start(&mut clip, config)?;
    check_ground(&clip, config)?;
    Ok(clip)
}

/// Adds given views to a clip, and rejects a clip without a usable object in its first frame.
pub(super) fn check_start(clip: &mut Clip, config: &Config) -> Result<()> {
    imagine::given(clip, config)?;
    check_shrink(clip, config.clip.shrink)?;
    check_body(clip, config)
}

/// Rejects cameras and masks that contradict each other, and too many voxels.
fn check_body(clip: &Clip, config: &Config) -> Result<()> {
    let sphere = bounding_sphere(clip, 0)?;
    let spacing = if config.geometry.dx > 0.0 { 0.5 * config.geometry.dx } else { sphere.radius / 20.0 };
    hull(clip, 0, &sphere, spacing, config.geometry.hull_coverage, half_of_imagined(clip)).map(|_| ())
}

/// Rejects a ground height at which no camera can see the contact.
fn check_ground(clip: &Clip, config: &Config) -> Result<()> {
    let WorldConfig { ground, find_ground, .. } = config.world;
    match far_ground(clip, ground)?.filter(|_| !find_ground) {
        None => Ok(()),
        Some(far) => Err(Error::new(ErrorKind::Input, "the ground is far from what the cameras see")
            .at("world.ground")
            .found(far)
            .wanted("the height of the ground below the object [m]")
            .fix("give its height with --ground, or --ground auto")),
    }
}

/// A message if the ground is so far from the object that no camera sees both.
pub(super) fn far_ground(clip: &Clip, ground: f64) -> Result<Option<String>> {
    let sphere = bounding_sphere(clip, 0)?;
    let distance = |camera: &Camera| minus(camera.centre(), sphere.centre).into_iter().fold(0.0, f64::hypot);
    let cameras = clip.cameras.iter().map(distance).fold(0.0, f64::max);
    let height = sphere.centre[1];
    Ok(((ground - height).abs() > FAR_GROUND * (cameras + sphere.radius)).then(|| {
        format!("the ground at y = {ground:?} m, the object at y = {height:.3} m, {cameras:.3} m from the cameras")
    }))
}

/// Rejects a factor that leaves fewer than eight pixels along an image side.
fn check_shrink(clip: &Clip, shrink: usize) -> Result<()> {
    let side = clip.cameras.iter().map(|camera| camera.width.min(camera.height)).min().unwrap_or(0);
    let most = (side / 8).max(1);
    if shrink <= most {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "images shrunk that much show nothing")
        .at("clip.shrink")
        .found(format!("{shrink}, for images of {side} pixels"))
        .wanted(format!("at most {most}"))
        .fix("choose a smaller factor in the file of --config, or 0 for an automatic one"))
}

/// The selection of cameras and frames in the settings.
pub(super) fn options(config: &Config) -> OpenOptions {
    OpenOptions {
        cameras: Some(config.clip.cameras.clone()).filter(|cameras| !cameras.is_empty()),
        first_frame: config.clip.first_frame,
        max_frames: Some(config.clip.frames).filter(|&frames| frames > 0),
        progress: false,
    }
}

pub(super) fn open(path: &Path, config: &Config, quiet: bool) -> Result<Clip> {
    let options = OpenOptions { progress: !quiet, ..options(config) };
    let gravity = config.world.gravity;
    check_is_clip(path)?;
    if let (true, Some(camera)) = (Film::is_at(path), config.clip.cameras.iter().find(|camera| **camera != 0)) {
        return Err(Error::new(ErrorKind::Input, format!("camera {camera} is not in the clip"))
            .at(path.display())
            .found("a film of a single camera, number 0")
            .fix("leave the choice of cameras out"));
    }
    let mut clip = match Film::is_at(path) {
        true => monocular::clip_of_film(path, &config.clip.film, &options, gravity)?,
        false => Clip::open(path, &options)?,
    };
    check_motion(&mut clip, config)?;
    Ok(clip)
}

/// Fits the ballistic phase of a single-camera clip, and rejects a clip without motion.
pub(super) fn check_motion(clip: &mut Clip, config: &Config) -> Result<()> {
    if let Some(imagined) = &config.clip.imagined {
        clip.imagine(imagined)?;
    }
    if clip.flight.is_none() {
        monocular::sight(clip, config.world.gravity)?;
    }
    if clip.frame_count() < 2 {
        return Err(Error::new(ErrorKind::Input, "a clip needs at least two frames to show motion")
            .at(clip.root.display())
            .found(format!("{} frame", clip.frame_count()))
            .fix("raise --frames, or add images to the clip"));
    }
    Ok(())
}

/// Rejects a path that is neither a film nor a folder nor the list of a clip.
///
/// # Errors
/// [`ErrorKind::Input`] naming what is missing.
pub(super) fn check_is_clip(path: &Path) -> Result<()> {
    let refused = |what: &str, found: String| {
        Err(Error::new(ErrorKind::Input, what)
            .at(path.display())
            .found(found)
            .wanted(
                "a GIF, a video file, a folder of numbered PNG or JPEG pictures, or the folder of a calibrated clip",
            )
            .fix("give the path of such a file or folder (see `gradreel check --help`)"))
    };
    let ending = path.extension().map(|ending| ending.to_string_lossy().into_owned());
    match ending {
        _ if !path.exists() && Film::is_name(path) => refused("there is no such film", "nothing".to_owned()),
        Some(ending) if path.is_file() && !Film::is_name(path) && ending != "json" => {
            refused("the film has no format that is read", format!("a file that ends in .{ending}"))
        }
        _ => Ok(()),
    }
}

fn summarise(found: &Reconstruction, run: &Run) {
    say!();
    if !run.state.standings.is_empty() {
        say!("  family             loss   less probable by e^   after the stage");
        for Standing { family, stage, loss, behind } in &run.state.standings {
            say!("  {family:<14} {loss:>8.5} {behind:>21.1}   {stage}");
        }
        say!("  chosen: {}\n", run.config.hypothesis());
    }
    for quantity in quantities(found, run) {
        let known = match (quantity.readable_interval(), quantity.determined) {
            (Some(interval), Some(false)) => format!("not determined by this clip: 90 % {interval}"),
            (Some(interval), _) => format!("90 % {interval}"),
            (None, _) => quantity.source.clone(),
        };
        say!("  {:<22} {:>12}   {known}", quantity.label, quantity.shown());
    }
    say!("\n  open {}", run.folder.path("index.html").display());
}
