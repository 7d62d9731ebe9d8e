//! `gradreel bench depth`: front and back depth from one picture, beside simpler bodies.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gradreel::{Error, ErrorKind, Key, Result};
use serde::Serialize;

use crate::cli::output::say;
use crate::depth::{Comparison, DepthNetwork, Estimate, Figures, Solid, Split, made_solids, read_shapes, two_views};
use crate::report::results_file::{Measured, Section, replace};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::views::objects::TexturedMesh;

/// Arguments of `gradreel bench depth`.
#[derive(clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Arguments {
    /// Folder with shapes_val.safetensors and shapes_test.safetensors
    #[arg(long, value_name = "FOLDER")]
    shapes: PathBuf,
    /// Weights of the network: `built-in`, or the model.safetensors of `gradreel train depth`
    #[arg(long, value_name = "FILE", default_value = DepthNetwork::BUILT_IN)]
    weights: PathBuf,
    /// Measure as well on the meshes in this folder (.obj, .glb, .gltf)
    #[arg(long, value_name = "FOLDER")]
    objects: Option<PathBuf>,
    /// Few pictures, to see that everything runs; the numbers then mean little
    #[arg(long, conflicts_with = "markdown")]
    quick: bool,
    /// Write the figures into this JSON file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the tables with the machine, the commit and the date into their section of this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const HELP: &str = "\
Two pictures of each solid, upright and in any attitude, with exact silhouettes. IoU is along the rays of the camera, the body at its
true distance. \"As deep as wide\" is the union of balls on the silhouette, its thickness times the factor that is best on the
validation split; \"best tilt\" is the same in the true middle plane. Nothing else is chosen, and nothing on the test split.

Examples:
  gradreel bench depth --shapes shapes
  gradreel bench depth --shapes shapes --weights runs/depth/model.safetensors --json depth.json
  gradreel bench depth --shapes shapes --markdown docs/results.md";

/// Keys of the pictures, and of the procedural solids: none that a training uses.
const PICTURES: u64 = 201;
const MADE: u64 = 202;
/// Procedural solids, and nodes of their grids; pictures of a set with --quick.
const SOLIDS: usize = 250;
const NODES: usize = 40;
const QUICK: usize = 24;

/// A set with its figures.
#[derive(Serialize)]
struct Set {
    name: String,
    #[serde(flatten)]
    figures: Figures,
}

/// Measures and prints the tables.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    let network = DepthNetwork::open(&arguments.weights)?;
    let progress = Progress::new(arguments.quiet);
    let chosen = {
        let solids = read_shapes(&arguments.shapes, Split::Val)?;
        compare(&network, "validation split", &solids, arguments, &progress)?.choice()
    };
    let mut sets = vec![("real shapes, test split".to_owned(), read_shapes(&arguments.shapes, Split::Test)?)];
    let count = if arguments.quick { QUICK } else { SOLIDS };
    sets.push(("procedural solids".to_owned(), made_solids(Key::new(MADE), count, NODES)));
    if let Some(folder) = &arguments.objects {
        sets.push(("meshes of --objects".to_owned(), meshes(folder)?));
    }
    let mut found = Vec::new();
    for (name, solids) in sets {
        let figures = compare(&network, &name, &solids, arguments, &progress)?.figures(chosen);
        found.push(Set { name, figures });
    }
    let tables = tables(&found);
    if let Some(file) = &arguments.json {
        let text = serde_json::to_vec_pretty(&found)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write the figures as JSON").found(e))?;
        std::fs::write(file, text)
            .map_err(|e| Error::io(file, "write the figures", &e).fix("name another file with --json"))?;
    }
    say!("{tables}");
    let Some(file) = &arguments.markdown else { return Ok(()) };
    let section = Section {
        name: "depth".into(),
        title: "Front and back depth from one picture".into(),
        split:
            "test split of the shapes, procedural solids that no training uses; factor chosen on the validation split"
                .into(),
        body: tables,
    };
    replace(file, &section, &Measured::here("gradreel"))
}

fn compare(
    network: &DepthNetwork,
    name: &str,
    solids: &[Arc<Solid>],
    arguments: &Arguments,
    progress: &Progress,
) -> Result<Comparison> {
    let stage = progress.stage(name, 0);
    let most = if arguments.quick { QUICK } else { usize::MAX };
    let views = two_views(solids, Key::new(PICTURES), most);
    interrupt::check()?;
    let found = Comparison::of(network, &views)?;
    stage.finish(&format!("{} pictures of {} solids", views.len(), solids.len()));
    Ok(found)
}

