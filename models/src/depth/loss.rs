//! What a prediction costs.

use gradreel::{Tape, Tensor, Var};

use super::batch::Batch;
use super::network::Prediction;
use super::picture::SIZE;

/// Weights of the parts of the loss.
const DEPTH: f64 = 3.0;
const SHAPE: f64 = 3.0;
const OVERLAP: f64 = 2.0;
const SLOPES: f64 = 4.0;
const DIFFERENCES: f64 = 2.0;
/// Distances of the pixels whose differences in depth are compared.
const APART: [usize; 3] = [1, 4, 12];
/// Range of the logarithms of the errors.
pub(super) const LOG_ERRORS: [f64; 2] = [-5.5, 1.0];
/// Volume that keeps the quotient of overlaps finite \[D · pixels\].
const EMPTY: f64 = 1e-3;

/// The loss of a batch, and its parts for display.
pub(crate) struct Loss {
    pub total: Var,
    /// Mean absolute error of the front \[D\].
    pub front: Var,
    /// Mean of 1 − IoU along parallel rays.
    pub apart: Var,
}

/// The loss of a prediction, with `e = |ẑ − z|` of front and back and the front's error `d = ẑ − z`:
///
/// ```text
/// ⟨e⁰ exp(−s) + s⟩ + 3 ⟨e⟩         over both layers; e⁰ = e as a constant, so that s alone learns from the first part
/// + 3 ⟨|d − ⟨d⟩|⟩                  the front up to a shift
/// + 2 (1 − IoU)                    along parallel rays, of each picture
/// + 4 ⟨|slope of the front|⟩       said apart
/// + 2 Σ ⟨|d(x) − d(x + k)|⟩        k = 1, 4, 12 pixels to the right and downwards
/// ```
///
/// with means `⟨·⟩` over the pixels where the truth is known; `s` is the logarithm of the error that the network expects
/// (a Laplace distribution).
pub(crate) fn loss(tape: &Tape, said: &Prediction, batch: &Batch) -> Loss {
    let truth = Truth::on(tape, batch);
    let likelihood =
        truth.likelihood(&said.front, 0, &said.log_errors[0]) + truth.likelihood(&said.back, 1, &said.log_errors[1]);
    let apart = truth.overlap(said);
    let total = likelihood + truth.distance(said) + &apart * OVERLAP;
    let front = Var::map_n("depth_error", [&said.front.detach(), &truth.depths[0], &truth.weights], |[z, truth, w]| {
        w * (z - truth).abs()
    });
    Loss { total, front: front.sum_all(), apart: apart.detach() }
}

/// A batch's truth as constants.
struct Truth {
    depths: [Var; 2],
    mask: Var,
    weights: Var,
    slopes: [Var; 2],
}

impl Truth {
    fn on(tape: &Tape, batch: &Batch) -> Self {
        let constant = |x: &Tensor| tape.constant(x.clone());
        Self {
            depths: batch.depths.each_ref().map(constant),
            mask: constant(&batch.mask),
            weights: constant(&batch.weights),
            slopes: batch.slopes.each_ref().map(constant),
        }
    }

    /// Negative logarithm of the likelihood of a layer's errors, from which their expected size is learnt alone.
    fn likelihood(&self, depth: &Var, layer: usize, log_error: &Var) -> Var {
        let operands = [&depth.detach(), &self.depths[layer], log_error, &self.weights];
        Var::map_n("depth_likelihood", operands, |[z, truth, s, w]| {
            let s = s.clamp(LOG_ERRORS[0], LOG_ERRORS[1]);
            w * ((z - truth).abs() * (-s).exp() + s)
        })
        .sum_all()
    }

