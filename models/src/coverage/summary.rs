//! All clips of a bench together.

use std::collections::BTreeMap;

use gradreel::Key;
use serde::{Deserialize, Serialize};

use super::{Line, Score};

/// What is known of one unknown of one family.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// Scores; a velocity has three a clip.
    pub n: usize,
    /// Median of the absolute errors, in decades for magnitudes, else in SI units.
    pub median_abs: f64,
    /// The bootstrap deviation of that median, a clip being the unit.
    pub median_deviation: f64,
    /// The error that nine of ten stay below.
    pub p90_abs: f64,
    /// Share of the truths inside the intervals of 50 %.
    pub cover50: f64,
    /// Share of the truths inside the intervals of 90 %.
    pub cover90: f64,
    /// Mean logarithm of the posterior's density at the truth over the prior's \[nats\].
    pub log_score: f64,
    /// Share that the fits say to be determined.
    pub determined: f64,
}

/// Unknowns by name.
pub type Family = BTreeMap<String, Unknown>;

/// The figures of a bench.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Clips that were made.
    pub clips: usize,
    /// Clips that have an estimate.
    pub fitted: usize,
    /// Unknowns by family; `all` holds those of all families together.
    pub families: BTreeMap<String, Family>,
    /// Median and nine-tenths of the time of a fit \[s\].
    pub seconds: Quantiles,
}

/// Two quantiles.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Quantiles {
    /// Half lie below.
    pub median: f64,
    /// Nine of ten lie below.
    pub p90: f64,
}

/// Samples of a bootstrap.
const SAMPLES: u64 = 400;

impl Summary {
    /// The figures of these lines.
    pub fn of(lines: &[Line]) -> Self {
        let mut scores: BTreeMap<String, BTreeMap<String, Vec<Vec<Score>>>> = BTreeMap::new();
        for line in lines {
            // the three components of a velocity are of one kind
            let mut kinds: BTreeMap<&str, Vec<Score>> = BTreeMap::new();
            for (name, score) in &line.scores {
                let kind = if name.starts_with("velocity_") { "velocity" } else { name };
                kinds.entry(kind).or_default().push(*score);
            }
            for (kind, of_clip) in kinds {
                let family = scores.entry(line.family.clone()).or_default();
                family.entry(kind.to_owned()).or_default().push(of_clip);
            }
            let all: Vec<Score> = line.scores.values().copied().collect();
            if !all.is_empty() {
                scores.entry("all".into()).or_default().entry("all".into()).or_default().push(all);
            }
        }
        let families = scores.into_iter().map(|(family, unknowns)| {
            (family, unknowns.into_iter().map(|(name, clips)| (name, Unknown::of(&clips))).collect())
        });
        let fitted: Vec<&Line> = lines.iter().filter(|line| !line.scores.is_empty()).collect();
        let mut seconds: Vec<f64> = fitted.iter().map(|line| line.seconds).collect();
        Self {
            clips: lines.len(),
            fitted: fitted.len(),
            families: families.collect(),
            seconds: Quantiles { median: quantile(&mut seconds, 0.5), p90: quantile(&mut seconds, 0.9) },
        }
    }

    /// The figures as a table in Markdown.
    pub fn markdown(&self) -> String {
        let mut table = format!(
            "{} of {} clips have an estimate; a fit takes {:.1} s in the median, nine of ten less than {:.1} s.\n\n",
            self.fitted, self.clips, self.seconds.median, self.seconds.p90
        );
        table += "| family | unknown | n | median error | ± | 90 % of errors | in 50 % | in 90 % | log score | determined |\n";
        table += "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n";
        for (family, unknowns) in &self.families {
            for (name, unknown) in unknowns {
                let Unknown { n, median_abs, median_deviation, p90_abs, cover50, cover90, log_score, determined } =
                    unknown;
                let errors = match family.as_str() {
                    // decades and metres per second do not add up
                    "all" => "– | – | –".to_owned(),
                    _ => format!("{median_abs:.4} | {median_deviation:.4} | {p90_abs:.3}"),
                };
                table += &format!(
                    "| {family} | {name} | {n} | {errors} | {:.0} % | {:.0} % | {log_score:.2} | {:.0} % |\n",
                    100.0 * cover50,
                    100.0 * cover90,
                    100.0 * determined
                );
            }
        }
        table += "\nErrors are in decades for magnitudes, else in the unit of the unknown. The log score is the mean of the \
                  posterior's log density at the truth, less that of the prior, in nats.\n";
        table
    }
}

