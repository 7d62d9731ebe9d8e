//! One hypothesis: a family of materials and where its unknowns are.

use serde::{Deserialize, Serialize};

use crate::identify::{Free, Unknowns};
use crate::physics::Law;

/// What may have been filmed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Hypothesis {
    /// The family of its material, or the name of its law.
    pub family: String,
    /// Where its unknowns are.
    pub unknowns: Unknowns,
    /// The loss there; nothing before it was evaluated, and where the physics broke down.
    pub loss: Option<f64>,
    /// The negative logarithm of its posterior density there \[nat\].
    pub cost: Option<f64>,
}

impl Hypothesis {
    /// One that was not evaluated yet.
    pub fn new(family: &str, unknowns: Unknowns) -> Self {
        Self { family: family.to_owned(), unknowns, loss: None, cost: None }
    }
}

/// Two hypotheses of a family are one if all their coordinates are nearer than this.
const APART: f64 = 0.15;

/// The best hypotheses, at most `count` of each family in the order of their costs, that lie apart and whose losses are
/// at most `times` that of the best of all. Those that could not be simulated go.
pub(crate) fn apart<'a>(
    mut all: Vec<Hypothesis>,
    count: usize,
    times: f64,
    of: &dyn Fn(&str) -> (&'a Law, Free),
) -> Vec<Hypothesis> {
    let cost = |hypothesis: &Hypothesis| hypothesis.cost.unwrap_or(f64::INFINITY);
    all.retain(|hypothesis| cost(hypothesis).is_finite());
    all.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let loss = |hypothesis: &Hypothesis| hypothesis.loss.unwrap_or(f64::INFINITY);
    let least = all.iter().map(loss).fold(f64::INFINITY, f64::min);
    let mut chosen: Vec<Hypothesis> = Vec::new();
    for hypothesis in all {
        let (law, free) = of(&hypothesis.family);
        let x = hypothesis.unknowns.coordinates(law, free);
        let alike = |other: &&Hypothesis| other.family == hypothesis.family;
        let near = |other: &Hypothesis| {
            let there = other.unknowns.coordinates(law, free);
            there.iter().zip(&x).all(|(a, b)| (a - b).abs() < APART)
        };
        let places = chosen.iter().filter(alike).count() < count;
        if places && loss(&hypothesis) <= times * least && !chosen.iter().filter(alike).any(near) {
            chosen.push(hypothesis);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    #[test]
    fn the_best_that_lie_apart_go_on() {
        let law = materials::find("neo_hookean").unwrap();
        let of = |young: f64, cost: f64| Hypothesis {
            cost: Some(cost),
            loss: Some(cost),
            ..Hypothesis::new("elastic", Unknowns { parameters: vec![young, 0.3], ..Unknowns::default() })
        };
        let broken = Hypothesis { cost: None, loss: None, ..of(1e3, 0.0) };
        let all = vec![of(1e5, 2.0), of(1.1e5, 1.0), of(1e4, 3.0), of(1e6, 4.0), of(1e7, 99.0), broken];
        let costs = |count, times| {
            let chosen = apart(all.clone(), count, times, &|_| (&law, Free::Material));
            chosen.iter().map(|hypothesis| hypothesis.cost.unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(costs(9, 1e3), [1.0, 3.0, 4.0, 99.0], "the near one, and what broke down, are left out");
        assert_eq!(costs(2, 1e3), [1.0, 3.0]);
        assert_eq!(costs(9, 3.5), [1.0, 3.0]);
    }
}
