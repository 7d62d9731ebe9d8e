//! `gradreel simulate`: runs a scene file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use gradreel::{Error, ErrorKind, Key, Result};

use super::resimulate;
use crate::cli::output::{self, say, tell};
use crate::phone::{self, Degradation};
use crate::physics::{Number, law_file, name_of};
use crate::report::quantity::readable;
use crate::report::simulation::{Format, Record};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::scenes::{Film, Precision, Runner, SceneFile, Setup};

/// Arguments of `gradreel simulate`.
#[derive(clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Arguments {
    /// The scene: a TOML file (see below)
    #[arg(required_unless_present = "from")]
    scene: Option<PathBuf>,
    /// Folder for the results [default: runs/<scene>, runs/<scene>-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the run in --out where it was interrupted
    #[arg(long, requires = "out")]
    resume: bool,
    /// Say what would be done, and stop
    #[arg(long)]
    plan: bool,
    /// Simulate for so long instead [s]
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Compute with these numbers instead
    #[arg(long, value_name = "TYPE", value_parser = ["f32", "f64"])]
    precision: Option<String>,
    /// Files to write for each frame
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', default_value = "ply")]
    frames: Vec<Format>,
    /// Film it with a ring of cameras into clip/, with the settings of [film] in the scene; or, with the name of a video file, as a
    /// phone does with the first of them
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    film: Option<Option<PathBuf>>,
    /// What the film of a phone has that a film of a studio has not
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "film")]
    degrade: Vec<Degradation>,
    /// Other seeds shake, shade and wait otherwise
    #[arg(long, value_name = "NUMBER", default_value_t = 1, requires = "film")]
    seed: u32,
    /// No animation
    #[arg(long)]
    no_gif: bool,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    again: resimulate::Arguments,
}

const HELP: &str = "\
A scene file:

    [time]
    duration_s = 1.0
    frames_per_s = 24             # default 24
    # substeps_per_frame = 200    # found from the speed of sound if left out
    [grid]
    spacing_m = 0.03              # particles are half of it apart (particles_per_cell = 8)
    # flip = 0.0                  # 0 APIC (calm) … 1 FLIP (lively);  precision = \"f64\"
    [ground]                      # a floor; contact: sticky, slip, separate, friction
    contact = \"friction\"
    friction = 0.4
    [materials.rubber]            # any name
    law = \"neo_hookean\"           # and its parameters, in SI units
    density_kg_m3 = 1000
    young = 2e5                   # Pa
    poisson = 0.4
    [[objects]]                   # as many as you like
    material = \"rubber\"
    shape.sphere = { centre_m = [0, 0.5, 0], radius_m = 0.15 }
    velocity_m_s = [0.5, 0, 0]
    spin_rad_s = [0, 0, 8]
    [[colliders]]                 # solid, or container = true; may move
    shape.box = { centre_m = [0.6, 0.2, 0], size_m = [0.1, 0.4, 0.6] }
    velocity_m_s = [-0.3, 0, 0]

    [film]                        # as with --film: cameras around the scene make a clip of it
    cameras = 7                   # pixels, field_of_view_deg, elevation_deg, target_m, distance_m, pattern

Shapes of objects:    box, sphere, cylinder, cone, torus, mesh (file = OBJ, PLY or STL; scale; translate_m),
                      particles (file = PLY or npy)
Shapes of colliders:  plane, box, sphere, cylinder
Laws:                 neo_hookean, fixed_corotated, stvk_hencky (young, poisson); von_mises (+ yield_stress);
                      drucker_prager (young, poisson, friction_angle [deg], cohesion); newtonian (viscosity, bulk);
                      viscoplastic (shear, bulk, yield_stress, plastic_viscosity);
                      snow (young, poisson, critical_compression, critical_stretch, hardening);
                      or a file of your own, law = \"my.wgsl\" (docs/guide/laws.md)

Examples:
  gradreel simulate examples/scenes/rubber.toml                 a folder in runs/ with an index.html
  gradreel simulate my.toml --plan                              particles, memory and substeps only
  gradreel simulate my.toml --out runs/my --frames ply,npy      both kinds of files
  gradreel simulate my.toml --out runs/my --film                then: gradreel reconstruct runs/my/clip
  gradreel simulate my.toml --film ball.mp4 --degrade hand_release,shake,blur
                                                                as a phone films it, with its truth in ball.json
  gradreel simulate --from runs/bird --set young=1e6            what was reconstructed, stiffer, beside its clip
  gradreel simulate my.toml --out runs/my --resume              go on after Ctrl-C

