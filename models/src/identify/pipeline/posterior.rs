//! The posterior: the mixture of what the surviving hypotheses say, weighed by their evidence.

use std::collections::BTreeMap;
use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::rung::{Family, Level, place};
use crate::identify::hypotheses::Hypothesis;
use crate::identify::model::linearise::Derivatives;
use crate::identify::pipeline::context::Context;
use crate::identify::run::Run;
use crate::identify::solve::{Answer, Evaluations, Request, Setting, Threads};
use crate::identify::uncertainty::covariance::{Expansion, Laplace};
use crate::identify::uncertainty::discrepancy::{Resolution, columns};
use crate::identify::uncertainty::error_budget::ErrorBudget;
use crate::identify::uncertainty::interval::within;
use crate::identify::uncertainty::mixture::Marginal;
use crate::identify::uncertainty::prior::{Normal, Prior};
use crate::identify::uncertainty::profile::{self, Profile};
use crate::identify::{Free, Interval, Stage, Unknowns};
use crate::physics::{Law, NINETY};

/// What the clip says of one hypothesis, before the covariance and the prior are counted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Survey {
    /// The family of its material.
    pub family: String,
    /// Where its search ended.
    pub unknowns: Unknowns,
    /// The likelihood there.
    pub expansion: Expansion,
    /// What decides the scales of the covariance.
    pub resolution: Resolution,
    /// What was free, and what was known of it before.
    pub free: Free,
    pub prior: Normal,
    /// The likelihood along what the pictures hardly tell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub profiles: Vec<Profile>,
}

/// A normal part of a posterior, with the logarithm of its weight.
pub(crate) struct Part {
    pub survey: usize,
    pub log_weight: f64,
    pub laplace: Laplace,
    /// The part of each unknown for whose coordinate there is a profile, with the share of its points in place of the normal part.
    walked: BTreeMap<usize, Marginal>,
}

impl Survey {
    /// Its normal posterior, if discrepancies are so many times as large as most, and their columns.
    fn laplace(&self, budget: &ErrorBudget, times: f64, prior: &Prior<'_>) -> Result<(Laplace, Vec<Vec<f64>>)> {
        let (residuals, scales, resolution) = budget.of(&self.resolution);
        let discrepancy = columns(&scales.times(times), prior.law, prior.free, &self.unknowns, &resolution);
        Ok((self.expansion.posterior(prior, &discrepancy, residuals)?, discrepancy))
    }

    /// The posteriors along what its profiles walk, by the places of the unknowns.
    fn walked(
        &self,
        budget: &ErrorBudget,
        prior: &Prior<'_>,
        (laplace, discrepancy): (&Laplace, &[Vec<f64>]),
    ) -> BTreeMap<usize, Marginal> {
        let (residuals, ..) = budget.of(&self.resolution);
        let count = residuals * self.expansion.pictures as f64;
        let walk = |profile: &Profile| {
            let k = profile.unknown;
            let own: f64 = discrepancy.iter().map(|column| column[k] * column[k]).sum();
            let damped = 1.0 + self.expansion.along(laplace, k, residuals) * own;
            let parts = profile.parts(prior, count, damped);
            (!parts.is_empty()).then(|| (k, Marginal::of(parts)))
        };
        self.profiles.iter().filter_map(walk).collect()
    }
}

