//! A run never writes over anything, and never leaves half a file.

use std::fs;
use std::path::Path;

use gradreel::ErrorKind;
use gradreel_models::runtime::run_folder::{RunFolder, next_free};
use tempfile::TempDir;

/// What a run has written into a folder, beside the mark that it is at work.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| name != ".lock");
    names.sort();
    names
}

#[test]
fn a_folder_with_something_in_it_is_refused_and_left_alone() {
    let scratch = TempDir::new().unwrap();
    let path = scratch.path().join("bird");
    fs::create_dir(&path).unwrap();
    fs::write(path.join("notes.txt"), "mine").unwrap();

    let error = RunFolder::create(&path).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Input);
    let text = error.to_string();
    for part in [path.to_str().unwrap(), "--resume", "--out"] {
        assert!(text.contains(part), "{part} is missing in: {text}");
    }
    assert_eq!(names(&path), ["notes.txt"]);
    assert_eq!(fs::read(path.join("notes.txt")).unwrap(), b"mine");
}

#[test]
fn a_hidden_file_also_makes_a_folder_not_empty() {
    let scratch = TempDir::new().unwrap();
    fs::write(scratch.path().join(".keep"), "").unwrap();
    assert!(RunFolder::create(scratch.path()).is_err());
}

#[test]
fn new_and_empty_folders_are_taken_and_files_are_not() {
    let scratch = TempDir::new().unwrap();
    assert_eq!(RunFolder::create(&scratch.path().join("a/b/c")).unwrap().root(), scratch.path().join("a/b/c"));
    RunFolder::create(&scratch.path().join("a/b/c")).expect("an empty folder is as good as a new one");

    let file = scratch.path().join("file");
    fs::write(&file, "mine").unwrap();
    for error in [
        RunFolder::create(&file).unwrap_err(),
        RunFolder::create(&file.join("below")).unwrap_err(),
        RunFolder::open(&file).unwrap_err(),
        RunFolder::open(&scratch.path().join("missing")).unwrap_err(),
    ] {
        assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    }
    assert_eq!(fs::read(&file).unwrap(), b"mine");
    assert!(!scratch.path().join("missing").exists());
}

#[test]
fn files_are_written_read_and_replaced() {
    let scratch = TempDir::new().unwrap();
    let run = RunFolder::create(scratch.path()).unwrap();
    assert!(!run.has("frames/000.ply"));
    run.write("frames/000.ply", b"old and long").unwrap();
    run.write("frames/000.ply", b"new").unwrap();
    assert!(run.has("frames/000.ply"));
    assert!(!run.has("frames"), "a folder is not a file of the run");
    let again = RunFolder::open(scratch.path()).unwrap();
    assert_eq!(again.read("frames/000.ply").unwrap(), b"new");
    assert_eq!(names(&run.path("frames")), ["000.ply"], "nothing is left beside it");
    assert_eq!(run.read("absent").unwrap_err().kind(), ErrorKind::Input);
}

#[test]
fn a_write_that_fails_changes_nothing() {
    let scratch = TempDir::new().unwrap();
    let run = RunFolder::create(scratch.path()).unwrap();
    run.write("page/index.html", b"old").unwrap();

    let error = run.write("page", b"a file where a folder is").unwrap_err();
    assert!(error.to_string().contains(run.path("page").to_str().unwrap()), "{error}");
    run.write("page/index.html/below", b"a folder where a file is").unwrap_err();

    assert_eq!(run.read("page/index.html").unwrap(), b"old");
    assert_eq!(names(scratch.path()), ["page"]);
    assert_eq!(names(&run.path("page")), ["index.html"]);
}

#[test]
fn names_that_lead_out_of_the_folder_are_refused() {
    let scratch = TempDir::new().unwrap();
    let run = RunFolder::create(&scratch.path().join("run")).unwrap();
    let absolute = scratch.path().join("out").into_os_string().into_string().unwrap();
    for name in ["../out", "frames/../../out", &absolute, ""] {
        assert_eq!(run.write(name, b"x").unwrap_err().kind(), ErrorKind::Input, "{name}");
        assert_eq!(run.read(name).unwrap_err().kind(), ErrorKind::Input, "{name}");
    }
    assert_eq!(names(scratch.path()), ["run"]);
}

#[test]
fn the_next_free_name_is_numbered() {
    let scratch = TempDir::new().unwrap();
    let base = scratch.path().join("runs");
    assert_eq!(next_free(&base, "bird"), base.join("bird"));
    assert!(!base.exists(), "asking makes nothing");
    fs::create_dir_all(base.join("bird")).unwrap();
    assert_eq!(next_free(&base, "bird"), base.join("bird-2"));
    fs::write(base.join("bird-2"), "a file takes a name too").unwrap();
    fs::create_dir(base.join("bird-4")).unwrap();
    assert_eq!(next_free(&base, "bird"), base.join("bird-3"));
}

#[test]
fn names_of_clips_become_names_of_folders() {
    let base = Path::new("runs");
    for (name, wanted) in [
        ("a b\t/c", "a-b-c"),
        ("../../etc/passwd", "etc-passwd"),
        ("Pferd_größe.v2", "Pferd_größe.v2"),
        ("..", "run"),
        ("", "run"),
        ("-x-", "x"),
        (&"long".repeat(100), &"long".repeat(15)),
    ] {
        assert_eq!(next_free(base, name), base.join(wanted), "{name:?}");
    }
}

#[test]
fn a_folder_at_work_is_refused_before_anything_in_it_is_touched() {
    let scratch = TempDir::new().unwrap();
    let path = scratch.path().join("run");
    let first = RunFolder::create(&path).unwrap();
    fs::write(path.join(".state.json.7-0.partial"), "half").unwrap();
    for error in [RunFolder::create(&path).unwrap_err(), RunFolder::can_be_created(&path).unwrap_err()] {
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains("another process is at work"), "{error}");
    }
    assert_eq!(names(&path), [".state.json.7-0.partial"]);
    // once nobody is at work there, what is left of a write is no reason to refuse, and goes
    drop(first);
    // a process that another test starts has the lock until it runs its own program
    let free = (0..200).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        RunFolder::can_be_created(&path).is_ok()
    });
    assert!(free);
    assert_eq!(names(&path), [".state.json.7-0.partial"], "asking removes nothing");
    let _second = RunFolder::create(&path).unwrap();
    assert!(names(&path).is_empty());
}

#[test]
fn whether_a_folder_can_be_made_is_told_without_making_it() {
    let scratch = TempDir::new().unwrap();
    let path = scratch.path().join("a/b");
    RunFolder::can_be_created(&path).unwrap();
    assert!(names(scratch.path()).is_empty());
    fs::write(scratch.path().join("file"), "mine").unwrap();
    for path in [scratch.path().join("file"), scratch.path().join("file/below"), scratch.path().join("x".repeat(400))] {
        assert_eq!(RunFolder::can_be_created(&path).unwrap_err().kind(), ErrorKind::Input, "{}", path.display());
    }
    assert_eq!(RunFolder::create(&scratch.path().join("x".repeat(400))).unwrap_err().kind(), ErrorKind::Input);
    assert_eq!(names(scratch.path()), ["file"]);
}
