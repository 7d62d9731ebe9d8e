//! Output of a finished (or interrupted) reconstruction.

use std::collections::BTreeMap;

use gradreel::{Result, Tape, Tensor};

use crate::identify::{FRICTION, GroundContact, HistoryRow, Reconstruction, Run, Stage, Standing};
use crate::render::{Rays, Splat, render};
use crate::report::animation::{Picture, gif};
use crate::report::film;
use crate::report::page::{Drawing, Headline, Page, Scene};
use crate::report::plot::{Plot, Series};
use crate::report::ply::ply;
use crate::report::png_file::png;
use crate::report::quantity::{Quantity, compact, parameters_json};
use crate::report::synthesis::PAGE;
use crate::runtime::progress::Progress;
use crate::video::{Bounces, Camera, Clip, Hit, Known};

/// Maximum number of cameras shown in the animation.
const SHOWN_CAMERAS: usize = 2;

/// Writes particles, pictures, plots, `parameters.json` and `index.html`; returns the quality metrics.
///
/// `clip` is the clip at full resolution.
///
/// # Errors
/// Errors of simulating, rendering and writing.
pub fn publish(found: &Reconstruction, run: &Run, clip: &Clip, progress: &Progress) -> Result<BTreeMap<String, f64>> {
    publish_with(found, run, clip, progress, None)
}

/// What a run of other stages than the project's own shows of them, in place of those.
#[derive(Debug, Default)]
pub struct Beside {
    /// Pictures of stages.
    pub drawings: Vec<Drawing>,
    /// Curves, convergence among them.
    pub plots: Vec<Plot>,
    /// Stages with their durations \[s\].
    pub timings: Vec<(String, f64)>,
    /// More files in the folder: link and description.
    pub files: Vec<(String, String)>,
}

/// As [`publish`], with the stages of another method.
///
/// # Errors
/// As [`publish`].
pub fn publish_with(
    found: &Reconstruction,
    run: &Run,
    clip: &Clip,
    progress: &Progress,
    beside: Option<Beside>,
) -> Result<BTreeMap<String, f64>> {
    let motion = found.motion(run)?;
    let frames = clip.frame_count();
    let bar = progress.stage("writing the results", frames as u64 + 1);
    let positions: Vec<Vec<[f32; 3]>> = (0..frames).map(|frame| frame_positions(&motion, frame)).collect();
    let colours: Vec<[u8; 3]> =
        found.particles.colour.iter().map(|c| c.map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8)).collect();
    for (frame, points) in positions.iter().enumerate() {
        run.folder.write(&format!("particles/frame_{frame:03}.ply"), &ply(points, Some(&colours))?)?;
    }
    let shown: Vec<usize> = spread(clip.cameras.len(), SHOWN_CAMERAS);
    let mut pictures = Vec::with_capacity(frames);
    let mut agreement = Agreement::default();
    for (frame, points) in positions.iter().enumerate() {
        let mut tiles = Vec::new();
        for (index, camera) in clip.cameras.iter().enumerate() {
            let rgba = picture_of(found, run, points, camera)?;
            let image = &clip.frames[index][frame];
            agreement.add(&rgba, &image.rgb, &image.alpha, &image.weight);
            if shown.contains(&index) {
                let filmed: Vec<f32> = image.rgb.iter().copied().collect();
                tiles.push(Picture::from_unit(camera.width, camera.height, &filmed)?);
                let on_white: Vec<f32> = rgba.chunks(4).flat_map(|p| [0, 1, 2].map(|c| p[c] + 1.0 - p[3])).collect();
                tiles.push(Picture::from_unit(camera.width, camera.height, &on_white)?);
            }
        }
        pictures.push(Picture::grid(2, &tiles));
        bar.set(frame as u64 + 1, "");
    }
    let rate = if clip.frame_dt() > 0.0 { 1.0 / clip.frame_dt() } else { 1.0 };
    let animation = gif(&pictures, (rate / 3.0).clamp(2.0, 12.0))?;
    run.folder.write("input_and_reconstruction.gif", &animation)?;
    if let Some(last) = pictures.last() {
        run.folder.write("last_frame.png", &png(last)?)?;
    }
    let mut quality = agreement.figures();
    quality.insert("particles".into(), found.particles.len() as f64);
    quality.insert("volume_m3".into(), found.particles.volume());
    let quantities = quantities(found, run);
    let assumed = assumed(run);
    run.folder.write("parameters.json", &parameters_json(found.law.name(), &quantities, &assumed, &quality)?)?;
    let own = beside.is_none();
    let beside = beside.unwrap_or_default();
    let plots = match (bounces(found, run), clip.story.as_deref()) {
        _ if !own => beside.plots,
        (Some(_), Some(story)) => film::height(clip, story).into_iter().collect(),
        _ => plots(found, run),
    };
    for plot in &plots {
        let name = plot.title.to_lowercase().replace([' ', '\''], "_");
        run.folder.write(&format!("plots/{name}.svg"), plot.svg().as_bytes())?;
    }
    let page = Page {
        title: &clip.name,
        subtitle: format!(
            "{} cameras, {frames} frames at {rate:.3} frames/s; {} particles of {}",
            clip.cameras.len(),
            found.particles.len(),
            found.law.name().replace('_', "-")
        ),
        headlines: quantities.iter().filter(|q| q.determined != Some(false)).map(headline).collect(),
        animation: Some(&animation),
        animation_caption: match &found.changes[..] {
            [] => "Left: the clip, background removed. Right: the reconstruction. Slowed to a third.".into(),
            changes => format!(
                "Left: the clip, background removed. Right: the object reconstructed from it, with {}. Slowed to a third.",
                changes.join(", ")
            ),
        },
        drawings: match (bounces(found, run), clip.story.as_deref()) {
            _ if !own => beside.drawings,
            (Some(_), Some(story)) => film::drawing(clip, story)?.into_iter().collect(),
            _ => vec![],
        },
        scene: Some(Scene {
            frames: positions,
            colours,
            frame_dt: clip.frame_dt(),
            ground: run.config.world.ground as f32,
            cameras: clip.cameras.iter().map(|camera| camera.c2w).collect(),
        }),
        plots,
        notes: notes(found, run, &quantities, &assumed, &quality),
        timings: match own {
            true => run.state.finished.iter().map(Stage::to_string).zip(run.state.seconds.iter().copied()).collect(),
            false => beside.timings,
        },
        config_toml: run.config.to_toml()?,
        files: files(run).into_iter().chain(beside.files).collect(),
    };
    run.folder.write("index.html", page.html().as_bytes())?;
    bar.finish(&format!("{}", run.folder.path("index.html").display()));
    Ok(quality)
}