/// The parts of a posterior: two of each survey, one with the discrepancies of most clips and one with those of outliers.
///
/// # Errors
/// [`ErrorKind::NonFinite`] where no survey has a finite posterior.
pub(crate) fn parts(budget: &ErrorBudget, surveys: &[Survey], priors: &[Prior<'_>]) -> Result<Vec<Part>> {
    let mut all = Vec::new();
    for (index, (survey, prior)) in surveys.iter().zip(priors).enumerate() {
        for (share, times) in [(1.0 - budget.outliers.share, 1.0), (budget.outliers.share, budget.outliers.times)] {
            if let Ok((laplace, discrepancy)) = survey.laplace(budget, times, prior) {
                let walked = survey.walked(budget, prior, (&laplace, &discrepancy));
                all.push(Part { survey: index, log_weight: share.ln() + laplace.log_evidence, laplace, walked });
            }
        }
    }
    match all.is_empty() {
        true => Err(Error::new(ErrorKind::NonFinite, "no hypothesis has a finite posterior").at("posterior")),
        false => Ok(all),
    }
}

/// What the parts say of each free unknown of a family, by name: none of a family that no survey is of.
pub(crate) fn known(
    budget: &ErrorBudget,
    surveys: &[Survey],
    law: &Law,
    family: &str,
) -> Result<BTreeMap<String, Marginal>> {
    let own: Vec<Survey> = surveys.iter().filter(|survey| survey.family == family).cloned().collect();
    let priors: Vec<Prior<'_>> = own.iter().map(|survey| Prior::read(law, survey.free, &survey.prior)).collect();
    let Some(first) = own.first() else { return Ok(BTreeMap::new()) };
    let all = marginals(&parts(budget, &own, &priors)?, &|_| true);
    Ok(first.free.list(law).iter().zip(all).map(|(unknown, marginal)| (unknown.name(law), marginal)).collect())
}

/// What is known of each free unknown of one family, in its order.
pub(crate) fn marginals(parts: &[Part], of: &dyn Fn(usize) -> bool) -> Vec<Marginal> {
    let own: Vec<&Part> = parts.iter().filter(|part| of(part.survey)).collect();
    let count = own.first().map_or(0, |part| part.laplace.mean.len());
    let marginal = |k: usize| {
        let of_part = |part: &&Part| match part.walked.get(&k) {
            Some(walked) => {
                let one = |[weight, mean, deviation]: &[f64; 3]| (part.log_weight + weight.ln(), *mean, *deviation);
                walked.parts.iter().map(one).collect()
            }
            None => {
                vec![(part.log_weight, part.laplace.mean[k], part.laplace.covariance[k][k].max(0.0).sqrt())]
            }
        };
        Marginal::of(own.iter().flat_map(of_part))
    };
    (0..count).map(marginal).collect()
}

/// The likelihood along each parameter that the pictures hardly tell, with the fewest stable substeps: only its shape counts.
fn profiles(setting: &Setting<'_>, survey: &Survey) -> Result<Vec<Profile>> {
    let law = &setting.problem.law;
    let prior = Prior::read(law, survey.free, &survey.prior);
    let Ok((laplace, _)) = survey.laplace(&ErrorBudget::shipped(), 1.0, &prior) else { return Ok(Vec::new()) };
    let lines: Vec<(usize, Vec<Vec<f64>>)> =
        profile::flat(&laplace, &prior).into_iter().map(|k| (k, profile::line(&laplace, &prior, k))).collect();
    let request = |x: &Vec<f64>| Request {
        setting: 0,
        at: survey.unknowns.moved(law, survey.free, x),
        derivatives: None,
        substeps: 0,
    };
    let requests: Vec<Request> = lines.iter().flat_map(|(_, line)| line.iter().map(request)).collect();
    let mut answers = Threads(std::slice::from_ref(setting)).evaluate(&requests)?.into_iter();
    let profile = |(unknown, line): (usize, Vec<Vec<f64>>)| {
        let log_loss = answers.by_ref().take(line.len());
        let log_loss = log_loss.map(|answer| answer.loss.map(|_| answer.log_loss)).collect();
        Profile { unknown, line, log_loss }
    };
    Ok(lines.into_iter().map(profile).collect())
}

impl Context<'_> {
    /// Looks at each survivor with everything free that the clip can tell.
    pub fn survey(
        &self,
        run: &mut Run,
        stage: Stage,
        families: &[Family],
        level: &Level<'_>,
        survivors: &[Hypothesis],
    ) -> Result<()> {
        if run.has_finished(stage) {
            return Ok(());
        }
        let since = Instant::now();
        let frames = level.observed.targets.len();
        let floor = self.floor(run, level)?;
        let mut settings = Vec::new();
        for family in families {
            let free = self.freedom(run, family, true)?;
            let problem = family.problem(level, run);
            settings.push(Setting { problem, free, frames: 0..frames, floor });
        }
        let bar = self.progress.stage(&stage.to_string(), survivors.len() as u64);
        let derivatives = Derivatives::reaching(run.config.estimate.reach);
        let request = |survivor: &Hypothesis| Request {
            setting: place(families, &survivor.family),
            at: survivor.unknowns.clone(),
            derivatives: Some(derivatives),
            substeps: 0,
        };
        let requests: Vec<Request> = survivors.iter().map(request).collect();
        let answers = Threads(&settings).evaluate(&requests)?;
        let diameter = 2.0 * (0.75 * level.particles.volume() / std::f64::consts::PI).cbrt();
        let length = self.length(run);
        let fall = self.fall(run)?;
        let mut surveys = Vec::new();
        for (survivor, answer) in survivors.iter().zip(answers) {
            let Setting { problem, free, .. } = &settings[place(families, &survivor.family)];
            let Answer { loss: Some(_), log_loss, gradient, curvature, notes, .. } = answer else { continue };
            notes.into_iter().for_each(|note| run.note(format!("{stage}: {note}")));
            if curvature.is_empty() {
                continue;
            }
            let resolution = Resolution {
                dx: problem.world.dx,
                diameter,
                filmed: level.observed.frame_dt * (frames - 1).max(1) as f64,
                impact: self.impact(run, &survivor.unknowns),
                density: run.config.world.density,
                length,
                one_camera: self.observed.sight.is_some(),
            };
            let x = survivor.unknowns.coordinates(&problem.law, *free);
            let pictures = frames * level.observed.views.len();
            surveys.push(Survey {
                family: survivor.family.clone(),
                unknowns: survivor.unknowns.clone(),
                expansion: Expansion { x, log_loss, gradient, curvature, pictures },
                resolution,
                free: *free,
                prior: Prior::of(&problem.law, *free, &survivor.unknowns, fall.as_ref()).written(),
                profiles: Vec::new(),
            });
        }
        for survey in &mut surveys {
            let Setting { problem, free, frames, floor } = &settings[place(families, &survey.family)];
            let walked = Setting {
                problem: problem.clone().fewest_substeps(),
                free: *free,
                frames: frames.clone(),
                floor: *floor,
            };
            survey.profiles = profiles(&walked, survey)?;
        }
        run.state.surveys = surveys;
        bar.finish("");
        run.finish(stage, since)
    }

    /// The posterior of the surveys: which family it is, its unknowns, and how sure they are.
    pub fn conclude(&self, run: &mut Run, families: &[Family]) -> Result<()> {
        let surveys = run.state.surveys.clone();
        let prior =
            |survey: &Survey| Prior::read(&families[place(families, &survey.family)].law, survey.free, &survey.prior);
        let priors: Vec<Prior<'_>> = surveys.iter().map(prior).collect();
        let parts = parts(&ErrorBudget::shipped(), &surveys, &priors)?;
        let most = parts.iter().map(|part| part.log_weight).fold(f64::NEG_INFINITY, f64::max);
        let mut evidence = BTreeMap::<String, f64>::new();
        for part in &parts {
            let sum = evidence.entry(surveys[part.survey].family.clone()).or_default();
            *sum += (part.log_weight - most).exp();
        }
        let (family, _) = evidence.iter().max_by(|a, b| a.1.total_cmp(b.1)).expect("there are parts");
        let family = family.clone();
        let own = |survey: usize| surveys[survey].family == family;
        let best = parts.iter().filter(|part| own(part.survey)).max_by(|a, b| a.log_weight.total_cmp(&b.log_weight));
        let best = best.expect("the family has parts");
        let (survey, prior) = (&surveys[best.survey], &priors[best.survey]);
        let (law, free) = (prior.law, prior.free);
        let marginals = marginals(&parts, &own);
        let deviations = prior.deviations();
        // one simulation that explains the film, which medians of marginals would not be
        let unknowns = survey.unknowns.clone();
        let found = unknowns.coordinates(law, free);
        let list = free.list(law);
        let mut intervals = Vec::new();
        for (k, (unknown, marginal)) in list.iter().zip(&marginals).enumerate() {
            let ends = [0.05, 0.95].map(|p| marginal.quantile(p));
            let value = |x: f64| {
                let mut at = found.clone();
                at[k] = x;
                unknown.of(&unknowns.moved(law, free, &at))
            };
            // whatever the others say, it holds what was found
            let holding = [ends[0].min(found[k]), ends[1].max(found[k])];
            let interval_90 = within(law, *unknown, &unknowns, holding.map(value));
            let determined = ends[1] - ends[0] <= 2.0 * NINETY * deviations[k] / 3.0;
            intervals.push(Interval { name: unknown.name(law), interval_90, determined });
        }
        run.state.log_evidence = evidence.into_iter().map(|(name, weight)| (name, weight.ln())).collect();
        run.state.intervals = intervals;
        run.state.marginals =
            list.iter().zip(marginals).map(|(unknown, marginal)| (unknown.name(law), marginal)).collect();
        run.state.unknowns = Some(unknowns);
        run.save()
    }
}
