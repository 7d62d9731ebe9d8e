//! The core's kernels against the machine's limits and, where `target/pytorch-N.json` lies beside them, against PyTorch.
//!
//! `cargo bench --bench core -- [threads] [filter]`; `benches/compare.sh` runs the peer first.

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
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let threads = arguments.first().and_then(|a| a.parse().ok()).unwrap_or(1);
    let filter = arguments.iter().find(|a| a.parse::<usize>().is_err()).cloned().unwrap_or_default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| harness::run(threads, &filter, GROUPS));
}