fn frame_positions(motion: &Tensor, frame: usize) -> Vec<[f32; 3]> {
    let count = motion.dims()[1];
    let part = &motion.slice::<f32>()[frame * count * 3..(frame + 1) * count * 3];
    part.chunks(3).map(|x| [x[0], x[1], x[2]]).collect()
}

/// Premultiplied colour and coverage of every pixel of a camera.
fn picture_of(found: &Reconstruction, run: &Run, points: &[[f32; 3]], camera: &Camera) -> Result<Vec<f32>> {
    let particles = &found.particles;
    let tape = Tape::new();
    let positions = tape.constant(Tensor::from_vec(points.as_flattened().to_vec(), [points.len(), 3]));
    let opacity = tape.constant(particles.opacity(gradreel::DType::F32)?);
    let colour = tape.constant(particles.colour(gradreel::DType::F32)?);
    let rays = std::sync::Arc::new(Rays::of_camera(camera));
    let surface = run.config.surface_of(&found.law);
    let pixels = render(&positions, &opacity, &colour, &rays, &Splat::of(particles, surface), surface)?;
    Ok(pixels.value()?.slice::<f32>().to_vec())
}

/// Up to `count` evenly spaced indices of `0..len`.
fn spread(len: usize, count: usize) -> Vec<usize> {
    let count = count.min(len);
    (0..count).map(|i| i * len / count).collect()
}

/// Accumulated differences of rendered and filmed pixels.
#[derive(Default)]
struct Agreement {
    squared: f64,
    values: f64,
    both: f64,
    either: f64,
}

impl Agreement {
    fn add(
        &mut self,
        rgba: &[f32],
        rgb: &ndarray::Array3<f32>,
        alpha: &ndarray::Array2<f32>,
        weight: &ndarray::Array2<f32>,
    ) {
        for (pixel, ((row, column), &alpha)) in rgba.chunks(4).zip(alpha.indexed_iter()) {
            if weight[[row, column]] == 0.0 || (alpha == 0.0 && pixel[3] == 0.0) {
                continue;
            }
            for c in 0..3 {
                let residual = pixel[c] + 1.0 - pixel[3] - rgb[[row, column, c]];
                self.squared += f64::from(residual * residual);
                self.values += 1.0;
            }
            self.both += f64::from(alpha.min(pixel[3]));
            self.either += f64::from(alpha.max(pixel[3]));
        }
    }

