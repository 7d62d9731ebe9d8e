//! One target: mutations of valid files, read within bounds.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::allocation;
use crate::mutate::Mutator;

/// The most that a file may take \[bytes\].
pub const MOST_BYTES: usize = 256 << 20;
/// The longest that a file may take; without optimisation nothing is as fast as it will be.
pub const LONGEST: Duration = Duration::from_secs(if cfg!(debug_assertions) { 10 } else { 1 });

/// One at a time: what is allocated is counted for the whole process. Within, the targets and mutations so far.
static TURN: Mutex<(u64, u64)> = Mutex::new((0, 0));

fn setting(name: &str) -> Option<u64> {
    let text = std::env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name} = {text:?} is no number")))
}

/// What a read must not do, if it did; else whether the file was accepted.
pub fn watched(read: impl Fn() -> bool) -> Result<bool, String> {
    let once = || {
        let (before, start) = (allocation::start(), Instant::now());
        let outcome = catch_unwind(AssertUnwindSafe(&read));
        (outcome, start.elapsed(), allocation::most_since(before))
    };
    let (outcome, mut took, most) = once();
    // the machine may have been busy with something else
    for _ in 0..2 {
        if outcome.is_ok() && took > LONGEST {
            took = took.min(once().1);
        }
    }
    match outcome {
        Err(panic) => Err(format!("a panic: {}", words(&*panic))),
        Ok(_) if most > MOST_BYTES => Err(format!("{} MiB allocated", most >> 20)),
        Ok(_) if took > LONGEST => Err(format!("{:.1} s", took.as_secs_f64())),
        Ok(accepted) => Ok(accepted),
    }
}

fn words(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or(panic.downcast_ref::<&str>().copied()).unwrap_or("without a word")
}

/// Reads mutations of the seeds, most of which are files that `read` accepts.
pub fn fuzz(target: &str, seeds: &[Vec<u8>], tokens: &[&[u8]], read: impl Fn(&[u8]) -> bool) {
    let mut turn = TURN.lock().unwrap_or_else(|failed| failed.into_inner());
    let good =
        |(i, seed): (usize, &Vec<u8>)| watched(|| read(seed)).unwrap_or_else(|e| panic!("{target}: seed {i}: {e}"));
    let good = seeds.iter().enumerate().map(good).filter(|accepted| *accepted).count();
    assert!(2 * good >= seeds.len(), "{target}: {good} of {} seeds are accepted", seeds.len());
    let start = Instant::now();
    let end = start + Duration::from_secs(setting("GRADREEL_FUZZ_SECONDS").unwrap_or(2));
    let mutations = setting("GRADREEL_FUZZ_MUTATIONS");
    let seed = setting("GRADREEL_FUZZ_SEED").unwrap_or(1);
    let (mut runs, mut accepted) = (0u64, 0u64);
    while mutations.map_or_else(|| runs < 50 || Instant::now() < end, |mutations| runs < mutations) {
        let file = Mutator::new(seed, runs).mutate(seeds, tokens);
        match watched(|| read(&file)) {
            Ok(was_accepted) => accepted += u64::from(was_accepted),
            Err(fault) => {
                let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{target}-{seed}-{runs}"));
                std::fs::write(&path, &file).unwrap();
                panic!("{target}: {fault} for a file of {} bytes, kept as {}", file.len(), path.display());
            }
        }
        runs += 1;
    }
    turn.0 += 1;
    turn.1 += runs;
    println!(
        "{target}: {runs} files, {accepted} of them accepted, in {:.1} s; total: {} files of {} targets",
        start.elapsed().as_secs_f64(),
        turn.1,
        turn.0
    );
    // a mutator that breaks everything at the door, or nothing at all, tests nothing
    assert!(runs < 200 || (accepted > 0 && accepted < runs), "{target}: {accepted} of {runs} accepted");
}