    /// Errors of the layers themselves, of the front up to a shift, of its slopes and of its differences.
    fn distance(&self, said: &Prediction) -> Var {
        let Self { depths: [front, back], mask, weights, slopes: [slopes, counted] } = self;
        let operands = [&said.front, &said.back, front, back, weights];
        let layers = Var::map_n("depth_layers", operands, |[f, b, tf, tb, w]| w * ((f - tf).abs() + (b - tb).abs()));
        let error = &said.front - front;
        let batch = error.dims()[0];
        let shift = Var::map_n("depth_weighted", [&error, weights], |[d, w]| w * d).sum(&[1, 2]) * batch as f64;
        let shift = shift.reshape([batch, 1, 1]);
        let shape = Var::map_n("depth_shape", [&error, &shift, weights], |[d, mean, w]| w * (d - mean).abs());
        let slopes = Var::map_n("depth_slopes", [&said.slopes, slopes, counted], |[a, b, w]| w * (a - b).abs());
        let differences = APART
            .into_iter()
            .flat_map(|apart| [1, 2].map(|axis| differences(&error, mask, axis, apart)))
            .reduce(|a, b| a + b)
            .expect("there are distances");
        layers.sum_all() * DEPTH + shape.sum_all() * SHAPE + slopes.sum_all() * SLOPES + differences * DIFFERENCES
    }

    /// Mean of 1 − IoU between said and true bodies along parallel rays.
    fn overlap(&self, said: &Prediction) -> Var {
        let [front, back] = &self.depths;
        let operands = [&said.front, &said.back, front, back, &self.mask];
        let volume = |x: Var| x.sum(&[1, 2]);
        let common =
            volume(Var::map_n("depth_common", operands, |[f, b, tf, tb, m]| m * (b.min(tb) - f.max(tf)).max(0.0)));
        let both = volume(Var::map_n("depth_both", operands, |[f, b, tf, tb, m]| m * ((b - f).max(0.0) + tb - tf)));
        let united = both - &common;
        1.0 - ((common + EMPTY) / (united + EMPTY)).mean_all()
    }
}

/// Mean absolute difference of the errors of pixels so far apart along an axis, where both are known.
fn differences(error: &Var, mask: &Var, axis: usize, apart: usize) -> Var {
    let ends = |x: &Var| [x.slice(axis, apart..SIZE), x.slice(axis, 0..SIZE - apart)];
    let ([a, b], [p, q]) = (ends(error), ends(mask));
    let known = p * q;
    let sum = Var::map_n("depth_difference", [&a, &b, &known], |[a, b, m]| m * (a - b).abs()).sum_all();
    sum / (known.sum_all() + 1.0)
}

#[cfg(test)]
mod tests {
    use gradreel::{DType, GradCheck, Key};

    use super::*;
    use crate::depth::camera::Attitude;
    use crate::depth::sample::{Kind, Sample};
    use crate::depth::testing::boxed;

    fn batch() -> Batch {
        let solid = boxed([0.5, 0.2, 0.3]);
        let draw = |n| Sample::draw(&solid, Key::new(n), Kind::Exact(Attitude::Free)).unwrap();
        Batch::of(&[draw(1), draw(2)])
    }

    fn wide(batch: &Batch) -> Batch {
        let wide = |x: &Tensor| x.cast(DType::F64).unwrap();
        Batch {
            features: wide(&batch.features),
            depths: batch.depths.each_ref().map(wide),
            mask: wide(&batch.mask),
            weights: wide(&batch.weights),
            slopes: batch.slopes.each_ref().map(wide),
        }
    }

    /// Of the truth with errors as small as can be said, all parts are 0 but the logarithm.
    #[test]
    fn the_truth_costs_nothing() {
        let batch = batch();
        let tape = Tape::new();
        let [front, back] = batch.depths.each_ref().map(|x| tape.leaf(x.clone()));
        let log = || tape.leaf(Tensor::full(-6.0, [2, SIZE, SIZE], DType::F32));
        let slopes = tape.leaf(batch.slopes[0].clone());
        let said = Prediction { front, back, log_errors: [log(), log()], slopes };
        let found = loss(&tape, &said, &batch);
        assert!((found.total.item().unwrap() - 2.0 * LOG_ERRORS[0]).abs() < 1e-4, "{}", found.total.item().unwrap());
        assert!(found.front.item().unwrap() == 0.0 && found.apart.item().unwrap().abs() < 1e-6);
    }

