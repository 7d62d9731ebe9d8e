//! Timing, the machine's limits, and the table.

use std::hint::black_box;
use std::time::Instant;

#[cfg(target_arch = "x86_64")]
use gradreel::scalar::Path;
use gradreel::{DType, Shape, Tensor, ops};

/// One thing to time.
pub struct Case {
    /// The name that the peer's script uses as well.
    pub name: &'static str,
    /// Arithmetic of the forward pass.
    pub flop: f64,
    /// Bytes that the forward pass must move at least once.
    pub bytes: f64,
    /// Runs it: forward, or forward and backward.
    pub run: Box<dyn Fn(bool) + Send + Sync>,
}

/// Fixed numbers in -1..1, in `f32`.
pub fn numbers(seed: u64, shape: impl Into<Shape>) -> Tensor {
    ops::uniform(seed, shape, -1.0..1.0).cast(DType::F32).expect("a tensor of the CPU")
}

/// The least wall time of some runs in seconds.
pub fn seconds(run: impl Fn()) -> f64 {
    run();
    let (begin, mut best, mut runs) = (Instant::now(), f64::INFINITY, 0);
    while runs < 4 || (begin.elapsed().as_secs_f64() < 1.0 && runs < 200) {
        let start = Instant::now();
        run();
        best = best.min(start.elapsed().as_secs_f64());
        runs += 1;
    }
    best
}

/// Times every case that matches and prints one row each; returns the table as Markdown.
pub fn run(threads: usize, filter: &str, groups: &[fn() -> Vec<Case>]) -> String {
    let (flops, bytes) = (peak_flops(threads), copy_bandwidth(threads));
    println!(
        "{} on {threads} threads: multiply-add {:.0} GFLOP/s, copy {:.1} GB/s",
        gradreel::isa(),
        flops * 1e-9,
        bytes * 1e-9
    );
    let peer = peer(threads);
    println!(
        "{:44} {:>10} {:>8} {:>9} {:>10} {:>9}",
        "case", "forward ms", "of limit", "/ PyTorch", "both ms", "/ PyTorch"
    );
    let mut table = format!(
        "{threads} threads: multiply-add {:.0} GFLOP/s, copy {:.1} GB/s. Times in f32, of the forward pass and with the backward \
         pass; as a share of what arithmetic or memory allows, and as a multiple of PyTorch's on this machine where it was \
         measured.\n\n| case | forward [ms] | of limit | / PyTorch | both [ms] | / PyTorch |\n\
         | --- | ---: | ---: | ---: | ---: | ---: |\n",
        flops * 1e-9,
        bytes * 1e-9
    );
    for case in groups.iter().flat_map(|cases| cases()).filter(|case| case.name.contains(filter)) {
        let forward = seconds(|| (case.run)(false));
        let both = seconds(|| (case.run)(true));
        let limit = (case.flop / flops).max(case.bytes / bytes);
        let ratio = |which: &str, mine: f64| match peer[case.name][which].as_f64() {
            Some(theirs) => format!("{:.2}", mine * 1e3 / theirs),
            None => "-".to_owned(),
        };
        let (share, vs, vs_both) = (limit / forward * 100.0, ratio("forward", forward), ratio("both", both));
        println!("{:44} {:10.3} {share:7.0}% {vs:>9} {:10.3} {vs_both:>9}", case.name, forward * 1e3, both * 1e3);
        table += &format!(
            "| {} | {:.3} | {share:.0} % | {vs} | {:.3} | {vs_both} |\n",
            case.name,
            forward * 1e3,
            both * 1e3
        );
    }
    table
}

/// The peer's milliseconds, as `benches/pytorch.py` wrote them.
fn peer(threads: usize) -> serde_json::Value {
    std::fs::read(format!("{}/target/pytorch-{threads}.json", env!("CARGO_MANIFEST_DIR")))
        .ok()
        .and_then(|text| serde_json::from_slice(&text).ok())
        .unwrap_or_default()
}

/// Runs a piece of work on each thread of the pool at once; the seconds until all are done.
fn on_all(threads: usize, work: impl Fn() + Sync) -> f64 {
    seconds(|| {
        rayon::scope(|scope| (0..threads).for_each(|_| scope.spawn(|_| work())));
    })
}

/// Multiply-adds in registers, two operations each, on all threads.
fn peak_flops(threads: usize) -> f64 {
    const ROUNDS: usize = 2_000_000;
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        #[target_feature(enable = "avx512f")]
        fn wide(rounds: usize) {
            let (m, b) = (_mm512_set1_ps(0.999_999), _mm512_set1_ps(1e-7));
            let mut sums = [_mm512_set1_ps(1.0); 14];
            for _ in 0..rounds {
                for sum in &mut sums {
                    *sum = _mm512_fmadd_ps(*sum, m, b);
                }
            }
            black_box(sums);
        }
        #[target_feature(enable = "avx2,fma")]
        fn middle(rounds: usize) {
            let (m, b) = (_mm256_set1_ps(0.999_999), _mm256_set1_ps(1e-7));
            let mut sums = [_mm256_set1_ps(1.0); 12];
            for _ in 0..rounds {
                for sum in &mut sums {
                    *sum = _mm256_fmadd_ps(*sum, m, b);
                }
            }
            black_box(sums);
        }
        if Path::best() == Path::Avx512 {
            // SAFETY: the processor has the path of the run.
            let time = on_all(threads, || unsafe { wide(black_box(ROUNDS)) });
            return (threads * ROUNDS * 14 * 16 * 2) as f64 / time;
        }
        if Path::best() == Path::Avx2 {
            // SAFETY: as above.
            let time = on_all(threads, || unsafe { middle(black_box(ROUNDS)) });
            return (threads * ROUNDS * 12 * 8 * 2) as f64 / time;
        }
    }
    let time = on_all(threads, || {
        let mut sums = [1.0f32; 32];
        for _ in 0..black_box(ROUNDS) {
            sums.iter_mut().for_each(|sum| *sum = *sum * 0.999_999 + 1e-7);
        }
        black_box(sums);
    });
    (threads * ROUNDS * 32 * 2) as f64 / time
}

/// Bytes read and written per second by a copy of 256 MiB.
fn copy_bandwidth(threads: usize) -> f64 {
    let from = vec![1.0f32; 64 << 20];
    let to = std::sync::Mutex::new(vec![0.0f32; 64 << 20]);
    let part = from.len().div_ceil(threads);
    let time = seconds(|| {
        let mut to = to.lock().expect("one user");
        let to: &mut [f32] = &mut to;
        rayon::scope(|scope| {
            for (to, from) in to.chunks_mut(part).zip(from.chunks(part)) {
                scope.spawn(move |_| to.copy_from_slice(from));
            }
        });
    });
    (8 * from.len()) as f64 / time
}