The folder holds frames/frame_0000.ply …, motion.gif, totals.json (mass, momentum, energy), scene.toml and index.html.";

/// Simulates a scene into a folder.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let scene = match (&arguments.again.from, &arguments.scene) {
        (Some(from), _) => return resimulate::run(&arguments.again, from, arguments.out.as_deref(), arguments.quiet),
        (None, scene) => scene.as_deref().unwrap_or(Path::new("")),
    };
    interrupt::install()?;
    if let Some(out) = arguments.out.as_deref().filter(|_| !arguments.resume && !arguments.plan) {
        RunFolder::can_be_created(out)?;
    }
    simulate_scene(arguments, scene, SceneFile::read(scene)?)
}

fn simulate_scene(arguments: &Arguments, scene: &Path, mut file: SceneFile) -> Result<()> {
    if let Some(Some(out)) = &arguments.film {
        return film_of_phone(arguments, scene, &file, out);
    }
    if arguments.film.is_some() {
        file.film.get_or_insert_default();
    }
    file.time.duration_s = arguments.duration.unwrap_or(file.time.duration_s);
    match arguments.precision.as_deref() {
        Some("f64") => file.grid.precision = Precision::F64,
        Some(_) => file.grid.precision = Precision::F32,
        None => {}
    }
    let folder = scene.parent().unwrap_or(Path::new("."));
    let setup = Setup::of(&with_own_laws(&file, arguments), folder).map_err(|e| e.within(scene.display()))?;
    let film = file.film.as_ref().map(|settings| Film::of(&setup, settings)).transpose();
    let film = film.map_err(|e| e.within(scene.display()))?;
    if !arguments.quiet {
        print_plan(&stem(scene), &file, &setup);
    }
    if arguments.plan {
        return output::arrived();
    }
    match setup.precision {
        Precision::F32 => simulate::<f32>(arguments, scene, &file, &setup, film),
        Precision::F64 => simulate::<f64>(arguments, scene, &file, &setup, film),
    }
}

/// Films a scene as a phone does.
fn film_of_phone(arguments: &Arguments, scene: &Path, file: &SceneFile, out: &Path) -> Result<()> {
    if out.exists() {
        return Err(Error::new(ErrorKind::Input, "there is a file of this name")
            .at(out.display())
            .fix("remove it, or give another name to --film"));
    }
    let progress = Progress::new(arguments.quiet);
    let folder = scene.parent().unwrap_or(Path::new("."));
    let key = Key::new(u64::from(arguments.seed));
    let truth = phone::film(file, folder, &arguments.degrade, key, out, &progress)
        .map_err(|error| error.within(scene.display()))?;
    if !arguments.quiet {
        say!(
            "{} frames, {} a second; what is true of them: {}",
            truth.frames,
            truth.fps,
            out.with_extension("json").display()
        );
    }
    Ok(())
}

/// The scene with the laws that a run which goes on has kept, in place of files that may have changed since.
fn with_own_laws(file: &SceneFile, arguments: &Arguments) -> SceneFile {
    let mut file = file.clone();
    if let (true, Some(out)) = (arguments.resume, &arguments.out) {
        for given in file.materials.values_mut().filter(|given| given.law.ends_with(".wgsl")) {
            let kept = out.join(law_file(&name_of(&given.law)));
            if let (true, Ok(kept)) = (kept.is_file(), kept.canonicalize()) {
                given.law = kept.to_string_lossy().into_owned();
            }
        }
    }
    file
}

/// Simulates a self-contained scene and renders a clip of it into a new folder, without output.
pub(super) fn film(file: SceneFile, name: &str, out: &Path) -> Result<()> {
    let arguments = Arguments {
        scene: None,
        out: Some(out.to_owned()),
        resume: false,
        plan: false,
        duration: None,
        precision: None,
        frames: Vec::new(),
        film: Some(None),
        degrade: Vec::new(),
        seed: 1,
        no_gif: true,
        quiet: true,
        again: resimulate::Arguments::default(),
    };
    simulate_scene(&arguments, Path::new(name), file)
}

