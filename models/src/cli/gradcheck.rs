//! `gradreel gradcheck`: compares derivatives with central differences.

use gradreel::ops::registry;
use gradreel::{Error, ErrorKind, Result};

use crate::cli::output::{self, say};
use crate::physics::materials;

/// Arguments of `gradreel gradcheck`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Only ops and materials whose name contains this
    filter: Option<String>,
}

/// Checks every op of the registry and the stress of every material; fails if one table has a FAIL.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let wanted = |name: &str| arguments.filter.as_deref().is_none_or(|part| name.contains(part));
    let (mut passed, mut failed) = (0, 0);
    let mut count = |report: gradreel::GradReport| {
        output::print(format_args!("{report}"));
        if report.passed() { passed += 1 } else { failed += 1 }
    };
    for entry in registry().into_iter().filter(|entry| wanted(entry.name)) {
        for case in (entry.cases)() {
            case.gradcheck(entry.name)?.into_iter().for_each(&mut count);
        }
    }
    for law in materials::all().into_iter().filter(|law| wanted(law.name())) {
        count(law.gradcheck()?);
    }
    say!("{passed} passed, {failed} failed");
    match (passed + failed, failed) {
        (0, _) => Err(Error::new(ErrorKind::Input, "no op or material has such a name")
            .found(arguments.filter.as_deref().unwrap_or_default())
            .fix("run `gradreel gradcheck` without a name to see all")),
        (_, 0) => Ok(()),
        _ => Err(Error::new(ErrorKind::NoGradient, "a derivative is wrong; see the rows marked FAIL")),
    }
}
