//! The core's kernels against the machine's limits and, where `target/pytorch-N.json` lies beside them, against PyTorch.
//!
//! `cargo bench --bench core -- [threads] [filter] [--markdown FILE]`; `benches/compare.sh` runs the peer first. With a file, the table
//! replaces the section `core-THREADS` of it.

mod attention;
mod convolution;
mod harness;
mod matmul;
mod mlp;
mod normalisation;
mod optimiser;
mod pointwise;
mod sampling;
mod tape;

use std::path::PathBuf;

use gradreel_models::report::results_file::{Measured, Section, replace};

/// One group of cases for each module.
const GROUPS: &[fn() -> Vec<harness::Case>] = &[
    attention::cases,
    convolution::cases,
    matmul::cases,
    mlp::cases,
    normalisation::cases,
    optimiser::cases,
    pointwise::cases,
    sampling::cases,
    tape::cases,
];

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let file = arguments.iter().position(|a| a == "--markdown").map(|at| {
        arguments.remove(at);
        if at == arguments.len() {
            eprintln!("error: --markdown needs a file");
            std::process::exit(2);
        }
        PathBuf::from(arguments.remove(at))
    });
    arguments.retain(|a| !a.starts_with("--"));
    let threads = arguments.first().and_then(|a| a.parse().ok()).unwrap_or(1);
    let filter = arguments.iter().find(|a| a.parse::<usize>().is_err()).cloned().unwrap_or_default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    let body = pool.install(|| harness::run(threads, &filter, GROUPS));
    let Some(file) = file else { return };
    let section = Section {
        name: format!("core-{threads}"),
        title: format!("Kernels of the core, {threads} threads"),
        split: "none: fixed numbers".to_owned(),
        body,
    };
    if let Err(error) = replace(&file, &section, &Measured::here("cargo bench --bench core --")) {
        eprintln!("error: {error}");
        std::process::exit(2);
    }
}
