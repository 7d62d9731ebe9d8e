//! Every relative link of every Markdown file leads to a file and, if it names one, to a heading.

use std::path::Path;

use crate::markdown::{anchors, files, prose, shown, targets};

/// What is wrong with a link of this file.
fn fault(file: &Path, target: &str) -> Option<String> {
    if target.contains("://") || target.starts_with("mailto:") {
        return None;
    }
    let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
    let to = if path.is_empty() { file.to_path_buf() } else { file.parent()?.join(path) };
    if !to.exists() {
        return Some("there is no such file".to_owned());
    }
    if anchor.is_empty() {
        return None;
    }
    let text = std::fs::read_to_string(&to).unwrap_or_default();
    let known = anchors(&text);
    (!known.iter().any(|known| known == anchor)).then(|| format!("no such heading; there are {known:?}"))
}

#[test]
fn links_lead_somewhere() {
    let mut faults = Vec::new();
    for file in files(&["md"]) {
        let text = std::fs::read_to_string(&file).unwrap();
        for (number, line) in prose(&text) {
            let wrong = |target: String| {
                fault(&file, &target).map(|why| format!("{}:{number}: ({target}): {why}", shown(&file)))
            };
            faults.extend(targets(line).into_iter().filter_map(wrong));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_broken_link_is_found() {
    let readme = crate::markdown::root().join("README.md");
    assert_eq!(fault(&readme, "docs/method.md"), None);
    assert_eq!(fault(&readme, "docs/method.md#symbols"), None);
    assert!(fault(&readme, "docs/methods.md").is_some());
    assert!(fault(&readme, "docs/method.md#symbol").is_some());
}
