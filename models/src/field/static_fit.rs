//! The static stage: a radiance field fitted to the first frame of a clip by progressive refinement.

use gradreel::optim::{Adam, Params};
use gradreel::{DType, Error, ErrorKind, Key, Result, Tape};
use serde::{Deserialize, Serialize};

use super::temporal::ClipRays;
use super::{DenseGrid, Occupancy, RadianceField, RadianceSizes, StaticSettings, static_step};
use crate::particles::Jitter;

/// Settings of the static fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StaticFitSettings {
    /// Number of updates; each uses one camera.
    pub iterations: usize,
    /// Rays per update; all pixels of the camera if it has no more.
    pub rays: usize,
    /// Updates after which the spacing is halved.
    pub refine_after: Vec<usize>,
    /// Learning rate of density and features.
    pub grid_rate: f64,
    /// Learning rate of the colour network.
    pub network_rate: f64,
    /// Initial opacity of a node over one unit of length.
    pub opacity: f64,
    /// Updates after which the weight of the entropy doubles, repeatedly.
    pub entropy_doubles: usize,
    /// Upper limit of that weight.
    pub most_entropy: f64,
    /// Seed of all random draws.
    pub seed: u64,
    /// Loss and rendering.
    pub step: StaticSettings,
}

impl Default for StaticFitSettings {
    fn default() -> Self {
        Self {
            iterations: 6001,
            rays: 1 << 17,
            refine_after: vec![1000, 2000, 4000],
            grid_rate: 0.1,
            network_rate: 1e-3,
            opacity: 1e-4,
            entropy_doubles: 1000,
            most_entropy: 0.1,
            seed: 1,
            step: StaticSettings::default(),
        }
    }
}

/// Progress of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StaticProgress {
    /// The update, from 1.
    pub iteration: usize,
    /// Its loss.
    pub loss: f64,
    /// Peak signal-to-noise ratio over its rays \[dB\].
    pub psnr: f64,
    /// Number of rendered particles.
    pub particles: usize,
}

/// A static fit in progress.
pub struct StaticFit {
    /// The field on its current grid.
    pub field: RadianceField,
    /// Its values.
    pub params: Params,
    /// The nodes that may be opaque.
    pub occupancy: Occupancy,
    /// Updates made.
    pub iteration: usize,
    settings: StaticFitSettings,
    adam: Adam,
}

impl StaticFit {
    /// A new fit over a box \[m\], starting at this spacing \[m\].
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the spacing does not fit the box.
    pub fn new(
        low: [f64; 3],
        high: [f64; 3],
        spacing: f64,
        sizes: &RadianceSizes,
        settings: &StaticFitSettings,
        dtype: DType,
    ) -> Result<Self> {
        let grid = DenseGrid::of_spacing(low, high, spacing)?;
        let field = RadianceField::new(grid, settings.opacity, sizes.clone());
        let params = field.initialise(Key::new(settings.seed).fold(0), dtype)?;
        Ok(Self::of_field(field, params, settings))
    }

    /// A fit that starts from an existing field, such as a baked one.
    pub fn of_field(field: RadianceField, params: Params, settings: &StaticFitSettings) -> Self {
        let occupancy = Occupancy::full(field.grid.clone());
        Self { field, params, occupancy, iteration: 0, settings: settings.clone(), adam: adam(settings) }
    }

    /// Whether all updates were made.
    pub fn is_done(&self) -> bool {
        self.iteration >= self.settings.iterations
    }

    /// One update.
    ///
    /// # Errors
    /// Propagates errors of rendering and optimiser; [`ErrorKind::Input`] when a refinement finds the field empty.
    pub fn step(&mut self, rays: &ClipRays<'_>) -> Result<StaticProgress> {
        let [camera, pixels, jitter] = Key::new(self.settings.seed).fold(1).fold(self.iteration as u64).split();
        let dtype = self.params.get("radiance.density")?.dtype();
        let batch = rays.draw_from(rays.draw_camera(camera), 0, pixels, self.settings.rays, dtype)?;
        let mut settings = self.settings.step.clone();
        let doublings = (self.iteration / self.settings.entropy_doubles.max(1)).min(60) as i32;
        if settings.entropy > 0.0 {
            let most = self.settings.most_entropy.max(settings.entropy);
            settings.entropy = (settings.entropy * 2f64.powi(doublings)).min(most);
        }
        let (gradients, progress) = {
            let tape = Tape::new();
            let bound = self.params.bind(&tape);
            let (colours, weight) = (&batch.targets.colours, &batch.targets.weight);
            let jitter = Jitter::Drawn(jitter);
            let step =
                static_step(&self.field, &bound, &self.occupancy, &jitter, &batch.rays, colours, weight, &settings)?;
            let progress = StaticProgress {
                iteration: self.iteration + 1,
                loss: step.loss.item()?,
                psnr: -10.0 * step.colour.item()?.max(1e-12).log10(),
                particles: step.particles.positions.dims()[0],
            };
            (step.gradients(&bound, &self.params, &settings)?, progress)
        };
        self.adam.step(&mut self.params, &gradients)?;
        self.iteration += 1;
        if self.settings.refine_after.contains(&self.iteration) {
            let threshold = settings.radiance.threshold;
            let Some((params, occupancy)) = self.field.refined(&self.params, threshold)? else {
                return Err(Error::new(ErrorKind::Input, "the field is empty")
                    .at(format!("update {}", self.iteration))
                    .fix("check the masks and cameras of the first frame with `gradreel check`"));
            };
            (self.params, self.occupancy, self.adam) = (params, occupancy, adam(&self.settings));
        }
        Ok(progress)
    }

    /// Makes the remaining updates, calling `each` after every one.
    ///
    /// # Errors
    /// Propagates errors of the updates and of `each`, such as an interruption.
    pub fn run(
        &mut self,
        rays: &ClipRays<'_>,
        mut each: impl FnMut(&Self, StaticProgress) -> Result<()>,
    ) -> Result<()> {
        while !self.is_done() {
            let progress = self.step(rays)?;
            each(self, progress)?;
        }
        Ok(())
    }
}

fn adam(settings: &StaticFitSettings) -> Adam {
    Adam::new(settings.network_rate)
        .with_rate("radiance.density", settings.grid_rate)
        .with_rate("radiance.features", settings.grid_rate)
}
