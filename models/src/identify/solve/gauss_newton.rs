//! Gauss–Newton on the posterior: a search that asks for evaluations and is told their answers.

use super::evaluations::{Answer, Request};
use super::step::{damped, promised};
use crate::identify::Unknowns;
use crate::identify::model::linearise::Derivatives;
use crate::identify::uncertainty::prior::Prior;

/// Damping of a first step, and its limits.
const DAMPING: f64 = 1e-3;
const DAMPINGS: [f64; 2] = [1e-6, 1e6];

/// Trials of one step at most, each shorter.
const TRIALS: usize = 5;

/// A search ends when a step gains less than this \[nat\].
const LITTLE: f64 = 0.05;

/// A step that keeps this share of its promise is followed on, twice as far each time while that gains as well: where pictures
/// change only at the edges of things, a step is too short.
const KEPT: f64 = 0.75;

/// How many times its length a step is followed at most.
const FARTHEST: f64 = 16.0;

/// Minimises `Σ ½ n ln L(x) + ½ (x − m)ᵀ P⁻¹ (x − m)`, the negative logarithm of the posterior density where each frame has `n` residuals of
/// an unknown deviation, by Levenberg and Marquardt's method: a step solves `(H + μ diag H) h = −g` with `H = Σ n C/2L + P⁻¹`
/// from the normal equations of every frame; `μ` follows how well steps keep what they promise (Nielsen 1999).
///
/// It does not evaluate anything: [`GaussNewton::next`] asks, [`GaussNewton::take`] is told.
#[derive(Debug, Clone)]
pub(crate) struct GaussNewton<'a> {
    prior: Prior<'a>,
    setting: usize,
    residuals: f64,
    steps: usize,
    derivatives: Derivatives,
    start: Unknowns,
    here: Point,
    slopes: Option<(Vec<f64>, Vec<Vec<f64>>)>,
    damping: f64,
    growth: f64,
    taken: usize,
    substeps: usize,
    state: State,
}

/// A place with its loss, and the negative logarithm of the posterior there.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub x: Vec<f64>,
    pub unknowns: Unknowns,
    pub loss: f64,
    pub cost: f64,
}

#[derive(Debug, Clone)]
enum State {
    /// Asks for the normal equations where it is.
    Linearise,
    /// Tries a step, for the so-manieth time.
    Try {
        step: Vec<f64>,
        promised: f64,
        trial: usize,
    },
    /// Follows a step that kept its promise, so many times its length.
    Further {
        from: Vec<f64>,
        step: Vec<f64>,
        far: f64,
        gained: f64,
    },
    Ended,
}

impl<'a> GaussNewton<'a> {
    /// A search of at most `steps` steps from a start; without any, only the cost there is found.
    pub fn new(prior: Prior<'a>, setting: usize, residuals: f64, steps: usize, start: &Unknowns) -> Self {
        let x = start.coordinates(prior.law, prior.free);
        let here = Point { x, unknowns: start.clone(), loss: f64::INFINITY, cost: f64::INFINITY };
        let state = State::Linearise;
        let (slopes, damping, growth, taken, substeps) = (None, DAMPING, 2.0, 0, 0);
        let start = start.clone();
        let derivatives = Derivatives::Exact;
        Self {
            prior,
            setting,
            residuals,
            steps,
            derivatives,
            start,
            here,
            slopes,
            damping,
            growth,
            taken,
            substeps,
            state,
        }
    }

    /// The same with differences over a share of its longest step in place of exact derivatives; 0 keeps those.
    #[must_use]
    pub fn reaching(mut self, share: f64) -> Self {
        self.derivatives = Derivatives::reaching(share);
        self
    }

    /// The best point so far.
    pub fn best(&self) -> &Point {
        &self.here
    }

    /// The next evaluation that the search needs; nothing once it has ended.
    pub fn next(&self) -> Option<Request> {
        let ask = |x: &[f64], derivatives: bool| Request {
            setting: self.setting,
            at: self.start.moved(self.prior.law, self.prior.free, x),
            derivatives: derivatives.then_some(self.derivatives),
            substeps: if derivatives { 0 } else { self.substeps },
        };
        match &self.state {
            State::Linearise => Some(ask(&self.here.x, self.steps > 0 && !self.here.x.is_empty())),
            State::Try { step, .. } => Some(ask(&self.along(&self.here.x, step, 1.0), false)),
            State::Further { from, step, far, .. } => Some(ask(&self.along(from, step, *far), false)),
            State::Ended => None,
        }
    }

    /// Takes the answer to what was asked last.
    pub fn take(&mut self, answer: &Answer) {
        let loss = answer.loss.unwrap_or(f64::INFINITY);
        self.state = match std::mem::replace(&mut self.state, State::Ended) {
            State::Linearise => self.linearised(loss, answer),
            State::Try { step, promised, trial } => self.tried(answer, step, promised, trial),
            State::Further { from, step, far, gained } => {
                let there = self.point(self.along(&from, &step, far), loss, answer.log_loss);
                let more = self.here.cost - there.cost;
                if more <= 0.0 {
                    self.go_on(gained)
                } else {
                    self.here = there;
                    // it was damped too much
                    self.damping = (self.damping / 4.0).max(DAMPINGS[0]);
                    self.follow(from, step, 2.0 * far, gained + more)
                }
            }
            State::Ended => State::Ended,
        };
    }

