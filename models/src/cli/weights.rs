//! `gradreel weights`: inspects and converts weights files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::io::{Archive, Format, Stored};
use gradreel::{Device, Error, ErrorKind, Result};

use crate::cli::output::{self, say};
use crate::runtime::progress::Progress;
use crate::views::FileWeights;

/// Arguments of `gradreel weights`.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub(super) struct Arguments {
    #[command(subcommand)]
    task: Task,
}

const EXAMPLES: &str = "\
Examples:
  gradreel weights check syncdreamer.ckpt                            does it hold the multi-view model, whole?
  gradreel weights convert syncdreamer.ckpt small.safetensors --f16  half the size, for the same model
  gradreel weights convert own.safetensors on.safetensors --without-input
                                                                     to train on as a model that sees its input in the UNet alone

Files are safetensors or what PyTorch's torch.save writes. Nothing in a file is ever executed. While a command uses a file,
leave it alone: one above 1 GiB is not copied into memory.";

#[derive(clap::Subcommand)]
enum Task {
    /// Compare a file with what the multi-view model reads: what is missing, unknown or of another shape
    Check(Check),
    /// Write the weights of a file as safetensors, in the same or another type of floats
    Convert(Convert),
}

#[derive(clap::Args)]
struct Check {
    /// A safetensors file or a PyTorch checkpoint
    file: PathBuf,
    /// List every tensor with its type and shape
    #[arg(long)]
    list: bool,
    /// Read every number, too, and name the tensors with NaN or infinity
    #[arg(long)]
    numbers: bool,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

#[derive(clap::Args)]
struct Convert {
    /// A safetensors file or a PyTorch checkpoint
    from: PathBuf,
    /// The safetensors file to write
    to: PathBuf,
    #[command(flatten)]
    floats: Floats,
    /// Leave out what un-projects the input image, of a small model that was trained with it; in 32 bits
    #[arg(long, conflicts_with_all = ["f16", "bf16"])]
    without_input: bool,
    /// Replace a file that is there
    #[arg(long)]
    force: bool,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

#[derive(clap::Args)]
#[group(multiple = false)]
struct Floats {
    /// All floats in 16 bits; numbers beyond ±65504 are refused
    #[arg(long)]
    f16: bool,
    /// All floats in 32 bits
    #[arg(long)]
    f32: bool,
    /// All floats in 16 bits with the range of 32: three digits only
    #[arg(long)]
    bf16: bool,
}

impl Floats {
    /// The type that all floats are converted to, if any.
    fn wanted(&self) -> Option<Stored> {
        let all = [(self.f16, Stored::F16), (self.f32, Stored::F32), (self.bf16, Stored::Bf16)];
        all.into_iter().find_map(|(given, stored)| given.then_some(stored))
    }
}

/// Runs the subcommand.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.task {
        Task::Check(arguments) => check(arguments),
        Task::Convert(arguments) => convert(arguments),
    }
}

