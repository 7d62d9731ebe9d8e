//! Noise schedule, and the deterministic part of a DDIM step (Ho et al. 2020; Song et al. 2021).

use gradreel::{Error, ErrorKind, Result, Tensor, Var};

/// Number of diffusion times of the training process.
pub const TIMES: usize = 1000;

/// The noise schedule. Tables are in `f32` and computed in the same order as the published buffers.
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// Variance of the noise added at each time.
    pub betas: Vec<f32>,
    /// `1 − β`
    pub alphas: Vec<f32>,
    /// ᾱ, the cumulative product of `alphas`: the remaining signal power.
    pub alphas_cumprod: Vec<f32>,
}

impl Default for Schedule {
    fn default() -> Self {
        Self::published()
    }
}

impl Schedule {
    /// `β_t = (√0.00085 … √0.012)²` in 1000 equal steps of the root.
    pub fn published() -> Self {
        let (first, last) = (0.000_85_f64.sqrt(), 0.012_f64.sqrt());
        let root = |t: usize| first + (last - first) * t as f64 / (TIMES - 1) as f64;
        Self::new((0..TIMES).map(|t| (root(t) * root(t)) as f32).collect())
    }

    /// The schedule for given variances.
    pub fn new(betas: Vec<f32>) -> Self {
        let alphas: Vec<f32> = betas.iter().map(|b| 1.0 - b).collect();
        let product = alphas.iter().scan(1.0f32, |product, a| {
            *product *= a;
            Some(*product)
        });
        Self { alphas_cumprod: product.collect(), alphas, betas }
    }

    /// `√ᾱ_t` and `√(1 − ᾱ_t)`: the weights of signal and noise at a time.
    pub fn weights(&self, time: usize) -> [f64; 2] {
        let left = self.alphas_cumprod[time];
        [f64::from(left.sqrt()), f64::from((1.0 - left).sqrt())]
    }

    /// `x_t = √ᾱ_t x₀ + √(1 − ᾱ_t) ε`, with one time per sample.
    ///
    /// # Errors
    /// If the weights cannot be moved to the device of `x0`.
    ///
    /// # Panics
    /// If the number of times differs from the number of samples, or a time does not exist.
    #[track_caller]
    pub fn add_noise(&self, x0: &Var, noise: &Var, times: &[usize]) -> Result<Var> {
        assert_eq!(times.len(), x0.dims()[0], "add_noise: one time for each sample");
        let mut shape = vec![1; x0.dims().len()];
        shape[0] = times.len();
        let weight = |which: usize| {
            let values: Vec<f64> = times.iter().map(|t| self.weights(*t)[which]).collect();
            super::constant(x0, Tensor::from_vec(values, shape.clone()))
        };
        Ok(&(x0 * &weight(0)?) + &(noise * &weight(1)?))
    }
}

/// Times and weights of a DDIM run with η = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Ddim {
    /// Diffusion time of each index; a run goes from the last index to 0.
    pub times: Vec<usize>,
    /// ᾱ at each index.
    pub alphas: Vec<f32>,
    /// ᾱ at the preceding index; ᾱ₀ for index 0.
    pub alphas_prev: Vec<f32>,
    /// Standard deviation of the noise added in each step.
    pub sigmas: Vec<f32>,
}

impl Ddim {
    /// The table for `steps` steps: times 1, 1 + c, 1 + 2c, … with `c = ⌊1000 / steps⌋`. If `steps` does not divide
    /// 1000, there are `⌈1000 / c⌉` steps.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when `steps` is not within 1..=1000.
    pub fn new(schedule: &Schedule, steps: usize) -> Result<Self> {
        let count = schedule.alphas_cumprod.len();
        if steps == 0 || steps > count {
            return Err(Error::new(ErrorKind::Input, "a sampler cannot take this many steps")
                .found(steps)
                .wanted(format!("1 to {count}"))
                .fix("50 is usual, 200 is thorough"));
        }
        // the last time is one past a multiple and is clamped to the table
        let times: Vec<usize> = (0..count).step_by(count / steps).map(|t| (t + 1).min(count - 1)).collect();
        let alphas: Vec<f32> = times.iter().map(|t| schedule.alphas_cumprod[*t]).collect();
        let mut alphas_prev = vec![schedule.alphas_cumprod[0]];
        alphas_prev.extend(&alphas[..alphas.len() - 1]);
        let sigmas = alphas.iter().zip(&alphas_prev).map(|(&a, &before)| {
            // 1 − ᾱ' is rounded to f32 first, as in the published tables
            let (a, before, noise) = (f64::from(a), f64::from(before), f64::from(1.0 - before));
            (noise / (1.0 - a) * (1.0 - a / before)).sqrt() as f32
        });
        Ok(Self { sigmas: sigmas.collect(), times, alphas, alphas_prev })
    }

    /// Number of steps.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Estimate of the clean latents given a predicted noise ε: `x₀ = (x − √(1−ᾱ) ε) / √ᾱ`.
    ///
    /// # Panics
    /// If the index does not exist or the shapes differ.
    #[track_caller]
    pub fn clean(&self, index: usize, x: &Var, predicted: &Var) -> Var {
        let a = self.alphas[index];
        &(x - &(predicted * f64::from((1.0 - a).sqrt()))) / f64::from(a.sqrt())
    }

    /// One step from `x` at `index` to the preceding index, with the predicted noise ε and fresh noise z. The last
    /// step (index 0) adds no noise.
    ///
    /// `x' = √ᾱ' x₀ + √(1 − ᾱ' − σ²) ε + σ z`, with x₀ of [`Ddim::clean`]
    ///
    /// # Panics
    /// If the index does not exist or the shapes differ.
    #[track_caller]
    pub fn step(&self, index: usize, x: &Var, predicted: &Var, noise: &Var) -> Var {
        let [before, sigma] = [self.alphas_prev[index], self.sigmas[index]];
        let clean = self.clean(index, x, predicted);
        let along = f64::from((1.0 - before - sigma * sigma).max(1e-7).sqrt());
        let next = &(&clean * f64::from(before.sqrt())) + &(predicted * along);
        if index == 0 { next } else { &next + &(noise * f64::from(sigma)) }
    }
}
