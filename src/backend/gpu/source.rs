//! WGSL text with `#import` lines, put together into one module.

use std::collections::BTreeSet;

use crate::{Error, ErrorKind, Result};

/// The files that kernels may import, by the path they are imported under.
const SHARED: &[(&str, &str)] = &[
    ("shared/exp.wgsl", include_str!("../../../kernels/shared/exp.wgsl")),
    ("shared/grid.wgsl", include_str!("../../../kernels/shared/grid.wgsl")),
    ("shared/is_nan.wgsl", include_str!("../../../kernels/shared/is_nan.wgsl")),
    ("shared/linear.wgsl", include_str!("../../../kernels/shared/linear.wgsl")),
    ("shared/ln.wgsl", include_str!("../../../kernels/shared/ln.wgsl")),
    ("shared/logistic.wgsl", include_str!("../../../kernels/shared/logistic.wgsl")),
    ("shared/max.wgsl", include_str!("../../../kernels/shared/max.wgsl")),
    ("shared/min.wgsl", include_str!("../../../kernels/shared/min.wgsl")),
    ("shared/sum_of_group.wgsl", include_str!("../../../kernels/shared/sum_of_group.wgsl")),
];

/// A kernel's text after its imports, and where each of its lines came from.
#[derive(Debug)]
pub(super) struct Source {
    pub(super) text: String,
    origins: Vec<(String, usize)>,
}

impl Source {
    /// Replaces each line `#import "path"` by the file or, for `#import "program"`, by `program`; by nothing where it
    /// was imported before.
    pub(super) fn expand(name: &str, text: &str, program: Option<&str>) -> Result<Self> {
        let mut source = Self { text: String::new(), origins: Vec::new() };
        source.append(&format!("{name}.wgsl"), text, program, &mut BTreeSet::new())?;
        Ok(source)
    }

    fn append(&mut self, file: &str, text: &str, program: Option<&str>, seen: &mut BTreeSet<String>) -> Result<()> {
        for (number, line) in text.lines().enumerate() {
            let Some(path) = line.strip_prefix("#import ") else {
                self.text.push_str(line);
                self.text.push('\n');
                self.origins.push((file.to_owned(), number + 1));
                continue;
            };
            let path = path.trim().trim_matches('"');
            if !seen.insert(path.to_owned()) {
                continue;
            }
            let shared = SHARED.iter().find(|(known, _)| *known == path).map(|(_, text)| *text);
            let Some(imported) = shared.or(program.filter(|_| path == "program")) else {
                return Err(Error::new(ErrorKind::Input, "a kernel imports what does not exist")
                    .at(format!("{file}:{}", number + 1))
                    .found(path)
                    .wanted(SHARED.iter().map(|(path, _)| *path).collect::<Vec<_>>().join(", ")));
            };
            self.append(path, imported, program, seen)?;
        }
        Ok(())
    }

    /// File and line that a line of the text (from 1) came from.
    pub(super) fn origin(&self, line: usize) -> String {
        match self.origins.get(line.saturating_sub(1)) {
            Some((file, line)) => format!("{file}:{line}"),
            None => format!("line {line}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Source;

    #[test]
    fn imports_are_put_in_once_and_lines_keep_their_origin() {
        let text = "#import \"program\"\n#import \"program\"\nfn g() {}\n";
        let source = Source::expand("k", text, Some("// one\nfn f() {}")).unwrap();
        assert_eq!(source.text, "// one\nfn f() {}\nfn g() {}\n");
        assert_eq!([source.origin(2), source.origin(3)], ["program:2", "k.wgsl:3"]);
    }

    #[test]
    fn a_missing_import_is_named_with_its_line() {
        let error = Source::expand("k", "\n#import \"shared/none.wgsl\"", None).unwrap_err().to_string();
        assert!(error.contains("k.wgsl:2") && error.contains("shared/none.wgsl"), "{error}");
    }
}