    fn linearised(&mut self, loss: f64, answer: &Answer) -> State {
        // the step of the simulation that the unknowns need here: that of a stiffer start would damp the motion
        self.substeps = answer.substeps;
        self.here = self.point(self.here.x.clone(), loss, answer.log_loss);
        if !self.here.cost.is_finite() || answer.curvature.is_empty() {
            return State::Ended;
        }
        let share = 0.5 * self.residuals;
        let (_, pull) = self.prior.cost(&self.here.x);
        let gradient = answer.gradient.iter().zip(pull).map(|(g, pull)| share * g + pull).collect();
        let entry = |i: usize, j: usize| share * answer.curvature[i][j] + self.prior.precision[(i, j)];
        let n = self.here.x.len();
        let hessian = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
        self.slopes = Some((gradient, hessian));
        self.step(0)
    }

    /// The step of the current damping, to be tried.
    fn step(&self, trial: usize) -> State {
        let Some((gradient, hessian)) = &self.slopes else { return State::Ended };
        let longest = self.prior.longest_step(&self.here.unknowns);
        let Some(step) = damped(gradient, hessian, self.damping, &longest) else { return State::Ended };
        let moved = self.along(&self.here.x, &step, 1.0);
        let step: Vec<f64> = moved.iter().zip(&self.here.x).map(|(moved, x)| moved - x).collect();
        let promised = promised(gradient, hessian, &step);
        if promised < LITTLE {
            return State::Ended;
        }
        State::Try { step, promised, trial }
    }

    fn tried(&mut self, answer: &Answer, step: Vec<f64>, promised: f64, trial: usize) -> State {
        let from = self.here.x.clone();
        let loss = answer.loss.unwrap_or(f64::INFINITY);
        let there = self.point(self.along(&from, &step, 1.0), loss, answer.log_loss);
        let gained = self.here.cost - there.cost;
        if gained > 0.0 {
            let kept = gained / promised;
            self.damping *= (1.0f64 / 3.0).max(1.0 - (2.0 * kept - 1.0).powi(3));
            self.damping = self.damping.clamp(DAMPINGS[0], DAMPINGS[1]);
            self.growth = 2.0;
            self.here = there;
            return if kept > KEPT { self.follow(from, step, 2.0, gained) } else { self.go_on(gained) };
        }
        // twice as much at first, then more and more
        self.damping = (self.damping * 4.0 * self.growth).clamp(0.1, DAMPINGS[1]);
        self.growth *= 2.0;
        if trial + 1 < TRIALS { self.step(trial + 1) } else { State::Ended }
    }

    /// On along a step that has gained so much.
    fn follow(&mut self, from: Vec<f64>, step: Vec<f64>, far: f64, gained: f64) -> State {
        let ends = far > FARTHEST || self.along(&from, &step, far) == self.here.x;
        if ends { self.go_on(gained) } else { State::Further { from, step, far, gained } }
    }

    /// After a step that gained so much.
    fn go_on(&mut self, gained: f64) -> State {
        self.taken += 1;
        let ends = self.taken >= self.steps || gained < LITTLE;
        if ends { State::Ended } else { State::Linearise }
    }

    fn point(&self, x: Vec<f64>, loss: f64, log_loss: f64) -> Point {
        let (prior, _) = self.prior.cost(&x);
        let data = 0.5 * self.residuals * log_loss;
        let unknowns = self.start.moved(self.prior.law, self.prior.free, &x);
        Point { x, unknowns, loss, cost: if loss.is_finite() { data + prior } else { f64::INFINITY } }
    }

