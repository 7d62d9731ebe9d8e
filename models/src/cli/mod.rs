//! The command line.

mod bench;
mod check;
mod check_law;
mod film;
mod gradcheck;
mod ground;
mod imagine;
mod network;
mod output;
mod place;
mod published;
mod reconstruct;
mod resimulate;
mod seen;
mod simulate;
mod source;
mod synthesize;
mod train;
mod unit;
mod weights;

use clap::{Parser, Subcommand};
use gradreel::scalar::Path;
use gradreel::{ErrorKind, Result};

use self::output::tell;
use crate::physics::{Law, materials};

/// From a video of a collision to shape, motion and material.
#[derive(Parser)]
#[command(name = "gradreel", version, about, long_about = LONG_ABOUT, max_term_width = 120)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const LONG_ABOUT: &str = "\
gradreel reconstructs an object that falls and bounces in a video: its 3D shape, its motion, and the numbers of its material \
(Young's modulus [Pa], Poisson ratio, initial velocity [m/s]). One gradient tape runs from the pixels through volume \
rendering and a differentiable material point simulation to those numbers.

Try it on the film that comes with the sources, and on seven calibrated cameras that saw the same:

    gradreel reconstruct examples/clips/bird.gif
    gradreel reconstruct examples/clips/bird

and let things fall by themselves:

    gradreel simulate examples/scenes/rubber.toml

The environment variable GRADREEL_ISA (scalar, avx2, avx512 or neon) holds the kernels of the CPU to one instruction set; \
the reports name the one that was used.

Exit codes: 0 done, 1 the computation failed, 2 the input cannot be used, 130 stopped by Ctrl-C.";

#[derive(Subcommand)]
enum Command {
    /// Reconstruct shape, motion and material of the object in a clip
    Reconstruct(reconstruct::Arguments),
    /// Simulate a scene file: what falls onto what, in which materials
    Simulate(simulate::Arguments),
    /// Look at a clip: what is there, what is missing, what will be assumed
    Check(check::Arguments),
    /// Synthesize the views around an object from a single picture of it
    Synthesize(synthesize::Arguments),
    /// Check a law of your own in WGSL: derivatives, invariances, wave speed, GPU; plot its response, measure its speed
    CheckLaw(check_law::Arguments),
    /// Check derivatives of ops and materials against central differences, and print the tables
    Gradcheck(gradcheck::Arguments),
    /// Train a model that synthesizes views, or its spatial-aware module, on objects made here
    Train(train::Arguments),
    /// Measure what the parts of the method are worth
    Bench(bench::Arguments),
    /// Check and convert files of the multi-view model's weights
    Weights(weights::Arguments),
}

/// Runs the command line with laws of one's own beside the shipped ones, for `--material` and scenes: the `main` of a program
/// that brings laws in Rust. Returns the exit code.
///
/// ```no_run
/// use gradreel_models::physics::{Law, WgslLaw};
///
/// fn main() -> std::process::ExitCode {
///     let laws = WgslLaw::read("foam.wgsl").map(Law::of);
///     gradreel_models::cli::run_with(laws).into()
/// }
/// ```
pub fn run_with(laws: impl IntoIterator<Item = Law>) -> u8 {
    for law in laws {
        if let Err(error) = materials::register(law) {
            return exit_code(Err(error));
        }
    }
    main()
}

/// Runs the command line and returns the exit code.
pub fn main() -> u8 {
    let command = Cli::parse().command;
    // checked first: all kernels require it
    let outcome = Path::of_environment().and_then(|_| run(command));
    exit_code(outcome)
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Reconstruct(arguments) => reconstruct::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Check(arguments) => check::run(&arguments).and_then(|()| output::arrived()),
        Command::CheckLaw(arguments) => check_law::run(&arguments).and_then(|()| output::arrived()),
        Command::Gradcheck(arguments) => gradcheck::run(&arguments).and_then(|()| output::arrived()),
        Command::Synthesize(arguments) => synthesize::run(&arguments),
        Command::Train(arguments) => train::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Weights(arguments) => weights::run(&arguments).and_then(|()| output::arrived()),
    }
}

fn exit_code(outcome: Result<()>) -> u8 {
    let Err(error) = outcome else { return 0 };
    tell!("error: {error}");
    match error.kind() {
        ErrorKind::Input => 2,
        ErrorKind::Interrupted => 130,
        _ => 1,
    }
}
