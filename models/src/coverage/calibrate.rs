//! The error budget from clips that were fitted: the scales under which their truths are most probable.

use gradreel::{Error, ErrorKind, Result};

use super::{Line, Recipe, Split, material};
use crate::identify::{Discrepancy, ErrorBudget, OneCamera, Outliers, coordinate, known, law_of};
use crate::physics::Law;

/// What a calibration found.
pub(crate) struct Calibrated {
    pub budget: ErrorBudget,
    /// Clips that counted.
    pub clips: usize,
    /// The mean logarithm of the posterior's density at the truth over the prior's, before and after \[nat\].
    pub log_scores: [f64; 2],
}

/// Factors by which a scale is tried larger and smaller, one after another.
const FACTORS: [f64; 5] = [3.0, 1.8, 1.35, 1.15, 1.05];

/// Rounds through all scales with each factor at most.
const ROUNDS: usize = 6;

/// Scales stay within this.
const RANGE: [f64; 2] = [2e-3, 30.0];

/// Outliers are few, and a few times further off: what half of all clips have is the rule, and a normal distribution much wider than the prior
/// says nothing.
const OUTLIERS: Outliers = Outliers { share: 0.2, times: 6.0 };

/// Where the search starts, besides the shipped budget: a share of a cell everywhere.
const PLAIN: ErrorBudget = ErrorBudget {
    residuals: 0.5,
    outliers: Outliers { share: 0.1, times: 4.0 },
    discrepancy: Discrepancy {
        magnitude: 1.0,
        strain: 0.5,
        stress: 0.5,
        viscosity: 0.1,
        share: 0.5,
        compression: 0.1,
        velocity: 0.02,
    },
    one_camera: OneCamera { residuals: 0.1, shape: 0.3, velocity: 0.3 },
};

/// The budget that makes the truths of development clips most probable, found one scale after another from the shipped one and from a plain
/// one. The fits are not repeated: what a clip says of its hypotheses does not hang on the budget.
///
/// # Errors
/// [`ErrorKind::Input`] for clips of the report split, and where no clip was fitted.
pub(crate) fn calibrate(lines: &[Line]) -> Result<Calibrated> {
    if let Some(line) = lines.iter().find(|line| line.split == Split::Report) {
        return Err(Error::new(ErrorKind::Input, "an error budget is never measured on clips that are reported")
            .at(format!("clip {}", line.clip))
            .wanted("clips of the development split")
            .fix("run `gradreel bench coverage` without --split report"));
    }
    let clips: Vec<Clip<'_>> =
        lines.iter().filter(|line| !line.surveys.is_empty()).map(Clip::of).collect::<Result<_>>()?;
    if clips.is_empty() {
        return Err(Error::new(ErrorKind::Input, "no clip tells anything of the error budget")
            .found(format!("{} clips, all refused", lines.len()))
            .fix("fit more clips with `gradreel bench coverage`"));
    }
    let before = mean_log_score(&clips, &ErrorBudget::shipped());
    let found = [ErrorBudget::shipped(), PLAIN].map(|start| climb(&clips, start));
    let (budget, best) = found.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are two");
    Ok(Calibrated { budget, clips: clips.len(), log_scores: [before, best] })
}

/// Changes one scale after another as long as the score grows.
fn climb(clips: &[Clip<'_>], mut budget: ErrorBudget) -> (ErrorBudget, f64) {
    let within = |budget: &mut ErrorBudget| {
        let Outliers { share, times } = &mut budget.outliers;
        (*share, *times) = (share.min(OUTLIERS.share), times.min(OUTLIERS.times));
    };
    within(&mut budget);
    let mut best = mean_log_score(clips, &budget);
    for factor in FACTORS {
        for _ in 0..ROUNDS {
            let begun = best;
            for k in 0..budget.values().len() {
                for times in [factor, 1.0 / factor] {
                    let mut other = budget;
                    let value = &mut *other.values_mut()[k];
                    *value = (*value * times).clamp(RANGE[0], RANGE[1]);
                    within(&mut other);
                    let found = mean_log_score(clips, &other);
                    if found > best {
                        (budget, best) = (other, found);
                    }
                }
            }
            if best - begun < 1e-4 {
                break;
            }
        }
    }
    (budget, best)
}

/// A clip with what decides its scores.
struct Clip<'a> {
    line: &'a Line,
    law: Law,
    /// Of each scored unknown: its name, its truth's coordinate, and what a density there is to be multiplied with for one over the prior's, as a
    /// logarithm.
    truths: Vec<(String, f64, f64)>,
}

impl<'a> Clip<'a> {
    fn of(line: &'a Line) -> Result<Self> {
        let law = law_of(&line.family).expect("families have laws");
        let recipe = Recipe::draw(line.split, line.clip, line.cameras, None)?;
        let truth = |name: &String| {
            let value = *line.truth.get(name)?;
            let (x, slope) = coordinate(&law, name, value)?;
            let parameter = law.parameters().iter().find(|parameter| parameter.name == name);
            let per_unit = parameter.map_or(1.0, |parameter| material::slope(parameter, value));
            Some((name.clone(), x, (slope / per_unit).abs().ln() - recipe.log_prior.get(name)?))
        };
        let truths = line.scores.keys().filter_map(truth).collect();
        Ok(Self { line, law, truths })
    }

    /// The scores with a budget.
    fn scores(&self, budget: &ErrorBudget) -> Vec<f64> {
        let Ok(known) = known(budget, &self.line.surveys, &self.law, &self.line.family) else { return vec![] };
        self.truths.iter().filter_map(|(name, x, rest)| Some(known.get(name)?.log_density(*x) + rest)).collect()
    }
}

fn mean_log_score(clips: &[Clip<'_>], budget: &ErrorBudget) -> f64 {
    let all: Vec<f64> = clips.iter().flat_map(|clip| clip.scores(budget)).collect();
    match all.iter().sum::<f64>() / all.len().max(1) as f64 {
        mean if mean.is_finite() => mean,
        _ => f64::NEG_INFINITY,
    }
}
