//! The book has every page, and every decision its three parts.

use crate::markdown::{files, read, shown};

#[test]
fn the_summary_lists_every_page_once() {
    let summary = read("docs/SUMMARY.md");
    for file in files(&["md"]) {
        let path = shown(&file);
        let Some(page) = path.strip_prefix("docs/").filter(|page| *page != "SUMMARY.md") else { continue };
        let count = summary.matches(&format!("]({page})")).count();
        assert_eq!(count, 1, "docs/SUMMARY.md lists {page} {count} times");
    }
}

#[test]
fn decisions_are_numbered_and_have_three_parts() {
    let records = files(&["md"]).into_iter().filter(|file| shown(file).starts_with("docs/decisions/"));
    for (at, file) in records.enumerate() {
        let name = shown(&file);
        let number = at + 1;
        assert!(name.starts_with(&format!("docs/decisions/{number:04}-")), "{name} is the {number}th");
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.starts_with(&format!("# {number}. ")), "{name}");
        let parts: Vec<&str> = text.lines().filter(|line| line.starts_with("## ")).collect();
        assert_eq!(parts, ["## Context", "## Decision", "## Consequence"], "{name}");
    }
}
