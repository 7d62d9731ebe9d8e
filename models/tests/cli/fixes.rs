//! What messages advise to give: options that there are.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::scene::Scene;

/// Options of other programs that messages tell how to use, or that are called.
const OTHERS: [&str; 6] = ["input_path", "output_path", "output_type", "short", "porcelain", "untracked-files"];

/// Names of the options of a command and of those below it.
fn options(scene: &Scene, command: &str, found: &mut BTreeSet<String>) {
    let help = scene.succeeds(&format!("{command} --help"));
    let mut commands = false;
    for line in help.lines() {
        match line.strip_prefix("  ") {
            None => commands = line == "Commands:",
            Some(line) if commands && !line.starts_with(' ') && !line.starts_with("help") => {
                let below = line.split_whitespace().next().unwrap();
                options(scene, format!("{command} {below}").trim(), found);
            }
            Some(line) => {
                let line = line.trim_start();
                let line = line.split_once(", ").filter(|(short, _)| short.len() == 2).map_or(line, |(_, long)| long);
                if let Some(name) = line.strip_prefix("--") {
                    found.insert(name.chars().take_while(|c| c.is_alphanumeric() || *c == '-').collect());
                }
            }
        }
    }
}

/// Every `--name` that the text of a program's messages has, with where it stands; `{` for a name that is put in later.
fn named(folder: &Path, found: &mut Vec<(String, String)>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.file_stem().is_some_and(|name| name == "tests") {
            continue;
        }
        if path.is_dir() {
            named(&path, found);
            continue;
        }
        if path.extension().is_none_or(|ending| ending != "rs") {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            for (at, _) in line.match_indices("--") {
                let (before, after) = (line[..at].chars().next_back(), &line[at + 2..]);
                if !before.is_some_and(|c| matches!(c, ' ' | '`' | '(' | '"')) {
                    continue;
                }
                let name: String =
                    after.chars().take_while(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect();
                if name.starts_with(|c: char| c.is_ascii_lowercase()) || after.starts_with('{') {
                    let name = if name.is_empty() { "{".to_owned() } else { name };
                    found.push((name, format!("{}:{}", path.display(), number + 1)));
                }
            }
        }
    }
}

#[test]
fn every_option_that_a_message_names_exists() {
    let mut known = BTreeSet::new();
    options(&Scene::new(), "", &mut known);
    assert!(known.contains("resume") && known.contains("first-frame") && known.contains("off"), "{known:?}");
    let mut said = Vec::new();
    named(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut said);
    assert!(said.len() > 50, "{}", said.len());
    let unknown: Vec<_> = said
        .iter()
        .filter(|(name, _)| {
            !known.contains(name) && !OTHERS.contains(&name.as_str()) && name != "help" && name != "version"
        })
        .collect();
    assert!(unknown.is_empty(), "{unknown:#?}");
}