    fn figures(&self) -> BTreeMap<String, f64> {
        let mut figures = BTreeMap::new();
        if self.values > 0.0 && self.either > 0.0 {
            let error = (self.squared / self.values).max(1e-12);
            figures.insert("psnr_on_object_db".into(), -10.0 * error.log10());
            figures.insert("silhouette_iou".into(), self.both / self.either);
        }
        figures
    }
}

/// The estimates with units, labels and starting values.
pub fn quantities(found: &Reconstruction, run: &Run) -> Vec<Quantity> {
    let held = run.config.held(&found.law).unwrap_or_default();
    let known = |name: &str| run.state.intervals.iter().find(|interval| interval.name == name);
    let interval = |name: &str| known(name).filter(|_| !found.given.contains(name));
    let source = |name: &str, assumed: bool| match (found.given.contains(name), assumed) {
        (true, _) => "given".to_owned(),
        (_, true) => "assumed".into(),
        _ => "fitted".into(),
    };
    let starts = run.config.starting_values(&found.law).unwrap_or_else(|_| found.law.start_values());
    let parameters = found.law.parameters().iter().zip(&found.unknowns.parameters).zip(starts);
    let material = parameters.map(|((p, &value), start)| Quantity {
        interval_90: interval(p.name).map(|known| known.interval_90),
        determined: interval(p.name).map(|known| known.determined),
        name: p.name.into(),
        label: label(p.name),
        symbol: p.symbol.into(),
        unit: p.unit.into(),
        value,
        start: Some(start),
        source: source(p.name, held.contains(&p.name)),
    });
    let components = |kind: &str, symbol: &str, unit: &str, values: [f64; 3]| {
        let component = |(axis, value)| {
            let name = format!("{kind}_{axis}");
            Quantity {
                label: format!("Initial {kind}, {axis}"),
                symbol: format!("{symbol}_{axis}"),
                unit: unit.to_owned(),
                value,
                start: Some(0.0),
                source: source(&name, false),
                interval_90: interval(&name).map(|known| known.interval_90),
                determined: interval(&name).map(|known| known.determined),
                name,
            }
        };
        ["x", "y", "z"].into_iter().zip(values).map(component).collect::<Vec<_>>()
    };
    let velocity = components("velocity", "v", "m/s", found.unknowns.velocity);
    let rough = run.config.world.ground_contact == GroundContact::Friction && bounces(found, run).is_none();
    let friction = rough.then(|| Quantity {
        name: FRICTION.into(),
        label: "Friction of the ground".into(),
        symbol: "μ_g".into(),
        unit: "-".into(),
        value: found.unknowns.friction,
        start: None,
        source: source(FRICTION, false),
        interval_90: interval(FRICTION).map(|known| known.interval_90),
        determined: interval(FRICTION).map(|known| known.determined),
    });
    let spin = components("spin", "ω", "rad/s", found.unknowns.spin);
    let hits = bounces(found, run).into_iter().flat_map(of_hits);
    hits.chain(material)
        .chain(friction)
        .chain(velocity)
        .chain(spin.into_iter().filter(|_| run.config.estimate.spin))
        .collect()
}

/// What the flights tell of the hits, unless the object is made to move otherwise.
fn bounces<'a>(found: &Reconstruction, run: &'a Run) -> Option<&'a Bounces> {
    run.state.bounces.as_ref().filter(|_| found.changes.is_empty())
}

/// Restitution, and what a hit leaves of the velocity along the ground.
fn of_hits(bounces: &Bounces) -> Vec<Quantity> {
    let quantity = |name: &str, label: &str, symbol: &str, known: Known, determined: bool| Quantity {
        name: name.into(),
        label: label.into(),
        symbol: symbol.into(),
        unit: "-".into(),
        value: known.value,
        start: None,
        source: "fitted".into(),
        interval_90: Some(known.interval_90()),
        determined: Some(determined),
    };
    let along = bounces.tangential.map(|known| {
        quantity("tangential_ratio", "Velocity along the ground", "e_t", known, known.deviation < TANGENTIAL)
    });
    std::iter::once(quantity("restitution", "Restitution", "e", bounces.restitution, true)).chain(along).collect()
}

