//! Fuzzing of the file readers, on a stable toolchain and for a bounded time.
//!
//! Each target mutates a corpus by a seeded generator and reads what comes out. A panic, or an allocation beyond a multiple of
//! the file, fails the test and leaves the file in `target/tmp/`. `GRADREEL_FUZZ_SECONDS` is the time of each target (2
//! without it); `GRADREEL_FUZZ_SEED` begins elsewhere.
//!
//! ```text
//! GRADREEL_FUZZ_SECONDS=600 GRADREEL_FUZZ_SEED=7 cargo test --release --test fuzz
//! ```

mod allocation;
#[path = "../files/build.rs"]
#[allow(dead_code)]
mod build;
mod mutate;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use gradreel::io::{Archive, npy};

use mutate::Mutator;

/// One at a time: what is allocated is counted for the whole process.
static TURN: Mutex<()> = Mutex::new(());

fn corpus(names: &[&str]) -> Vec<Vec<u8>> {
    names.iter().map(|name| std::fs::read(format!("tests/vectors/{name}")).unwrap()).collect()
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Reads a file in every way; what is read must be what the file listed.
fn read(bytes: &[u8]) {
    drop(npy::from_bytes(bytes));
    let Ok(archive) = Archive::from_bytes(bytes.to_vec()) else { return };
    for name in archive.names() {
        if let Ok(x) = archive.load(name) {
            assert_eq!(x.shape(), &archive.entry(name).unwrap().shape, "{name}");
        }
    }
    drop(archive.load_all());
}

fn fuzz(target: &str, corpus: &[Vec<u8>], tokens: &[&[u8]], wrap: impl Fn(Vec<u8>) -> Vec<u8>) {
    let _turn = TURN.lock().unwrap_or_else(|failed| failed.into_inner());
    let end = Instant::now() + Duration::from_secs(setting("GRADREEL_FUZZ_SECONDS", 2));
    let seed = setting("GRADREEL_FUZZ_SEED", 1);
    let (mut runs, mut accepted) = (0u64, 0u64);
    while Instant::now() < end || runs < 500 {
        let file = wrap(Mutator::new(seed, runs).mutate(corpus, tokens));
        let before = allocation::start();
        let outcome = catch_unwind(AssertUnwindSafe(|| read(&file)));
        let most = allocation::most_since(before);
        let fault = match outcome {
            Err(_) => Some("a panic".to_owned()),
            Ok(()) if most > 512 * file.len() + (4 << 20) => Some(format!("{most} bytes allocated")),
            Ok(()) => None,
        };
        if let Some(fault) = fault {
            let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
            let path = folder.join(format!("{target}-{seed}-{runs}"));
            std::fs::write(&path, &file).unwrap();
            panic!("{fault} for a file of {} bytes, kept as {}", file.len(), path.display());
        }
        runs += 1;
        accepted += u64::from(Archive::from_bytes(file).is_ok());
    }
    println!("{target}: {runs} files, {accepted} of them accepted");
    // a mutator that breaks everything at the door, or nothing at all, tests nothing
    assert!(accepted > 0 && accepted < runs);
}

#[test]
fn safetensors_and_npy() {
    let corpus = corpus(&["tiny_checkpoint_expected.safetensors", "kinds.npz", "fortran_f4.npy", "big_endian_f8.npy"]);
    let tokens: [&[u8]; 8] =
        [b"\"dtype\":\"F64\"", b"\"shape\":[0]", b"[18446744073709551615]", b"'|O'", b"(2,)", b"True", b"{", b"-1"];
    fuzz("safetensors-npy", &corpus, &tokens, |bytes| bytes);
}

#[test]
fn checkpoints() {
    let corpus = corpus(&["tiny_lightning.ckpt", "tiny_legacy_format.ckpt", "tiny_forbidden_call.ckpt", "nested.pt"]);
    fuzz("checkpoints", &corpus, &mutate::OPCODES, |bytes| bytes);
}

/// Pickles alone, so that no mutation is spent on the container.
#[test]
fn pickles() {
    let pickles = ["tiny_lightning.ckpt", "tiny_forbidden_call.ckpt", "nested.pt"].map(|name| {
        let file = std::fs::read(format!("tests/vectors/{name}")).unwrap();
        let start = file.windows(2).position(|w| w == b"\x80\x02").unwrap();
        let end = file.windows(4).position(|w| w == b"PK\x07\x08").unwrap();
        file[start..end].to_vec()
    });
    let storages: Vec<(String, Vec<u8>)> = (0..12).map(|i| (format!("top/data/{i}"), vec![i; 120])).collect();
    fuzz("pickles", &pickles, &mutate::OPCODES, |pickle| {
        let mut entries: Vec<(&str, &[u8])> = vec![("top/data.pkl", &pickle)];
        entries.extend(storages.iter().map(|(name, data)| (&**name, &data[..])));
        build::zip(&entries)
    });
}