    /// `x + far h`, no further beyond the limits than `x` is.
    fn along(&self, x: &[f64], step: &[f64], far: f64) -> Vec<f64> {
        let limits = self.prior.limits();
        let within = |((x, h), [low, high]): ((&f64, &f64), &[f64; 2])| (x + far * h).clamp(low.min(*x), high.max(*x));
        x.iter().zip(step).zip(&limits).map(within).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::Free;
    use crate::identify::solve::{Evaluations, drive};
    use crate::physics::materials;
    use gradreel::{Error, ErrorKind, Result};

    /// Answers as a clip would whose residuals are `A (x − x̂)` and a constant: a valley of the given condition.
    struct Valley {
        centre: [f64; 2],
        stiff: [f64; 2],
        /// Nothing can be simulated beyond this first coordinate.
        wall: f64,
    }

    impl Evaluations for Valley {
        fn evaluate(&self, requests: &[Request]) -> Result<Vec<Answer>> {
            let law = materials::find("neo_hookean").unwrap();
            let answer = |request: &Request| {
                let x = request.at.coordinates(&law, Free::Material);
                if x[0] > self.wall {
                    return Answer::default();
                }
                // along (1, 1) and (1, −1)
                let off = [x[0] - self.centre[0], x[1] - self.centre[1]];
                let r = [off[0] + off[1], off[0] - off[1]];
                let loss = 0.01 + self.stiff[0] * r[0] * r[0] + self.stiff[1] * r[1] * r[1];
                let [a, b] = self.stiff;
                let gradient = vec![2.0 * (a * r[0] + b * r[1]) / loss, 2.0 * (a * r[0] - b * r[1]) / loss];
                let curvature =
                    [[a + b, a - b], [a - b, a + b]].map(|row| row.map(|c| 2.0 * c / loss).to_vec()).to_vec();
                let asked = request.derivatives.is_some();
                Answer {
                    loss: Some(loss),
                    log_loss: loss.ln(),
                    gradient: if asked { gradient } else { vec![] },
                    curvature: if asked { curvature } else { vec![] },
                    ..Answer::default()
                }
            };
            Ok(requests.iter().map(answer).collect())
        }
    }

    fn search<'a>(law: &'a crate::physics::Law, residuals: f64, steps: usize, young: f64) -> GaussNewton<'a> {
        let start = Unknowns { parameters: vec![young, 0.3], ..Unknowns::default() };
        GaussNewton::new(Prior::of(law, Free::Material, &start, None), 0, residuals, steps, &start)
    }

    const VALLEY: Valley = Valley { centre: [4.2, 0.1], stiff: [1.0, 0.02], wall: f64::INFINITY };

    #[test]
    fn a_search_ends_at_the_least_cost() {
        let law = materials::find("neo_hookean").unwrap();
        let mut searches = [search(&law, 100.0, 40, 1e6), search(&law, 100.0, 40, 2e4)];
        drive(&VALLEY, &mut searches, &[], &mut |_, _| Ok(())).unwrap();
        let [a, b] = searches.map(|search| search.best().clone());
        assert!((a.cost - b.cost).abs() < 0.1, "{} {}", a.cost, b.cost);
        assert!((a.x[0] - 4.2).abs() < 0.1, "{:?}", a.x);
        // few pictures know less than the prior
        let mut few = [search(&law, 0.1, 40, 1e6)];
        drive(&VALLEY, &mut few, &[], &mut |_, _| Ok(())).unwrap();
        assert!(few[0].best().x[0] > 4.6, "{:?}", few[0].best().x);
    }

    #[test]
    fn no_step_is_taken_where_none_is_allowed_or_nothing_can_be_simulated() {
        let law = materials::find("neo_hookean").unwrap();
        let mut none = [search(&law, 100.0, 0, 1e6)];
        let mut asked = Vec::new();
        let mut each = |requests: &[Request], _: Option<&[Answer]>| {
            asked.extend(requests.iter().map(|request| request.derivatives.is_some()));
            Ok(())
        };
        drive(&VALLEY, &mut none, &[], &mut each).unwrap();
        assert_eq!(asked, [false]);
        assert!(none[0].best().cost.is_finite());
        let broken = Valley { wall: 0.0, ..VALLEY };
        let mut lost = [search(&law, 100.0, 5, 1e6)];
        drive(&broken, &mut lost, &[], &mut |_, _| Ok(())).unwrap();
        assert_eq!(lost[0].best().cost, f64::INFINITY);
        // a wall on the way is stepped back from
        let near = Valley { centre: [5.6, 0.1], stiff: [1.0, 1.0], wall: 5.5 };
        let mut stopped = [search(&law, 100.0, 20, 1e5)];
        drive(&near, &mut stopped, &[], &mut |_, _| Ok(())).unwrap();
        let x = stopped[0].best().x[0];
        assert!(x > 5.2 && x <= 5.5, "{x}");
    }

    /// With the answers of before an interruption it ends where it would have ended, and only what is missing is evaluated.
    #[test]
    fn a_search_goes_on_where_it_was_interrupted() {
        let law = materials::find("neo_hookean").unwrap();
        let begin = || [search(&law, 100.0, 9, 1e6), search(&law, 100.0, 3, 2e4)];
        let (mut whole, mut all) = (begin(), Vec::new());
        let mut keep = |_: &[Request], answers: Option<&[Answer]>| {
            all.push(answers.unwrap().to_vec());
            Ok(())
        };
        drive(&VALLEY, &mut whole, &[], &mut keep).unwrap();
        for stop in 0..all.len() {
            let known: Vec<Answer> = all[..stop].iter().flatten().cloned().collect();
            let (mut again, mut new) = (begin(), 0);
            let mut count = |_: &[Request], answers: Option<&[Answer]>| {
                new += usize::from(answers.is_some());
                Ok(())
            };
            drive(&VALLEY, &mut again, &known, &mut count).unwrap();
            assert_eq!(new, all.len() - stop);
            for (a, b) in again.iter().zip(&whole) {
                assert_eq!(a.best().x, b.best().x);
            }
        }
        let mut each = |_: &[Request], _: Option<&[Answer]>| Err(Error::new(ErrorKind::Interrupted, "stopped"));
        assert_eq!(drive(&VALLEY, &mut begin(), &[], &mut each).unwrap_err().kind(), ErrorKind::Interrupted);
    }
}
