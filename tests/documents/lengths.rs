//! Documents stay short, and the README starts with the two commands.

use crate::markdown::{files, read, root, shown};

/// What a document may have at most.
fn limit(path: &str) -> Option<usize> {
    match path {
        "README.md" => Some(130),
        "ARCHITECTURE.md" => Some(200),
        "docs/method.md" => Some(300),
        _ if path.starts_with("docs/guide/") => Some(150),
        _ if path.starts_with("docs/decisions/") => Some(40),
        _ => None,
    }
}

#[test]
fn documents_stay_within_their_lines() {
    let mut found = 0;
    for file in files(&["md"]) {
        let Some(most) = limit(&shown(&file)) else { continue };
        let lines = std::fs::read_to_string(&file).unwrap().lines().count();
        assert!(lines <= most, "{} has {lines} lines, at most {most}", shown(&file));
        found += 1;
    }
    assert!(found > 40, "only {found} documents with a limit");
}

#[test]
fn the_readme_fits_a_terminal() {
    for (at, line) in read("README.md").lines().enumerate() {
        let columns = line.chars().count();
        assert!(columns <= 120, "README.md:{} has {columns} columns, at most 120", at + 1);
    }
}

#[test]
fn the_readme_starts_with_the_two_commands() {
    let readme = read("README.md");
    let commands = readme.lines().skip_while(|line| *line != "## Two commands").skip_while(|line| *line != "```sh");
    let commands: Vec<&str> = commands.skip(1).take_while(|line| *line != "```").collect();
    let wanted = ["cargo run --release -- reconstruct examples/clips/bird.gif", "cargo test --release --workspace"];
    assert_eq!(commands, wanted);
    assert!(root().join("examples/clips/bird.gif").is_file());
}

#[test]
fn generated_sections_are_closed() {
    let results = read("docs/results.md");
    let names = |mark: &str| -> Vec<String> {
        let mark = format!("<!-- {mark}: ");
        let lines = results.lines().filter_map(|line| line.strip_prefix(&mark)?.strip_suffix(" -->"));
        lines.map(str::to_owned).collect()
    };
    let begun = names("begin");
    assert_eq!(begun, names("end"));
    assert!(["families-quick", "core-2"].iter().all(|name| begun.iter().any(|known| known == name)), "{begun:?}");
}