/// Largest standard deviation of what a hit leaves along the ground that tells something: a share is between 0 and 1.
const TANGENTIAL: f64 = 0.1;

fn assumed(run: &Run) -> Vec<Quantity> {
    let quantity = |name: &str, label: &str, symbol: &str, unit: &str, value: f64| Quantity {
        name: name.into(),
        label: label.into(),
        symbol: symbol.into(),
        unit: unit.into(),
        value,
        start: None,
        source: "assumed".into(),
        interval_90: None,
        determined: None,
    };
    let world = &run.config.world;
    let sticky = run.state.bounces.is_none() && world.ground_contact == GroundContact::Sticky;
    vec![
        quantity("density", "Density", "ρ", "kg/m³", world.density),
        quantity("gravity_y", "Gravity, y", "g_y", "m/s²", world.gravity[1]),
        quantity(
            "ground",
            if sticky { "Height of the sticky ground" } else { "Height of the ground" },
            "y_0",
            "m",
            world.ground,
        ),
        quantity("dx", "Grid spacing", "dx", "m", run.config.geometry.dx),
    ]
}

/// Display name of a material parameter.
fn label(name: &str) -> String {
    match name {
        "young" => "Young's modulus".into(),
        "poisson" => "Poisson ratio".into(),
        other => other.replace('_', " "),
    }
}

fn headline(quantity: &Quantity) -> Headline {
    let unit = if quantity.unit == "-" { "" } else { &quantity.unit };
    Headline {
        symbol: quantity.symbol.clone(),
        label: quantity.label.clone(),
        readable: quantity.readable(),
        exact: format!("{:.5e} {unit}", quantity.value).trim_end().to_owned(),
        note: match (quantity.readable_interval(), quantity.start) {
            (Some(interval), _) => format!("90 %: {interval}"),
            (None, Some(start)) => format!("{}; started at {} {unit}", quantity.source, compact(start)),
            (None, None) => String::new(),
        },
    }
}

fn notes(
    found: &Reconstruction,
    run: &Run,
    quantities: &[Quantity],
    assumed: &[Quantity],
    quality: &BTreeMap<String, f64>,
) -> Vec<(String, String)> {
    let undetermined = quantities.iter().filter(|q| q.determined == Some(false)).map(|q| {
        let interval = q.readable_interval().map_or(String::new(), |interval| format!("; 90 %: {interval}"));
        (q.label.clone(), format!("{}: not determined by this clip{interval}", q.shown()))
    });
    let assumptions = assumed.iter().map(|q| (q.label.clone(), format!("{} (assumed)", q.readable())));
    let mut notes: Vec<(String, String)> = undetermined.chain(assumptions).collect();
    notes.push((
        "Young's modulus and density".into(),
        "motion shows their ratio only: a body of twice the density with twice the modulus moves alike".into(),
    ));
    for Hit { seconds, speed, restitution, tangential } in bounces(found, run).into_iter().flat_map(|all| &all.hits) {
        let shown = |known: &Known| {
            let [low, high] = known.interval_90();
            format!("{:.2} ({low:.2} to {high:.2})", known.value)
        };
        let along = tangential.map_or_else(String::new, |known| format!(", {} of that along it", shown(&known)));
        let text = format!("with {speed:.2} m/s towards the ground; leaves with {} of it{along}", shown(restitution));
        notes.push((format!("Hit at {seconds:.3} s"), text));
    }
    let imagined = found.clip.cameras.iter().zip(&found.clip.imagined).filter(|(_, imagined)| **imagined);
    let imagined: Vec<String> = imagined.map(|(camera, _)| camera.id.to_string()).collect();
    if !imagined.is_empty() {
        notes.push(("Imagined views".into(), format!("cameras {}: nobody filmed with these", imagined.join(", "))));
    }
    if let Some(contact) = run.state.contact {
        notes.push(("First frame in contact".into(), contact.to_string()));
    }
    let [right, up, scale, _] = found.unknowns.depth_modes();
    if [right, up] != [0.0; 2] {
        let shear = format!("{right:.2} m deeper for each metre to the right, {up:.2} m for each upwards");
        notes.push(("Depth shear".into(), shear));
    }
    if scale != 0.0 {
        let share = format!("{:+.1} % of what its fall alone says, as it is where it lands", 100.0 * scale);
        notes.push(("Depth scale".into(), share));
    }
    let pitch = run.state.unknowns.as_ref().map_or(0.0, |unknowns| unknowns.depth_modes()[3]);
    if pitch != 0.0 {
        let degrees = format!("{:+.1}° from what its fall alone says, as it moves on the ground", pitch.to_degrees());
        notes.push(("Pitch of the camera".into(), degrees));
    }
    for Standing { family, stage, loss, behind } in &run.state.standings {
        let chosen = if *family == run.config.hypothesis() { ": chosen" } else { "" };
        let text = format!("loss {loss:.4} after \"{stage}\", less probable than the best by e^{behind:.1}{chosen}");
        notes.push((format!("As {family}"), text));
    }
    let figure = |name: &str| quality.get(name).copied();
    if let (Some(iou), Some(psnr)) = (figure("silhouette_iou"), figure("psnr_on_object_db")) {
        notes.push((
            "Agreement with the clip".into(),
            format!("silhouette IoU {iou:.3}, PSNR on the object {psnr:.1} dB"),
        ));
    }
    notes.extend(run.state.notes.iter().map(|note| ("Note".into(), note.clone())));
    notes
}