impl Unknown {
    /// The figures of some clips, each with its scores.
    fn of(clips: &[Vec<Score>]) -> Self {
        let all: Vec<Score> = clips.iter().flatten().copied().collect();
        let n = all.len();
        let share = |holds: &dyn Fn(&Score) -> bool| all.iter().filter(|score| holds(score)).count() as f64 / n as f64;
        let errors = |clips: &mut dyn Iterator<Item = &Vec<Score>>| -> Vec<f64> {
            clips.flatten().map(|score| score.error.abs()).collect()
        };
        let mut own = errors(&mut clips.iter());
        let resampled = (0..SAMPLES).map(|sample| {
            let picks: Vec<usize> = Key::new(sample).below(clips.len(), clips.len()).collect();
            quantile(&mut errors(&mut picks.iter().map(|&pick| &clips[pick])), 0.5)
        });
        let medians: Vec<f64> = resampled.collect();
        let mean = medians.iter().sum::<f64>() / medians.len() as f64;
        let variance = medians.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / medians.len() as f64;
        Self {
            n,
            median_abs: quantile(&mut own, 0.5),
            median_deviation: variance.sqrt(),
            p90_abs: quantile(&mut own, 0.9),
            cover50: share(&|score| score.inside_50),
            cover90: share(&|score| score.inside_90),
            log_score: all.iter().map(|score| score.log_score).sum::<f64>() / n as f64,
            determined: share(&|score| score.determined),
        }
    }
}

/// A quantile of some numbers, between neighbours; 0 of none.
fn quantile(all: &mut [f64], share: f64) -> f64 {
    all.sort_by(f64::total_cmp);
    let Some(last) = all.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (below, above) = (all[at.floor() as usize], all[at.ceil() as usize]);
    below + at.fract() * (above - below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::Split;

    fn line(clip: u64, error: f64) -> Line {
        let score = Score::normal(error, [error - 1.0, error + 1.0], true, 0.0, -1.0);
        let mut speed = score;
        speed.error = 10.0;
        let scores = [("young", score), ("velocity_x", speed), ("velocity_y", speed)];
        Line {
            clip,
            split: Split::Development,
            cameras: 7,
            family: "elastic".into(),
            calibrated: true,
            background: false,
            pitch: None,
            particles: 1000,
            truth: BTreeMap::new(),
            scores: scores.map(|(name, score)| (name.to_owned(), score)).into(),
            refused: None,
            seconds: clip as f64,
            surveys: Vec::new(),
        }
    }

    #[test]
    fn figures_are_those_of_their_clips() {
        let mut lines: Vec<Line> = (1..=5).map(|clip| line(clip, 0.5 * clip as f64 - 0.5)).collect();
        lines.push(Line { scores: BTreeMap::new(), refused: Some("too dark".into()), ..line(6, 0.0) });
        let summary = Summary::of(&lines);
        assert_eq!((summary.clips, summary.fitted), (6, 5));
        assert_eq!(summary.seconds.median, 3.0);
        let young = summary.families["elastic"]["young"];
        // errors 0, 0.5, 1, 1.5 and 2; half the width of the intervals is 1
        assert_eq!((young.n, young.median_abs, young.cover90), (5, 1.0, 0.6));
        assert!(young.median_deviation > 0.1 && young.median_deviation < 1.0);
        assert_eq!((summary.families["elastic"]["velocity"].n, summary.families["all"]["all"].n), (10, 15));
        assert_eq!(summary.families["elastic"]["velocity"].median_deviation, 0.0);
        assert!(summary.markdown().contains("| elastic | young | 5 | 1.0000 |"));
    }
}
