//! Learning-rate schedules: pure functions of the number of updates made.

use std::f64::consts::PI;

/// A factor on the learning rate, by the number of updates made before.
///
/// ```
/// use gradreel::optim::Schedule;
///
/// // from 2 % to the whole rate over 100 updates, then along a cosine to a tenth over the next 900
/// let schedule = Schedule::warmup(100, 0.02).then(100, Schedule::cosine(900, 0.1));
/// assert_eq!(schedule.factor(0), 0.02);
/// assert!((schedule.factor(50) - 0.51).abs() < 1e-12);
/// assert_eq!(schedule.factor(100), 1.0);
/// assert!((schedule.factor(550) - 0.55).abs() < 1e-12);
/// assert_eq!(schedule.factor(5000), 0.1);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Schedule(Form);

#[derive(Debug, Clone, PartialEq, Default)]
enum Form {
    #[default]
    Constant,
    Warmup {
        steps: u64,
        from: f64,
    },
    Cosine {
        steps: u64,
        to: f64,
    },
    Step {
        every: u64,
        factor: f64,
    },
    Exponential {
        factor: f64,
    },
    Then {
        first: Box<Form>,
        steps: u64,
        next: Box<Form>,
    },
}

impl Schedule {
    /// Always 1.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert_eq!(Schedule::constant().factor(100), 1.0);
    /// ```
    pub fn constant() -> Self {
        Self::default()
    }

    /// Linear from `from` at the first update to 1 after `steps`: `from + (1 − from) n / steps`, then 1.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert_eq!(Schedule::warmup(10, 0.0).factor(5), 0.5);
    /// ```
    pub fn warmup(steps: u64, from: f64) -> Self {
        Self(Form::Warmup { steps, from })
    }

    /// Half a cosine from 1 to `to` over `steps` updates (Loshchilov and Hutter 2017, without restarts), then `to`:
    /// `to + (1 − to) (1 + cos(π n / steps)) / 2`.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert!((Schedule::cosine(100, 0.0).factor(50) - 0.5).abs() < 1e-12);
    /// ```
    pub fn cosine(steps: u64, to: f64) -> Self {
        Self(Form::Cosine { steps, to })
    }

    /// Multiplied by `factor` every `every` updates: `factor^⌊n / every⌋`.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert_eq!(Schedule::step(10, 0.5).factor(25), 0.25);
    /// ```
    pub fn step(every: u64, factor: f64) -> Self {
        Self(Form::Step { every: every.max(1), factor })
    }

    /// Multiplied by `factor` at every update: `factorⁿ`.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert_eq!(Schedule::exponential(0.5).factor(2), 0.25);
    /// ```
    pub fn exponential(factor: f64) -> Self {
        Self(Form::Exponential { factor })
    }

    /// This schedule for `steps` updates, then `next`, which counts from there.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// let schedule = Schedule::warmup(10, 0.0).then(10, Schedule::exponential(0.5));
    /// assert_eq!(schedule.factor(11), 0.5);
    /// ```
    #[must_use]
    pub fn then(self, steps: u64, next: Self) -> Self {
        Self(Form::Then { first: Box::new(self.0), steps, next: Box::new(next.0) })
    }

    /// The factor for the next update after `steps` were made.
    ///
    /// ```
    /// use gradreel::optim::Schedule;
    /// assert_eq!(Schedule::step(10, 0.5).factor(9), 1.0);
    /// ```
    pub fn factor(&self, steps: u64) -> f64 {
        self.0.factor(steps)
    }
}

impl Form {
    fn factor(&self, n: u64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Warmup { steps, from } if n < *steps => from + (1.0 - from) * n as f64 / *steps as f64,
            Self::Warmup { .. } => 1.0,
            Self::Cosine { steps, to } if n < *steps => {
                to + (1.0 - to) * 0.5 * (1.0 + (PI * n as f64 / *steps as f64).cos())
            }
            Self::Cosine { to, .. } => *to,
            Self::Step { every, factor } => factor.powf((n / every) as f64),
            Self::Exponential { factor } => factor.powf(n as f64),
            Self::Then { first, steps, .. } if n < *steps => first.factor(n),
            Self::Then { steps, next, .. } => next.factor(n - steps),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_those_of_the_formulas() {
        let cosine = Schedule::cosine(4, 0.2);
        let found: Vec<_> = (0..6).map(|n| cosine.factor(n)).collect();
        let half = 0.5f64.sqrt();
        let wanted = [1.0, 0.6 + 0.4 * half, 0.6, 0.6 - 0.4 * half, 0.2, 0.2];
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let step = Schedule::step(3, 0.5);
        assert_eq!([0, 2, 3, 6].map(|n| step.factor(n)), [1.0, 1.0, 0.5, 0.25]);
        let exponential = Schedule::exponential(0.5).then(2, Schedule::constant());
        assert_eq!([0, 1, 2, 9].map(|n| exponential.factor(n)), [1.0, 0.5, 1.0, 1.0]);
        assert_eq!(Schedule::warmup(0, 0.5).factor(0), 1.0);
    }
}
