//! Evaluations of the forward model, in batches: a list of requests in, losses or normal equations out.

use std::ops::Range;

use gradreel::{ErrorKind, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::identify::model::linearise::Derivatives;
use crate::identify::{Free, Linearised, Problem, Substeps, Unknowns};
use crate::runtime::interrupt;

/// What a search asks for.
#[derive(Debug, Clone)]
pub(crate) struct Request {
    /// Which of the settings.
    pub setting: usize,
    /// Where.
    pub at: Unknowns,
    /// Whether the normal equations are asked for, too, and how.
    pub derivatives: Option<Derivatives>,
    /// The least number of substeps a frame.
    pub substeps: usize,
}

/// What an evaluation gave.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Answer {
    /// The mean loss of the frames; nothing where the physics broke down.
    pub loss: Option<f64>,
    /// The mean of `ln(L + floor)` over the frames.
    #[serde(default)]
    pub log_loss: f64,
    /// Its gradient, where it was asked for.
    pub gradient: Vec<f64>,
    /// Its curvature, where it was asked for and is finite.
    pub curvature: Vec<Vec<f64>>,
    /// The number of substeps a frame.
    pub substeps: usize,
    /// What happened on the way that the user should know.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// Something that answers requests. All requests of a list are independent, and the answers are in their order: an
/// implementation may spread them over threads, a device or several machines.
pub(crate) trait Evaluations {
    /// Answers all requests.
    ///
    /// # Errors
    /// [`ErrorKind::Interrupted`]; whatever is no break-down of the physics.
    fn evaluate(&self, requests: &[Request]) -> Result<Vec<Answer>>;
}

/// A forward model with what is free in it and the frames that count.
pub(crate) struct Setting<'a> {
    pub problem: Problem<'a>,
    pub free: Free,
    pub frames: Range<usize>,
    /// The loss that no motion explains: that of a frame of flight.
    pub floor: f64,
}

/// Evaluations side by side on the threads of this machine.
pub(crate) struct Threads<'a, 'b>(pub &'b [Setting<'a>]);

impl Evaluations for Threads<'_, '_> {
    fn evaluate(&self, requests: &[Request]) -> Result<Vec<Answer>> {
        requests.par_iter().map(|request| self.0[request.setting].answer(request)).collect()
    }
}

impl Setting<'_> {
    fn answer(&self, request: &Request) -> Result<Answer> {
        interrupt::check()?;
        let mut substeps = Substeps::least(request.substeps);
        let free = if request.derivatives.is_some() { self.free } else { Free::NOTHING };
        let how = request.derivatives.unwrap_or(Derivatives::Exact);
        let mut frames =
            |free, how| self.problem.linearise_frames(&request.at, free, self.frames.clone(), how, &mut substeps);
        let found = match frames(free, how) {
            // tangents grow beyond all numbers where the motion itself does not
            Err(error) if error.kind() == ErrorKind::NonFinite && request.derivatives.is_some() => {
                frames(Free::NOTHING, Derivatives::Exact)
            }
            found => found,
        };
        let Substeps { count: substeps, mut notes } = substeps;
        match found {
            Ok(frames) => {
                let loss = frames.iter().map(|frame| frame.loss).sum::<f64>() / frames.len().max(1) as f64;
                let Linearised { loss: log_loss, gradient, curvature, .. } = Linearised::mean_log(&frames, self.floor);
                let loss = Some(loss).filter(|_| log_loss.is_finite());
                Ok(Answer { loss, log_loss, gradient, curvature, substeps, notes })
            }
            Err(error) if matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                notes.push(format!("a trial was given up: {error}"));
                Ok(Answer { substeps, notes, ..Answer::default() })
            }
            Err(error) => Err(error),
        }
    }
}