fn plots(found: &Reconstruction, run: &Run) -> Vec<Plot> {
    let history = &run.state.history;
    let mut stages: Vec<Stage> = Vec::new();
    history.iter().for_each(|row| {
        if !stages.contains(&row.stage) {
            stages.push(row.stage);
        }
    });
    let series = |of: &dyn Fn(&HistoryRow) -> Option<f64>, keep: &dyn Fn(Stage) -> bool| -> Vec<Series> {
        let one = |stage: &Stage| Series {
            label: stage.to_string(),
            points: history
                .iter()
                .enumerate()
                .filter(|(_, row)| row.stage == *stage)
                .filter_map(|(i, row)| Some((i as f64 + 1.0, of(row)?)))
                .collect(),
        };
        stages.iter().filter(|stage| keep(**stage)).map(one).collect()
    };
    let plot = |title: &str, y_label: String, log_y: bool, series: Vec<Series>| Plot {
        title: title.into(),
        x_label: "evaluation".into(),
        y_label,
        log_y,
        series,
        reference: None,
    };
    let mut plots = vec![plot("Loss", "loss per pixel of object".into(), true, series(&|row| row.loss, &|_| true))];
    for (index, p) in found.law.parameters().iter().enumerate() {
        let log = p.map == crate::physics::Map::Log10;
        let y_label = if p.unit == "-" { p.symbol.to_owned() } else { format!("{} [{}]", p.symbol, p.unit) };
        let of = |row: &HistoryRow| row.unknowns.parameters.get(index).copied();
        plots.push(plot(&label(p.name), y_label, log, series(&of, &|stage| !stage.is_of_velocity())));
    }
    let axis = |a: usize, name: &str| Series {
        label: name.into(),
        points: history
            .iter()
            .enumerate()
            .filter(|(_, row)| row.stage.is_of_velocity())
            .map(|(i, row)| (i as f64 + 1.0, row.unknowns.velocity[a]))
            .collect(),
    };
    plots.push(plot("Initial velocity", "v [m/s]".into(), false, vec![axis(0, "x"), axis(1, "y"), axis(2, "z")]));
    plots
}

/// Subfolder of a run for its synthesized views.
pub const VIEWS: &str = "views";

fn files(run: &Run) -> Vec<(String, String)> {
    let imagined = format!("{VIEWS}/{PAGE}");
    let imagined =
        run.folder.has(&imagined).then_some((imagined.as_str(), "the views of the first frame that were imagined"));
    [
        ("parameters.json", "every estimate with its SI unit, what was assumed, how well it fits"),
        ("input_and_reconstruction.gif", "the clip beside its reconstruction"),
        ("particles/", "one PLY file a frame: positions in metres (y up) with colours"),
        ("plots/", "convergence as SVG"),
        ("config.toml", "the resolved configuration; pass it with --config to repeat the run"),
        ("state.json", "every evaluation, and where --resume goes on"),
        ("field.safetensors", "the voxels of the first frame"),
    ]
    .into_iter()
    .chain(imagined)
    .map(|(link, what)| (link.to_owned(), what.to_owned()))
    .collect()
}
