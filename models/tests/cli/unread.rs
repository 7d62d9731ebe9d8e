//! Runs whose output nobody reads any more, or that goes to a full disk.

use std::process::Stdio;

use crate::scene::Scene;

/// An end of a pipe whose other end is closed.
fn gone() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[cfg(target_os = "linux")]
fn full() -> Stdio {
    std::fs::File::options().write(true).open("/dev/full").unwrap().into()
}

#[test]
fn a_run_goes_on_when_nobody_reads_what_it_says() {
    let scene = Scene::with_clip(&[0, 3], 3);
    let mut run = scene.command("reconstruct clip --out one --config quick.toml");
    let status = run.stdout(gone()).stderr(gone()).status().unwrap();
    assert_eq!(status.code(), Some(0));
    let mut run = scene.command("reconstruct clip --out two --config quick.toml");
    assert_eq!(run.stderr(Stdio::null()).stdout(gone()).status().unwrap().code(), Some(0));
    for folder in ["one", "two"] {
        assert!(scene.path(folder).join("index.html").is_file(), "{folder}");
    }
    // refusals keep their code
    let mut refused = scene.command("reconstruct nowhere --out three");
    assert_eq!(refused.stderr(gone()).status().unwrap().code(), Some(2));
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_goes_on_when_what_it_says_fills_a_disk() {
    let scene = Scene::with_clip(&[0, 3], 3);
    let mut run = scene.command("reconstruct clip --out out --config quick.toml");
    assert_eq!(run.stdout(full()).stderr(full()).status().unwrap().code(), Some(0));
    assert!(scene.path("out/index.html").is_file());
    // what is printed and nowhere else is said to be lost
    let output = scene.command("check clip").stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("cannot print the result"), "{message}");
    let mut check = scene.command("check clip");
    assert_eq!(check.stdout(gone()).status().unwrap().code(), Some(0));
}
