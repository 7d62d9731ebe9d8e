//! The names and shapes of the published checkpoint.

use std::collections::BTreeMap;

use crate::views::{ModelSizes, UNUSED};

#[test]
fn every_entry_of_the_published_checkpoint_is_accounted_for() {
    let mut published: BTreeMap<&str, &str> = include_str!("../../../tests/vectors/views/keys.tsv")
        .lines()
        .map(|line| line.split_once('\t').expect("a name and a shape"))
        .collect();
    assert_eq!(published.len(), 1618);
    for (path, shape) in ModelSizes::published().weights().unwrap() {
        let shape = shape.dims().iter().map(usize::to_string).collect::<Vec<_>>().join("x");
        assert_eq!(published.remove(path.as_str()), Some(shape.as_str()), "{path}");
    }
    let left: Vec<&str> = published.into_keys().collect();
    let mut unused = UNUSED.to_vec();
    unused.sort_unstable();
    assert_eq!(left, unused);
}
