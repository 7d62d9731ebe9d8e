//! Evaluations that a search asked for, kept so that an interrupted search can be gone through again without computing them.

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::identify::penalty::add_penalty;
use crate::identify::plausible::Plausible;
use crate::identify::recent::Recent;
use crate::identify::{Evaluation, Free, Linearised, Problem, Unknowns};

/// What one evaluation gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The loss; nothing when the physics broke down.
    pub loss: Option<f64>,
    /// Its gradient, where it was asked for.
    pub gradient: Vec<f64>,
    /// Its curvature, where it was asked for and could be had.
    pub curvature: Vec<Vec<f64>>,
    /// The number of substeps a frame from here on.
    pub substeps: usize,
}

/// Hears of every evaluation; of those that were computed now, not before an interruption, also what they gave. An error
/// from it (an interruption, say) ends a search and is returned.
pub type Listener<'a> = dyn FnMut(&Evaluation, Option<&Answer>) -> Result<()> + 'a;

/// Evaluates a problem, or remembers what it gave: a search is a function of the answers, so that going through the known
/// ones leads exactly to where it stopped.
pub(crate) struct Oracle<'a, 'b> {
    problem: &'a Problem<'a>,
    frames: usize,
    known: &'a [Answer],
    /// The least number of substeps a frame.
    pub substeps: usize,
    each: &'a mut Listener<'b>,
    notes: &'a mut dyn FnMut(String),
    /// How far derivatives reach, in shares of the longest step of a search: [`Problem::secant`] at first.
    reach: f64,
    /// The side to which they reach for each free unknown, by its sign; to both where there is none.
    pub sides: Vec<f64>,
    /// What leaving the plausible range costs; counted as part of the loss.
    pub plausible: Option<Plausible<'a>>,
    /// The linearisation at the first point, and its substeps, if somebody has computed it already.
    pub first: Option<(Linearised, usize)>,
    recent: Recent,
    /// Whether the physics may break down at the first point, too.
    pub lenient: bool,
    /// The evaluation of least loss.
    pub best: Option<Evaluation>,
}

impl<'a, 'b> Oracle<'a, 'b> {
    pub fn new(
        problem: &'a Problem<'a>,
        frames: usize,
        known: &'a [Answer],
        each: &'a mut Listener<'b>,
        notes: &'a mut dyn FnMut(String),
    ) -> Self {
        Self {
            problem,
            frames,
            known,
            substeps: 0,
            each,
            notes,
            reach: problem.secant,
            sides: Vec::new(),
            plausible: None,
            first: None,
            recent: Recent::default(),
            lenient: false,
            best: None,
        }
    }

    /// Loss and gradient by the tape.
    pub fn gradient(&mut self, at: &Unknowns, free: Free) -> Result<Answer> {
        self.ask(at, &mut |problem, frames, substeps, notes| {
            let (loss, gradient) = problem.evaluate(at, free, frames, substeps, notes)?;
            Ok((loss, gradient, Vec::new()))
        })
    }

    /// The loss alone. Where derivatives are differences it is with the substep that these unknowns need, and so the same whatever was tried before:
    /// held at that of a stiffer start, a shorter step damps what a softer one would do, and the search goes on to be stiff.
    pub fn loss(&mut self, at: &Unknowns) -> Result<Option<f64>> {
        if self.problem.secant > 0.0 {
            self.substeps = 0;
        }
        let mut recent = std::mem::take(&mut self.recent);
        let answer = self.ask(at, &mut |problem, frames, substeps, notes| {
            let there = problem.linearise_after(&mut recent, at, Free::NOTHING, frames, substeps, notes)?;
            Ok((there.loss, Vec::new(), Vec::new()))
        });
        self.recent = recent;
        Ok(answer?.loss)
    }

    /// Loss, gradient and curvature by forward mode; without the latter two where tangents grow beyond all numbers.
    pub fn linearised(&mut self, at: &Unknowns, free: Free) -> Result<Answer> {
        let (mut first, reach) = (self.first.take().filter(|_| self.known.is_empty()), self.reach);
        let (sides, mut recent) = (std::mem::take(&mut self.sides), std::mem::take(&mut self.recent));
        let mut linearise = |problem: &Problem<'_>, frames, substeps: &mut usize, notes: &mut dyn FnMut(String)| {
            let Some((linearised, found)) = first.take() else {
                let reaching = problem.reaching(reach, &sides);
                return reaching.linearise_after(&mut recent, at, free, frames, substeps, notes);
            };
            *substeps = found;
            Ok(linearised)
        };
        let answer =
            self.ask(at, &mut |problem, frames, substeps, notes| match linearise(problem, frames, substeps, notes) {
                Ok(Linearised { loss, gradient, curvature, .. }) => Ok((loss, gradient, curvature)),
                Err(error) if error.kind() == ErrorKind::NonFinite => {
                    notes(format!("no derivatives there: {error}"));
                    Ok((problem.misfit(at, frames, substeps, notes)?, Vec::new(), Vec::new()))
                }
                Err(error) => Err(error),
            });
        self.recent = recent;
        answer
    }

    /// Makes derivatives reach a quarter as far from now on, and to both sides next; whether they may.
    pub fn reaches_less(&mut self) -> bool {
        self.sides.clear();
        self.reach /= 4.0;
        self.reach > 0.0 && self.reach > LEAST_REACH * self.problem.secant
    }

    #[expect(clippy::type_complexity, reason = "the three kinds of evaluation, used here only")]
    fn ask(
        &mut self,
        at: &Unknowns,
        compute: &mut dyn FnMut(
            &Problem<'_>,
            usize,
            &mut usize,
            &mut dyn FnMut(String),
        ) -> Result<(f64, Vec<f64>, Vec<Vec<f64>>)>,
    ) -> Result<Answer> {
        let optional = self.lenient || self.best.is_some();
        let (answer, new) = match self.known.split_first() {
            Some((answer, rest)) => {
                self.known = rest;
                self.substeps = answer.substeps;
                (answer.clone(), false)
            }
            None => {
                let mut computed = compute(self.problem, self.frames, &mut self.substeps, self.notes);
                if let (Ok((loss, gradient, curvature)), Some(plausible)) = (&mut computed, &self.plausible) {
                    *loss += add_penalty(plausible.penalty(at), gradient, curvature);
                }
                let (loss, gradient, curvature) = match computed {
                    Ok((loss, gradient, curvature)) if loss.is_finite() => (Some(loss), gradient, curvature),
                    Ok((loss, ..)) if !optional => {
                        return Err(Error::new(ErrorKind::NonFinite, "the loss is not finite where the search starts")
                            .found(loss));
                    }
                    Ok(_) => (None, Vec::new(), Vec::new()),
                    Err(error) if error.kind() == ErrorKind::Physics && optional => {
                        (self.notes)(format!("a trial was given up: {error}"));
                        (None, Vec::new(), Vec::new())
                    }
                    Err(error) => return Err(error),
                };
                (Answer { loss, gradient, curvature, substeps: self.substeps }, true)
            }
        };
        let evaluation = Evaluation { unknowns: at.clone(), loss: answer.loss.unwrap_or(f64::INFINITY) };
        if answer.loss.is_some() && self.best.as_ref().is_none_or(|best| evaluation.loss < best.loss) {
            self.best = Some(evaluation.clone());
        }
        (self.each)(&evaluation, new.then_some(&answer))?;
        Ok(answer)
    }
}

/// The least share of [`Problem::secant`] that derivatives reach in the end.
const LEAST_REACH: f64 = 0.05;
