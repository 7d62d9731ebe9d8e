//! An elastic law stores what work it is given: a closed cycle of deformation takes none.

use std::f64::consts::TAU;

use super::MaterialCheck;
use super::response::{Matrix, Subject};
use crate::physics::law::Law;
use crate::vector::{inverse, product};

/// Steps of a cycle; the sum over a smooth cycle converges faster than any power of them.
const STEPS: usize = 2048;

/// The work of a cycle, as a share of the work that goes to and fro.
pub(super) fn check(law: &Law) -> MaterialCheck {
    const NAME: &str = "energy in a closed cycle";
    if !law.is_elastic() {
        return MaterialCheck::skipped(NAME, "the law is not elastic");
    }
    if !law.stores_energy() {
        return MaterialCheck::skipped(NAME, "the law says that it has no energy");
    }
    let subject = Subject::new(law);
    let shape = |k: usize, phase: f64| 0.12 * (1.3 * k as f64 + phase).sin();
    let at = |angle: f64| -> [Matrix; 2] {
        let f = |k: usize| {
            let rest = if k.is_multiple_of(4) { 1.0 } else { 0.0 };
            rest + shape(k, 0.4) * angle.cos() + shape(k, 2.9) * angle.sin()
        };
        let slope = |k: usize| shape(k, 2.9) * angle.cos() - shape(k, 0.4) * angle.sin();
        [std::array::from_fn(f), std::array::from_fn(slope)]
    };
    let (mut work, mut moved) = (0.0, 0.0);
    for step in 0..STEPS {
        let [f, slope] = at(TAU * step as f64 / STEPS as f64);
        // τ : Ḟ F⁻¹
        let rate = product(rows(slope), inverse(rows(f)));
        let power: f64 = subject.still_stress(f).iter().zip(rate.as_flattened()).map(|(tau, d)| tau * d).sum();
        work += power;
        moved += power.abs();
    }
    let found = (work / moved.max(f64::MIN_POSITIVE)).abs();
    MaterialCheck { name: NAME, found, allowed: 1e-5, note: "work of a cycle".to_owned() }
}

fn rows(flat: Matrix) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| flat[3 * i + j]))
}