fn simulate<T: Number>(
    arguments: &Arguments,
    scene: &Path,
    file: &SceneFile,
    setup: &Setup,
    film: Option<Film>,
) -> Result<()> {
    let name = stem(scene);
    let text =
        toml::to_string_pretty(file).map_err(|e| Error::new(ErrorKind::Io, "the scene cannot be written").found(e))?;
    let folder = match &arguments.out {
        _ if arguments.resume => RunFolder::resume(arguments.out.as_deref().unwrap_or(Path::new(".")))?,
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), &name)?,
    };
    let mut record = Record::new(folder, &name, &text, file, setup, &arguments.frames);
    record.animated = !arguments.no_gif;
    record.film = film;
    let mut runner = if arguments.resume {
        Runner::<T>::resume(setup, &record.resume()?)?
    } else {
        record.begin()?;
        Runner::<T>::new(setup)?
    };
    let root = record.root().display().to_string();
    let go_on = format!("go on with `gradreel simulate {} --out {root} --resume`", scene.display());
    let progress = Progress::new(arguments.quiet);
    let last = setup.schedule.frames - 1;
    let mut frame = runner.frame();
    if !arguments.resume {
        record.add(&frame)?;
    }
    let stage = progress.stage("simulating", last as u64);
    let begun = Instant::now();
    while frame.index < last {
        let advanced = match runner.advance(|| !interrupt::requested()) {
            Ok(advanced) => advanced,
            Err(error) => {
                record.publish(begun.elapsed().as_secs_f64())?;
                return Err(error
                    .within(format!("between frames {} and {}", frame.index, frame.index + 1))
                    .fix(format!(
                        "give more substeps (time.substeps_per_frame, {} here; or a smaller time.cfl), a softer material or \
                         wider world.bounds_m; what went before is in {root}",
                        frame.substeps
                    )));
            }
        };
        if !advanced {
            record.save(&runner.snapshot())?;
            record.publish(begun.elapsed().as_secs_f64())?;
            return interrupt::check().map_err(|e| e.fix(go_on));
        }
        let before = frame.substeps;
        frame = runner.frame();
        if frame.substeps != before && !arguments.quiet {
            tell!("  frame {}: {} substeps per frame from here on, not {before}", frame.index, frame.substeps);
        }
        record.add(&frame)?;
        record.save_now_and_then(|| runner.snapshot())?;
        stage.set(frame.index as u64, &format!("fastest {:.2} m/s", frame.totals.fastest_m_s));
    }
    stage.finish("");
    record.publish(begun.elapsed().as_secs_f64())?;
    record.forget_state()?;
    if !arguments.quiet {
        say!("\n  open {}", record.root().join("index.html").display());
        if record.film.is_some() {
            say!("  clip {}", record.root().join("clip").display());
        }
    }
    Ok(())
}

/// Name of the scene: that of its file.
fn stem(scene: &Path) -> String {
    scene.file_stem().map_or("scene".into(), |stem| stem.to_string_lossy().into_owned())
}

/// Prints the plan of a simulation.
fn print_plan(name: &str, file: &SceneFile, setup: &Setup) {
    let title = if file.title.is_empty() { name } else { &file.title };
    say!("{title}");
    let line = |label: &str, text: String| say!("  {label:<11} {text}");
    for (index, object) in file.objects.iter().enumerate() {
        let count = setup.object_of.iter().filter(|&&of| of as usize == index).count();
        let stuff =
            &setup.materials[setup.material_of[setup.object_of.partition_point(|&of| (of as usize) < index)] as usize];
        let mass = count as f64 * setup.volumes[index] * stuff.density;
        let text = format!("{} ({}), {count} particles, {}", object.material, stuff.law.name(), readable(mass, "kg"));
        line(&format!("object {index}"), text);
    }
    let [particles, grid] = setup.memory().map(|bytes| bytes as f64 / f64::from(1 << 20));
    let precision = if setup.precision == Precision::F64 { "f64" } else { "f32" };
    line("particles", format!("{}, {precision}, about {particles:.0} MiB, and {grid:.0} MiB of grid", setup.len()));
    let schedule = setup.schedule;
    let dt = schedule.dt();
    line("time", format!("{} frames of {:.4} s, {} s", schedule.frames - 1, schedule.frame_dt, file.time.duration_s));
    let [sound, speed] = setup.speeds;
    let share = (sound + speed) * dt / setup.world.dx;
    line(
        "substeps",
        format!(
            "{} per frame ({}), {dt:.3e} s: sound {sound:.1} m/s and particles {speed:.1} m/s cross {share:.2} cells",
            schedule.substeps,
            if setup.automatic { "found" } else { "given" },
        ),
    );
    if let Some(film) = &file.film {
        let [width, height] = film.pixels;
        line("film", format!("{} cameras of {width} × {height} pixels", film.cameras));
    }
    setup.notes.iter().for_each(|note| line("note", note.clone()));
    line("work", format!("{:.3e} particle substeps", setup.len() as f64 * schedule.steps() as f64));
}
