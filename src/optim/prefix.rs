//! Settings by prefix of a dotted path.

use std::collections::BTreeMap;

use crate::{Error, ErrorKind, Result};

/// Values by prefix; the longest prefix that matches counts.
///
/// A prefix ends where a component of the path ends: `net.out` matches `net.out` and `net.out.weight`, not `net.outer`. The
/// empty prefix matches everything.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ByPrefix<T>(BTreeMap<String, T>);

impl<T> Default for ByPrefix<T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<T> ByPrefix<T> {
    pub fn insert(&mut self, prefix: impl Into<String>, value: T) {
        self.0.insert(prefix.into(), value);
    }

    pub fn get(&self, path: &str) -> Option<&T> {
        if self.0.is_empty() {
            return None;
        }
        let mut prefix = path;
        loop {
            if let Some(value) = self.0.get(prefix) {
                return Some(value);
            }
            if prefix.is_empty() {
                return None;
            }
            prefix = prefix.rfind('.').map_or("", |dot| &prefix[..dot]);
        }
    }

    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.0.values()
    }

    /// Refuses a prefix that no path has.
    pub fn check<V>(&self, what: &str, paths: &BTreeMap<String, V>) -> Result<()> {
        self.0.keys().try_for_each(|prefix| check_prefix(what, prefix, paths))
    }
}

/// Refuses a prefix that no path has.
pub(super) fn check_prefix<V>(what: &str, prefix: &str, paths: &BTreeMap<String, V>) -> Result<()> {
    if prefix.is_empty() || under(paths, prefix).next().is_some() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, format!("{what} for a prefix that no parameter has"))
        .at(prefix)
        .found(format!("paths such as {:?}", paths.keys().take(8).collect::<Vec<_>>())))
}

/// The entries at and below a prefix.
pub(super) fn under<'m, V>(paths: &'m BTreeMap<String, V>, prefix: &str) -> impl Iterator<Item = (&'m String, &'m V)> {
    // `a.b` itself, then everything that starts with `a.b.`; `a.b-c` sorts between the two
    let inside = if prefix.is_empty() { String::new() } else { format!("{prefix}.") };
    let whole = paths.get_key_value(prefix).filter(|_| !prefix.is_empty());
    let rest = paths.range(inside.clone()..).take_while(move |(path, _)| path.starts_with(&inside));
    whole.into_iter().chain(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_prefix_of_whole_components_counts() {
        let mut rates = ByPrefix::default();
        for (prefix, rate) in [("net", 1), ("net.out", 2), ("net.out.bias", 3)] {
            rates.insert(prefix, rate);
        }
        assert_eq!(rates.get("net.outer.weight"), Some(&1));
        assert_eq!(rates.get("net.out.weight"), Some(&2));
        assert_eq!(rates.get("net.out.bias"), Some(&3));
        assert_eq!(rates.get("network"), None);
        let paths: BTreeMap<_, _> =
            ["net.a", "net.out-2", "net.out.bias", "net.out"].map(|p| (p.to_owned(), ())).into();
        assert_eq!(
            under(&paths, "net.out").map(|(path, _)| path.as_str()).collect::<Vec<_>>(),
            ["net.out", "net.out.bias"]
        );
        assert_eq!(under(&paths, "").count(), 4);
        rates.check("a rate", &paths).unwrap();
        rates.insert("net.o", 4);
        assert!(rates.check("a rate", &paths).unwrap_err().to_string().contains("net.o"));
    }
}
