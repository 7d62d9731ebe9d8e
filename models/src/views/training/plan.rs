//! What is trained, and how.

use gradreel::optim::{Adam, Clip, Schedule};

/// How the model is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Prefixes of trained weights, each with its learning rate. All others are frozen.
    pub trained: Vec<(String, f64)>,
    /// Decoupled weight decay (AdamW).
    pub weight_decay: f64,
    /// Steps of the linear warm-up from 2 % to the full learning rate.
    pub warmup: u64,
    /// Steps of the half-cosine decay to a tenth of the learning rate; `None` keeps it constant.
    pub cooldown: Option<u64>,
    /// Maximum gradient norm; larger gradients are scaled down.
    pub clip: Option<f64>,
    /// Number of predicted views per sample. They share the volume, so that more views cost less than more samples.
    pub targets: usize,
    /// Samples of a batch that are evaluated together; gradients of the groups are accumulated, so that a batch of
    /// any size fits into memory. The result does not depend on it except for rounding.
    pub at_once: usize,
    /// Number of groups evaluated concurrently, each with its own memory. On a CPU with small networks, the number
    /// of cores keeps all of them busy.
    pub side_by_side: usize,
    /// Whether network blocks are recomputed in the backward pass: less memory at the cost of one more forward
    /// pass.
    pub recomputed: bool,
    /// Decay of a running average of the trained weights; `None` keeps none.
    pub average: Option<f64>,
    /// Probability of each of four ways of dropping conditions: all, image latent, volumes, token. Required to
    /// train classifier-free guidance.
    pub dropped: f64,
    /// Seed of times, noise, target views and dropped conditions.
    pub seed: u64,
}

impl Plan {
    /// The published training: depth-wise attention at 5e-5, volume path at 5e-4, AdamW with decay 0.01, a warm-up
    /// of 100 steps, no average, no dropped conditions. (Published batches have 192 samples, for 80 000 steps.)
    pub fn published() -> Self {
        let trained = [
            ("model.diffusion_model.middle_conditions", 5e-5),
            ("model.diffusion_model.output_conditions", 5e-5),
            ("spatial_volume", 5e-4),
            ("time_embed", 5e-4),
        ];
        Self {
            trained: trained.map(|(prefix, rate)| (prefix.to_owned(), rate)).to_vec(),
            weight_decay: 0.01,
            warmup: 100,
            cooldown: None,
            clip: None,
            targets: 1,
            at_once: 1,
            side_by_side: 1,
            recomputed: true,
            average: None,
            dropped: 0.0,
            seed: 0,
        }
    }

    /// Training of the spatial-aware module alone; all other weights are frozen.
    pub fn spatial_aware() -> Self {
        let trained = vec![("spatial_aware".to_owned(), 5e-4)];
        Self { trained, clip: Some(1.0), ..Self::published() }
    }

    /// Training of a complete model from scratch at one learning rate, including guidance.
    pub fn whole() -> Self {
        let parts = ["cc_projection", "model.diffusion_model", "spatial_volume", "time_embed"];
        let trained = parts.map(|part| (part.to_owned(), 5e-4)).to_vec();
        Self { trained, clip: Some(1.0), average: Some(0.999), dropped: 0.04, recomputed: false, ..Self::published() }
    }

    /// Whether the weight at a path is trained.
    ///
    /// Weights without influence are never trained: queries and keys of the cross-attention to its single token,
    /// and the normalisation before it.
    pub fn trains(&self, path: &str) -> bool {
        let idle = |rest: &str| ["attn2.to_q.", "attn2.to_k.", "norm2."].iter().any(|name| rest.starts_with(name));
        if path.split_once("transformer_blocks.0.").is_some_and(|(_, rest)| idle(rest)) {
            return false;
        }
        self.trained.iter().any(|(prefix, _)| {
            path.strip_prefix(&**prefix)
                .is_some_and(|rest| rest.is_empty() || prefix.is_empty() || rest.starts_with('.'))
        })
    }

    pub(super) fn optimiser(&self) -> Adam {
        let rate = self.trained.iter().fold(0.0f64, |largest, (_, rate)| largest.max(*rate));
        let rest = self
            .cooldown
            .map_or(Schedule::constant(), |steps| Schedule::cosine(steps.saturating_sub(self.warmup).max(1), 0.1));
        let adam = Adam::new(rate).with_weight_decay(self.weight_decay).with_schedule(match self.warmup {
            0 => rest,
            steps => Schedule::warmup(steps, 0.02).then(steps, rest),
        });
        let adam = self.clip.map_or(adam.clone(), |norm| adam.with_clip(Clip::Norm(norm)));
        self.trained.iter().fold(adam, |adam, (prefix, rate)| adam.with_rate(prefix, *rate))
    }
}
