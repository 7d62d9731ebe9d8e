//! Ctrl-C and a full disk, tried on a process of their own: this test program again, running one part.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use gradreel::ErrorKind;
use gradreel_models::runtime::interrupt;
use gradreel_models::runtime::run_folder::RunFolder;
use tempfile::TempDir;

use crate::run_folder::names;

/// Tells the process started by a test which folder to write to, or that it is to wait for signals.
const PART: &str = "GRADREEL_TEST_PART";

/// Longest wait for a process that hangs; a process that works is far quicker.
const PATIENCE: usize = 6000;

fn this_program() -> String {
    std::env::current_exe().unwrap().into_os_string().into_string().unwrap()
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

fn exit_code(child: &mut Child) -> Option<i32> {
    for _ in 0..PATIENCE {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        sleep(Duration::from_millis(10));
    }
    child.kill().unwrap();
    panic!("the process did not end");
}

/// What the process of the two tests below does: waits for a signal, then stops as it should or works on for ever.
#[test]
fn part_waits() {
    let Ok(part) = std::env::var(PART) else { return };
    interrupt::install().unwrap();
    interrupt::install().expect("installing twice is installing once");
    assert!(!interrupt::requested());
    interrupt::check().unwrap();
    eprintln!("ready");
    for _ in 0..PATIENCE {
        if let Err(error) = interrupt::check() {
            assert!(interrupt::requested());
            assert_eq!(error.kind(), ErrorKind::Interrupted);
            if part == "stop" {
                std::process::exit(7);
            }
        }
        sleep(Duration::from_millis(10));
    }
}

fn waiting(part: &str) -> (Child, impl FnMut(&str)) {
    let mut child = Command::new(this_program())
        .args(["--exact", "signals::part_waits", "--nocapture"])
        .env(PART, part)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut says = move |wanted: &str| {
        assert!(lines.any(|line| line.unwrap().contains(wanted)), "the process never said `{wanted}`");
    };
    says("ready");
    (child, says)
}

#[test]
fn the_first_signal_asks_to_stop() {
    for name in ["-INT", "-TERM"] {
        let (mut child, mut says) = waiting("stop");
        signal(&child, name);
        says("saving");
        assert_eq!(exit_code(&mut child), Some(7), "{name}: the loop ends by itself");
    }
}

#[test]
fn the_second_signal_stops_at_once() {
    let (mut child, mut says) = waiting("go on");
    signal(&child, "-INT");
    says("saving");
    assert_eq!(child.try_wait().unwrap(), None, "one signal does not end it");
    signal(&child, "-INT");
    assert_eq!(exit_code(&mut child), Some(130));
}

/// What the process of the test below does: writes more than it may.
#[test]
fn part_writes() {
    let Ok(folder) = std::env::var(PART) else { return };
    let run = RunFolder::open(folder.as_ref()).unwrap();
    let error = run.write("big", &vec![b'n'; 1 << 20]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Io);
    std::process::exit(7);
}

#[test]
fn a_write_that_breaks_off_half_way_keeps_the_old_file() {
    let scratch = TempDir::new().unwrap();
    let run = RunFolder::create(scratch.path()).unwrap();
    run.write("big", &vec![b'o'; 3000]).unwrap();
    // A limit of a few kilobytes per file stands for a full disk: the first bytes are taken, the rest refused.
    let script = r#"trap '' XFSZ; ulimit -f 8; exec "$0" --exact signals::part_writes --nocapture"#;
    let mut child = Command::new("sh")
        .args(["-c", script, &this_program()])
        .env(PART, scratch.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    assert_eq!(exit_code(&mut child), Some(7), "the write fails with an error");
    assert_eq!(fs::read(scratch.path().join("big")).unwrap(), vec![b'o'; 3000]);
    assert_eq!(names(scratch.path()), ["big"]);
}