fn check(arguments: &Check) -> Result<()> {
    let weights = FileWeights::open(&arguments.file, &Device::Cpu)?;
    let archive = weights.archive();
    describe(&arguments.file, archive);
    if arguments.list {
        for name in archive.names() {
            match archive.entry(name) {
                Ok(entry) => say!("    {name} {} {}", entry.stored, entry.shape),
                Err(error) => say!("    {name}: {error}"),
            }
        }
    }
    let report = weights.check(&weights.sizes()?.weights()?);
    output::print(format_args!("{report}"));
    let mut problems: Vec<String> = [
        (report.missing.len(), "missing"),
        (report.misshaped.len(), "of another shape"),
        (report.unreadable.len(), "that cannot be read"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{count} {what}"))
    .collect();
    if arguments.numbers {
        let broken = not_finite(archive, &Progress::new(arguments.quiet))?;
        if broken.is_empty() {
            say!("all numbers are finite");
        } else {
            say!("{} with NaN or infinity:", broken.len());
            broken.iter().for_each(|name| say!("    {name}"));
            problems.push(format!("{} with NaN or infinity", broken.len()));
        }
    }
    if problems.is_empty() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the file does not hold the weights of the multi-view model")
        .at(arguments.file.display())
        .found(format!("{}; they are listed above", problems.join(", ")))
        .wanted(format!("the {} weights of the model", report.wanted))
        .fix("choose the checkpoint of the multi-view model, or get it again if it is damaged"))
}

/// Names of tensors with NaN or infinity, reading one tensor at a time.
fn not_finite(archive: &Archive, progress: &Progress) -> Result<Vec<String>> {
    let (mut done, total) = (0, readable(archive).map(|(_, bytes)| bytes).sum());
    let stage = progress.stage("reading", total);
    let mut broken = Vec::new();
    for (name, bytes) in readable(archive) {
        if !archive.load(name)?.all_finite()? {
            broken.push(name.to_owned());
        }
        done += bytes;
        stage.set(done, &format!("{} of {}", readable_size(done), readable_size(total)));
    }
    stage.finish(&readable_size(total));
    Ok(broken)
}

/// Names of readable tensors, and their sizes in the file.
fn readable(archive: &Archive) -> impl Iterator<Item = (&str, u64)> {
    let size = |name| archive.entry(name).ok().map(|entry| (entry.shape.len() * entry.stored.size()) as u64);
    archive.names().filter_map(move |name| Some((name, size(name)?)))
}

/// Prints a summary of a file.
fn describe(path: &Path, archive: &Archive) {
    let format = match archive.format() {
        Format::Safetensors => "safetensors",
        Format::TorchZip => "a PyTorch checkpoint",
        Format::TorchLegacy => "a PyTorch checkpoint of the old form",
        _ => "an archive of arrays",
    };
    let mut types: BTreeMap<String, u64> = BTreeMap::new();
    for name in archive.names() {
        if let Ok(entry) = archive.entry(name) {
            *types.entry(entry.stored.to_string()).or_default() += 1;
        }
    }
    let types: Vec<String> = types.iter().map(|(stored, count)| format!("{count} {stored}")).collect();
    let bytes = readable(archive).map(|(_, bytes)| bytes).sum();
    let count = archive.names().count();
    say!("{}: {format}, {count} tensors ({}), {}", path.display(), types.join(", "), readable_size(bytes));
}

fn convert(arguments: &Convert) -> Result<()> {
    let Convert { from, to, .. } = arguments;
    if to.extension().is_none_or(|extension| extension != "safetensors") {
        return Err(Error::new(ErrorKind::Input, "weights are written as safetensors")
            .at(to.display())
            .wanted("a name that ends in .safetensors")
            .fix(format!("write {}", to.with_extension("safetensors").display())));
    }
    if to.exists() && !arguments.force {
        return Err(Error::new(ErrorKind::Input, "a file is in the way")
            .at(to.display())
            .fix("choose another name, or replace it with --force"));
    }
    let archive = Archive::open(from)?;
    if archive.names().next().is_none() {
        return Err(Error::new(ErrorKind::Input, "the file holds no tensors")
            .at(from.display())
            .fix("choose a file of weights"));
    }
    for name in archive.names() {
        archive.entry(name).map_err(|e| {
            e.within(from.display())
                .fix("choose another file; `gradreel weights check --list` shows what this one holds")
        })?;
    }
    describe(from, &archive);
    if arguments.without_input {
        FileWeights::open(from, &Device::Cpu)?.without_input()?.write(to)?;
        describe(to, &Archive::open(to)?);
        return Ok(());
    }
    let floats = arguments.floats.wanted();
    let stage = Progress::new(arguments.quiet).stage("writing", 1000);
    let told = |done: usize, total: usize| {
        let share = done as u64 * 1000 / total.max(1) as u64;
        stage.set(share, &format!("{} of {}", readable_size(done as u64), readable_size(total as u64)));
    };
    archive
        .rewrite(to, |_, entry| floats.filter(|_| entry.stored.is_float()).unwrap_or(entry.stored), told)
        .map_err(|e| e.within(from.display()))?;
    stage.finish("");
    describe(to, &Archive::open(to)?);
    Ok(())
}

/// `5.57 GB`, `12 kB`
fn readable_size(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        1e9.. => format!("{:.2} GB", bytes * 1e-9),
        1e6.. => format!("{:.1} MB", bytes * 1e-6),
        1e3.. => format!("{:.1} kB", bytes * 1e-3),
        _ => format!("{bytes} bytes"),
    }
}