/// The meshes in a folder, in the order of their names.
fn meshes(folder: &Path) -> Result<Vec<Arc<Solid>>> {
    let fix = "give a folder with meshes to --objects";
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, "read the folder of meshes", &e).fix(fix))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.retain(|path| {
        path.extension().is_some_and(|e| ["obj", "glb", "gltf"].iter().any(|known| e.eq_ignore_ascii_case(known)))
    });
    paths.sort();
    if paths.is_empty() {
        return Err(Error::new(ErrorKind::Input, "there are no meshes")
            .at(folder.display())
            .wanted("files that end in .obj, .glb or .gltf")
            .fix(fix));
    }
    let solid =
        |path: &PathBuf| Solid::of_mesh(&TexturedMesh::read(path)?).map(Arc::new).map_err(|e| e.within(path.display()));
    paths.iter().map(solid).collect()
}

fn tables(sets: &[Set]) -> String {
    let with = |e: Estimate| format!("{:.3} ± {:.3}", e.mean, e.error);
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    let of_d = |found: Estimate, flat: Estimate| format!("{:.1} ({:.1})", 100.0 * found.mean, 100.0 * flat.mean);
    type Line<'a> = (&'a str, &'a dyn Fn(&Figures) -> String);
    let lines: &[Line<'_>] = &[
        ("pictures, solids", &|f| format!("{}, {}", f.pictures, f.solids)),
        ("IoU: as deep as wide", &|f| format!("{} (factor {:.1})", with(f.as_deep_as_wide), f.factor)),
        ("IoU: the same in the true middle plane", &|f| with(f.best_tilt)),
        ("**IoU: network**", &|f| format!("**{}**", with(f.network))),
        ("… more than as deep as wide", &|f| format!("{:+.3} ± {:.3}", f.gain.mean, f.gain.error)),
        ("… with the factors of middle and thickness of the validation split", &|f| {
            format!("{} ({:.1}, {:.1})", with(f.scaled), f.scales[0], f.scales[1])
        }),
        ("… from the silhouette alone", &|f| with(f.silhouette_alone)),
        ("… mirrored in depth", &|f| with(f.mirrored_in_depth)),
        ("front, rms, % of D (flat)", &|f| of_d(f.front_rms, f.front_rms_flat)),
        ("back, rms, % of D (flat)", &|f| of_d(f.back_rms, f.back_rms_flat)),
        ("true tilts above 20°", &|f| f.tilted.to_string()),
        ("… to the right side", &|f| format!("{} ± {}", percent(f.right_sign.mean), percent(f.right_sign.error))),
        ("… median error of the normal (of no tilt)", &|f| {
            format!("{:.0}° ({:.0}°)", f.normal_error_deg, f.tilt_deg)
        }),
        ("… said to be above 20°, of these to the right side", &|f| {
            format!("{}, {}", f.said_tilted, percent(f.right_sign_where_said))
        }),
        ("front errors within the stated 50 %, 90 %", &|f| {
            format!("{}, {}", percent(f.within_50), percent(f.within_90))
        }),
        ("Spearman of the stated error: with the front's, with IoU", &|f| {
            format!("{:.2}, {:.2}", f.ranks_error, f.ranks_overlap)
        }),
        ("IoU of the surer half, of the other (as deep as wide)", &|f| {
            let pair = |[found, flat]: [f64; 2]| format!("{found:.3} ({flat:.3})");
            format!("{}, {}", pair(f.surer_half), pair(f.other_half))
        }),
    ];
    let mut table = "| |".to_owned();
    sets.iter().for_each(|set| write!(table, " {} |", set.name).expect("text grows"));
    table += "\n| --- |";
    sets.iter().for_each(|_| table += " --- |");
    for (title, cell) in lines {
        write!(table, "\n| {title} |").expect("text grows");
        sets.iter().for_each(|set| write!(table, " {} |", cell(&set.figures)).expect("text grows"));
    }
    table + "\n\nErrors are standard errors over solids. D is the diameter of the disc of the silhouette's area.\n"
}