    /// A body moved by δ: closed forms of the error, of the overlap and of what does not see a shift.
    #[test]
    fn a_shift_costs_what_the_formula_says() {
        let batch = batch();
        let tape = Tape::new();
        let shift = 0.05;
        let [front, back] = batch.depths.each_ref().map(|x| tape.leaf(x.clone()) + shift);
        let log = || tape.leaf(Tensor::full(0.0, [2, SIZE, SIZE], DType::F32));
        let said = Prediction { front, back, log_errors: [log(), log()], slopes: tape.leaf(batch.slopes[0].clone()) };
        let found = loss(&tape, &said, &batch);
        let [near, far] = batch.depths.each_ref().map(|x| x.slice::<f32>());
        let mut wanted = 0.0;
        for picture in 0..2 {
            let (mut common, mut united) = (EMPTY, EMPTY);
            for pixel in picture * SIZE * SIZE..(picture + 1) * SIZE * SIZE {
                if batch.mask.slice::<f32>()[pixel] > 0.0 {
                    let thick = f64::from(far[pixel] - near[pixel]);
                    common += (thick - shift).max(0.0);
                    united += 2.0 * thick - (thick - shift).max(0.0);
                }
            }
            wanted += 0.5 * (1.0 - common / united);
        }
        assert!((found.apart.item().unwrap() - wanted).abs() < 1e-4);
        assert!((found.front.item().unwrap() - shift).abs() < 1e-5);
        // expected errors of 1 for errors of δ
        let total = 2.0 * (DEPTH * shift + shift) + OVERLAP * wanted;
        assert!((found.total.item().unwrap() - total).abs() < 1e-3, "{} not {total}", found.total.item().unwrap());
    }

    /// Derivatives against finite differences, away from the kinks: of the depths and slopes, and of the expected errors.
    #[test]
    fn derivatives_are_right() {
        let batch = wide(&batch());
        let (shape, half) = ([2, SIZE, SIZE], [2, 2, SIZE / 2, SIZE / 2]);
        // depths off the truth by more than the steps of the check
        let off = |key: u64, truth: &Tensor| {
            let noise = Tensor::uniform(Key::new(key), shape, DType::F64);
            let values = truth.slice::<f64>().iter().zip(noise.slice::<f64>());
            Tensor::from_vec(values.map(|(t, u)| t + 0.02 + 0.1 * u).collect(), shape)
        };
        let [front, back] = [off(1, &batch.depths[0]), off(2, &batch.depths[1])];
        let slopes = Tensor::uniform(Key::new(3), half, DType::F64);
        let logs = Tensor::uniform(Key::new(4), shape, DType::F64);
        let check = GradCheck { entries: 12, tolerance: 1e-5, ..GradCheck::default() };
        let depths = check
            .function("depths", &[("front", front.clone()), ("back", back), ("slopes", slopes)], |tape, x| {
                let log = || tape.constant(logs.clone());
                let [front, back, slopes] = [0, 1, 2].map(|k| x[k].clone());
                let said = Prediction { front, back, log_errors: [log(), log()], slopes };
                let truth = Truth::on(tape, &batch);
                Ok(truth.distance(&said) + truth.overlap(&said))
            })
            .unwrap();
        assert!(depths.passed(), "{depths}");
        let errors = check
            .function("errors", &[("logarithms", logs.clone())], |tape, x| {
                Ok(Truth::on(tape, &batch).likelihood(&tape.constant(front.clone()), 0, &x[0]))
            })
            .unwrap();
        assert!(errors.passed(), "{errors}");
    }
}
