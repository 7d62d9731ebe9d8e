//! Files of the sources, and the few things of Markdown that the tests look at.

use std::fs;
use std::path::{Path, PathBuf};

/// Folders that hold no sources.
const SKIPPED: [&str; 4] = ["target", "runs", ".git", "node_modules"];

/// The root of the sources.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below the root with one of these extensions, sorted.
pub fn files(extensions: &[&str]) -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![root().to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let fits = path.extension().is_some_and(|e| extensions.contains(&&*e.to_string_lossy()));
            match path.is_dir() {
                true if !SKIPPED.contains(&&*name) => folders.push(path),
                false if fits => found.push(path),
                _ => {}
            }
        }
    }
    found.sort();
    found
}

/// The text of a file below the root.
pub fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A path as it is written in messages.
pub fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// The lines outside of fenced code, with their numbers from 1.
pub fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut code = false;
    text.lines().enumerate().filter_map(move |(at, line)| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        (!code && !fence).then_some((at + 1, line))
    })
}

/// A line with its `code` replaced by blanks.
pub fn without_code(line: &str) -> String {
    let mut code = false;
    let blank = |c: char| {
        code ^= c == '`';
        if code || c == '`' { ' ' } else { c }
    };
    line.chars().map(blank).collect()
}

/// The targets of the links and pictures of a line.
pub fn targets(line: &str) -> Vec<String> {
    let line = without_code(line);
    line.match_indices("](").filter_map(|(at, _)| Some(line[at + 2..].split_once(')')?.0.to_owned())).collect()
}

/// The anchors of a text's headings: lower case, blanks as hyphens, no punctuation, `-1`, `-2` … for repetitions.
pub fn anchors(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for (_, line) in prose(text) {
        let Some(title) = line.trim_start_matches('#').strip_prefix(' ').filter(|_| line.starts_with('#')) else {
            continue;
        };
        let kept = title.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let base: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase();
        let repeated = (1..).map(|n| format!("{base}-{n}"));
        let anchor = [base.clone()].into_iter().chain(repeated).find(|anchor| !found.contains(anchor));
        found.extend(anchor);
    }
    found
}

#[test]
fn headings_have_the_anchors_that_renderers_give_them() {
    let text =
        "# A title: with `code`\n```\n# no heading\n```\n## 5. Motion: MLS-MPM (`physics`)\n## Same\n## Same\n#none\n";
    assert_eq!(anchors(text), ["a-title-with-code", "5-motion-mls-mpm-physics", "same", "same-1"]);
}

#[test]
fn links_in_code_do_not_count() {
    assert_eq!(targets("[a](b.md#c) `[d](e)` ![f](g.png)"), ["b.md#c", "g.png"]);
}
