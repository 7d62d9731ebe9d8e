//! The file of measured results: each section is replaced where it stands, and nothing else is touched.

use std::fs;

use crate::report::results_file::{Measured, Section, replace, replaced};
use gradreel::ErrorKind;

fn section(name: &str, body: &str) -> Section {
    let (title, split) = (format!("The {name}"), "development".to_owned());
    Section { name: name.into(), title, split, body: body.into() }
}

fn measured() -> Measured {
    Measured {
        machine: "A | B, 2 cores".into(),
        instruction_set: "avx2".into(),
        commit: "0.1.0 (abc)".into(),
        date: "2024-02-29".into(),
        command: "gradreel bench families".into(),
    }
}

#[test]
fn a_section_is_added_and_then_replaced_in_place() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("results.md");
    replace(&file, &section("one", "first"), &measured()).unwrap();
    replace(&file, &section("two", "second"), &measured()).unwrap();
    let text = fs::read_to_string(&file).unwrap();
    for part in [
        "# Results",
        "A \\| B, 2 cores",
        "avx2",
        "0.1.0 (abc)",
        "2024-02-29",
        "development",
        "`gradreel bench families`",
    ] {
        assert!(text.contains(part), "no {part} in {text}");
    }
    let around = format!("before, by hand\n{text}after, by hand\n");
    fs::write(&file, &around).unwrap();
    replace(&file, &section("one", "changed"), &measured()).unwrap();
    let found = fs::read_to_string(&file).unwrap();
    assert_eq!(found, around.replace("first", "changed"), "nothing else is touched");
    replace(&file, &section("one", "first"), &measured()).unwrap();
    assert_eq!(fs::read_to_string(&file).unwrap(), around);
}

#[test]
fn damaged_markers_are_refused() {
    let good = replaced("", &section("one", "x"), &measured()).unwrap();
    let [begin, end] = ["<!-- begin: one -->", "<!-- end: one -->"];
    let swapped = good.replace(begin, "\u{1}").replace(end, begin).replace('\u{1}', end);
    for text in [good.replace(begin, ""), good.replace(end, ""), format!("{good}{good}"), swapped] {
        let error = replaced(&text, &section("one", "y"), &measured()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains("markers"), "{error}");
    }
    // those of another section are not looked at
    assert!(replaced(begin, &section("two", "y"), &measured()).is_ok());
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(replace(folder.path(), &section("one", ""), &measured()).unwrap_err().kind(), ErrorKind::Input);
}

#[test]
fn here_and_now() {
    let here = Measured::here("gradreel");
    assert!(here.machine.ends_with(" cores") && here.command.starts_with("gradreel"), "{here:?}");
    assert_eq!(here.date.len(), 10);
    assert!(!here.instruction_set.is_empty() && !here.commit.is_empty(), "{here:?}");
}
