//! `gradreel bench laws`: how long rollouts of laws in WGSL take, beside the same laws in Rust.

use std::path::PathBuf;

use gradreel::Result;

use crate::cli::check_law::shipped;
use crate::cli::output::say;
use crate::physics::{Law, rollout_times};
use crate::report::results_file::{self, Measured, Section};
use crate::runtime::interrupt;

/// Arguments of `gradreel bench laws`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Files in WGSL; each is compared with the shipped law of its name
    #[arg(required = true, value_name = "FILE.wgsl")]
    laws: Vec<PathBuf>,
    /// Write the table with the machine, the commit and the date into its section of this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// Measures all pairs and prints the table.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    let mut table = "| law | operations | in Rust | ns a particle and substep | in Rust | ratio |\n".to_owned();
    table += "| --- | ---: | ---: | ---: | ---: | ---: |\n";
    for path in &arguments.laws {
        interrupt::check()?;
        let own = Law::read(path)?;
        let other = shipped(own.name()).map_err(|e| e.at(path.display()))?;
        let times = rollout_times(&[&own, &other])?;
        let [here, there] = [0, 1].map(|k| 1e9 * times[k]);
        let operations = [&own, &other].map(|law| law.program().len());
        table += &format!(
            "| {} | {} | {} | {here:.1} | {there:.1} | {:.2} |\n",
            own.name(),
            operations[0],
            operations[1],
            here / there
        );
    }
    say!("{table}");
    let Some(file) = &arguments.markdown else { return Ok(()) };
    let section = Section {
        name: "laws".into(),
        title: "Rollouts of laws in WGSL beside the same laws in Rust".into(),
        split: "none: a block of 8000 particles that hits the ground".into(),
        body: table,
    };
    results_file::replace(file, &section, &Measured::here("gradreel"))
}
