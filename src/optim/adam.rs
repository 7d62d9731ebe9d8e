//! Adam (Kingma and Ba 2015).

use std::collections::BTreeMap;

use crate::optim::Params;
use crate::{Error, ErrorKind, Result, Tensor};

/// Adam with per-prefix rates. Its moments are plain tensors, so that a checkpoint can hold them.
///
/// `m ← β₁ m + (1−β₁) g`, `v ← β₂ v + (1−β₂) g²`, `x ← x − rate · m̂ / (√v̂ + ε)` with bias-corrected `m̂`, `v̂`.
#[derive(Debug, Clone)]
pub struct Adam {
    /// The rate of paths without one of their own.
    pub rate: f64,
    /// Rates by path prefix; the longest matching prefix counts.
    pub rates: BTreeMap<String, f64>,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Keeps the division finite.
    pub epsilon: f64,
    steps: u64,
    moments: BTreeMap<String, [Tensor; 2]>,
}

impl Adam {
    /// Adam with β = (0.9, 0.999), ε = 1e-8.
    pub fn new(rate: f64) -> Self {
        Self {
            rate,
            rates: BTreeMap::new(),
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            steps: 0,
            moments: BTreeMap::new(),
        }
    }

    /// Gives the paths with this prefix a rate of their own.
    #[must_use]
    pub fn with_rate(mut self, prefix: impl Into<String>, rate: f64) -> Self {
        self.rates.insert(prefix.into(), rate);
        self
    }

    /// One step against the gradients.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] for a gradient that is not finite, naming its path; nothing is changed then.
    pub fn step(&mut self, params: &mut Params, gradients: &BTreeMap<String, Tensor>) -> Result<()> {
        for (path, gradient) in gradients {
            if !gradient.all_finite()? {
                return Err(Error::new(ErrorKind::NonFinite, "the gradient of a parameter is not finite")
                    .at(path)
                    .fix("evaluate once on Tape::with_anomaly_mode() to see which op made it so"));
            }
        }
        self.steps += 1;
        let correction = |beta: f64| 1.0 - beta.powf(self.steps as f64);
        let (c1, c2) = (correction(self.beta1), correction(self.beta2));
        for (path, gradient) in gradients {
            let old = params.get(path)?;
            let (shape, dtype, device) = (old.shape().clone(), old.dtype(), old.device());
            let (mut x, g) = (old.to_vec()?, gradient.to_vec()?);
            let [mut m, mut v] = match self.moments.get(path) {
                Some([m, v]) => [m.to_vec()?, v.to_vec()?],
                None => [vec![0.0; x.len()], vec![0.0; x.len()]],
            };
            let rate = self.rate_of(path);
            for (((x, g), m), v) in x.iter_mut().zip(&g).zip(&mut m).zip(&mut v) {
                *m = self.beta1 * *m + (1.0 - self.beta1) * g;
                *v = self.beta2 * *v + (1.0 - self.beta2) * g * g;
                *x -= rate * (*m / c1) / ((*v / c2).sqrt() + self.epsilon);
            }
            self.moments.insert(path.clone(), [Tensor::from_vec(m, &shape), Tensor::from_vec(v, &shape)]);
            params.set(path.clone(), Tensor::from_vec(x, &shape).cast(dtype)?.to_device(&device)?);
        }
        Ok(())
    }

    fn rate_of(&self, path: &str) -> f64 {
        let matching = self.rates.iter().filter(|(prefix, _)| path.starts_with(prefix.as_str()));
        matching.max_by_key(|(prefix, _)| prefix.len()).map_or(self.rate, |(_, rate)| *rate)
    }

    /// Everything a checkpoint must hold to go on: moments by path and the number of steps.
    pub fn state(&self) -> BTreeMap<String, Tensor> {
        let moments = self.moments.iter().flat_map(|(path, [m, v])| {
            [(format!("adam.first.{path}"), m.clone()), (format!("adam.second.{path}"), v.clone())]
        });
        let steps = Tensor::from_vec(vec![self.steps as f64], [1]);
        moments.chain([("adam.steps".to_owned(), steps)]).collect()
    }

    /// Goes on from a state.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the state is incomplete.
    pub fn restore(&mut self, state: &BTreeMap<String, Tensor>) -> Result<()> {
        let missing = |key: &str| Error::new(ErrorKind::Input, "the optimiser state is incomplete").wanted(key);
        let steps = state.get("adam.steps").ok_or_else(|| missing("adam.steps"))?;
        self.moments.clear();
        for (key, first) in state {
            let Some(path) = key.strip_prefix("adam.first.") else { continue };
            let second = format!("adam.second.{path}");
            let second = state.get(&second).ok_or_else(|| missing(&second))?;
            self.moments.insert(path.to_owned(), [first.clone(), second.clone()]);
        }
        self.steps = steps.item()? as u64;
        Ok(())
    }
}
