//! `gradreel check-law`: the checks of a law of one's own, its response and its speed.

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};
use serde_json::json;

use crate::cli::output::{self, say};
use crate::nearest::{listed, nearest};
use crate::physics::{Law, check_material, materials, responses, rollout_times, speed};
use crate::report::plot::{Plot, Series};

/// Arguments of `gradreel check-law`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The law: a file in WGSL (see docs/guide/laws.md), or the name of a shipped one
    law: PathBuf,
    /// Plot of the response to extension, shear and change of volume [default: <law>.svg here]
    #[arg(long, value_name = "FILE.svg", conflicts_with = "no_plot")]
    plot: Option<PathBuf>,
    /// Compare the time of a rollout with that of a shipped law, such as the same law in Rust
    #[arg(long, value_name = "NAME")]
    against: Option<String>,
    /// No plot
    #[arg(long)]
    no_plot: bool,
    /// Everything as JSON
    #[arg(long)]
    json: bool,
}

/// Checks a law; fails if a check does.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let law = match arguments.law.to_str().and_then(materials::find) {
        Some(shipped) => shipped,
        None => Law::read(&arguments.law)?,
    };
    let other = arguments.against.as_deref().map(shipped).transpose()?;
    let rollouts = other.as_ref().map(|other| rollout_times(&[&law, other])).transpose()?;
    let rollouts = rollouts.map(|times| [1e9 * times[0], 1e9 * times[1]]);
    let report = check_material(&law)?;
    let values = law.start_values();
    let curves = responses(&law, &values);
    let others = materials::all().into_iter().filter(|other| !other.name().starts_with("learned"));
    let mut speeds: Vec<(String, f64)> = others.map(|other| (other.name().to_owned(), 1e9 * speed(&other))).collect();
    let own = 1e9 * speed(&law);
    speeds.sort_by(|a, b| a.1.total_cmp(&b.1));
    let plot = (!arguments.no_plot)
        .then(|| arguments.plot.clone().unwrap_or_else(|| PathBuf::from(format!("{}.svg", law.name()))));
    if let Some(path) = &plot {
        let series = curves.iter().map(|one| Series { label: one.name.to_owned(), points: one.points.clone() });
        let plot = Plot {
            title: format!("{}: response at a strain rate of 1/s", law.name()),
            x_label: "strain".to_owned(),
            y_label: "Kirchhoff stress [Pa]".to_owned(),
            log_y: false,
            series: series.collect(),
            reference: None,
        };
        std::fs::write(path, plot.svg()).map_err(|e| Error::io(path, "write the plot", &e))?;
    }
    if arguments.json {
        let checks = report.checks.iter().map(|check| {
            let verdict = match check.passed() {
                _ if check.is_skipped() => "skipped",
                true => "passed",
                false => "failed",
            };
            // JSON has no infinity
            let number = |x: f64| x.is_finite().then_some(x);
            json!({ "name": check.name, "verdict": verdict, "found": number(check.found), "allowed": number(check.allowed),
                    "note": check.note })
        });
        let parameters = law
            .parameters()
            .iter()
            .map(|p| json!({ "name": p.name, "unit": p.unit, "start": p.start, "prior": p.prior }));
        let curves: serde_json::Map<_, _> = curves.iter().map(|one| (one.name.to_owned(), json!(one.points))).collect();
        let whole = json!({
            "law": law.name(),
            "passed": report.passed(),
            "checks": checks.collect::<Vec<_>>(),
            "parameters": parameters.collect::<Vec<_>>(),
            "operations": law.program().len(),
            "nanoseconds_per_particle": own,
            "rollout_nanoseconds_per_particle_and_substep": rollouts.map(|[own, _]| own),
            "rollout_times_those_of_the_other": rollouts.map(|[own, other]| own / other),
            "shipped_nanoseconds_per_particle": speeds.iter().cloned().collect::<std::collections::BTreeMap<_, _>>(),
            "responses": curves,
        });
        say!("{whole:#}");
    } else {
        output::print(format_args!("{report}"));
        say!("  {} operations, {own:.1} ns a particle on one thread; shipped laws:", law.program().len());
        for (name, time) in &speeds {
            say!("    {name:<20} {time:>6.1} ns");
        }
        if let (Some([own, its]), Some(other)) = (rollouts, &other) {
            let name = other.name();
            say!("  rollout: {own:.1} ns a particle and substep, {:.2} times the {its:.1} ns of {name}", own / its);
        }
        if let Some(path) = &plot {
            say!("  response: {}", path.display());
        }
    }
    match report.passed() {
        true => Ok(()),
        false => {
            Err(Error::new(ErrorKind::NoGradient, "the law fails a check; see the rows marked FAIL").at(law.name()))
        }
    }
}

/// A law of the library.
///
/// # Errors
/// [`ErrorKind::Input`] for a name that none has.
pub(super) fn shipped(name: &str) -> Result<Law> {
    materials::find(name).ok_or_else(|| {
        let laws = materials::all();
        let names = || laws.iter().map(Law::name);
        Error::new(ErrorKind::Input, "there is no law of this name to compare with")
            .found(format!("`{name}`"))
            .wanted(format!("one of {}", listed(names())))
            .fix(
                nearest(name, names())
                    .map_or("choose one of these".to_owned(), |near| format!("did you mean `{near}`?")),
            )
    })
}
