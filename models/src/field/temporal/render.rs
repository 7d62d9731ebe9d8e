//! Rendering of a temporal field.

use gradreel::optim::{Bound, Params};
use gradreel::{DType, Key, Result, Shape, Tape, Tensor, Var};

use super::network::{Moments, TemporalNet, TemporalSample};
use super::settings::TemporalSettings;
use crate::constant;
use crate::field::{DenseGrid, Occupancy, opacity_shift};
use crate::layers::{Init, Scope, Weights, initialise};
use crate::render::{Absorption, Pixels, Rays, Samples, Sampling, Visible};

/// Samples evaluated at a time without differentiation.
const CHUNK: usize = 1 << 15;

/// Raw density of masked, empty space.
const EMPTY: f64 = -100.0;

/// A moving field: its grid and how its values are interpreted. The values are in a [`Params`] store under `temporal.*`
/// (see [`TemporalNet`]).
#[derive(Debug, Clone, PartialEq)]
pub struct TemporalField {
    /// Sizes and switches.
    pub settings: TemporalSettings,
    /// The grid of features and explicit density.
    pub grid: DenseGrid,
    /// The length unit of raw densities \[m\].
    pub base_spacing: f64,
    /// Occupancy mask; outside of it the field is empty at all times.
    pub mask: Option<Occupancy>,
}

/// Rays rendered through a temporal field.
pub struct TemporalPixels {
    /// The pixels.
    pub pixels: Pixels,
    /// The ray of each visible sample.
    pub ray_of_seen: Vec<u32>,
    /// The samples that absorb light.
    pub samples: TemporalSample,
    /// Their points \[m\], `[samples, 3]`.
    pub points: Var,
    /// Their opacity, detached, `[samples]`.
    pub opacity: Var,
    /// Number of samples evaluated.
    pub looked_at: usize,
    /// Whether the field depends on time.
    pub(super) moves: bool,
}

/// A source of weights without gradients.
struct Detached<'a>(&'a dyn Weights);

impl Weights for Detached<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        Ok(self.0.weight(path, shape, init)?.detach())
    }
}

impl TemporalField {
    /// A field over a grid, whose spacing becomes the length unit of raw densities.
    pub fn new(grid: DenseGrid, settings: TemporalSettings) -> Self {
        Self { settings, base_spacing: grid.spacing, grid, mask: None }
    }

    /// Initial values: empty grids, random networks.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn initialise(&self, key: Key, dtype: DType) -> Result<Params> {
        initialise(key, dtype, |scope| self.net(scope))
    }

    /// The networks and grids from a source of weights.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn net(&self, scope: &Scope<'_>) -> Result<TemporalNet> {
        TemporalNet::new(&scope.at("temporal"), &self.settings, &self.grid)
    }

    /// The absorption over one step.
    pub fn absorption(&self) -> Absorption {
        Absorption {
            shift: opacity_shift(self.settings.opacity),
            interval: self.settings.step * self.grid.spacing / self.base_spacing,
            threshold: self.settings.threshold,
            stop: self.settings.stop,
        }
    }

    fn sampling(&self) -> Sampling {
        Sampling { step: self.settings.step, near: self.settings.near, far: self.settings.far }
    }

    /// Renders rays, each at the time (in 0…1) `times[moment_of]`.
    ///
    /// All samples are first evaluated off the tape to find those that contribute; only these are evaluated again on
    /// the tape. The others have neither value nor gradient.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn render(&self, bound: &Bound, rays: &Rays, moment_of: &[u32], times: &[f64]) -> Result<TemporalPixels> {
        self.render_with(bound, bound.get("temporal.feature")?, rays, moment_of, times)
    }

    /// [`TemporalField::render`] with any source of weights; `beside` is a variable of their type and device.
    ///
    /// # Errors
    /// As [`TemporalField::render`].
    pub fn render_with(
        &self,
        weights: &dyn Weights,
        beside: &Var,
        rays: &Rays,
        moment_of: &[u32],
        times: &[f64],
    ) -> Result<TemporalPixels> {
        let sampling = self.sampling();
        let samples = match &self.mask {
            Some(mask) => {
                let step = sampling.step * self.grid.spacing / mask.grid.spacing;
                Samples::within(mask, rays, &Sampling { step, ..sampling })
            }
            None => Samples::in_box(rays, &self.grid, &sampling),
        };
        let absorption = self.absorption();
        let beside = beside.detach();
        let still = Detached(weights);
        let net = self.net(&Scope::root(&still))?;
        let moments = net.moments(&beside, times)?;
        let ray_of = samples.rays();
        let moments_of = |rays: &[u32]| rays.iter().map(|&ray| moment_of[ray as usize]).collect::<Vec<_>>();
        let mut alpha = Vec::with_capacity(samples.len());
        for (points, rays) in samples.points.chunks(CHUNK).zip(ray_of.chunks(CHUNK)) {
            let points = constant::points(&beside, points)?;
            let which = constant::indices(&beside, moments_of(rays))?;
            let density = net.at(&points, &moments, &which)?.density;
            alpha.extend(density.density_to_alpha(absorption.shift, absorption.interval).value()?.to_vec()?);
        }
        let visible = Visible::among(&samples, &alpha, absorption.threshold, absorption.stop);
        drop((net, moments, alpha));

        let net = self.net(&Scope::root(weights))?;
        let moments = net.moments(&beside, times)?;
        let points = constant::points(&beside, &visible.samples.points)?;
        let ray_of = visible.samples.rays();
        let which = constant::indices(&beside, moments_of(&ray_of))?;
        let found = net.at(&points, &moments, &which)?;
        let ray_of_seen: Vec<u32> = visible.seen.iter().map(|&i| ray_of[i as usize]).collect();
        let colours = net.colours(&visible.rows_seen(&found.hidden)?, rays, ray_of_seen.clone())?;
        let pixels = visible.composite(&found.density, &colours, &absorption, self.settings.background)?;
        let opacity = found.density.detach().density_to_alpha(absorption.shift, absorption.interval);
        let (looked_at, moves) = (samples.len(), self.settings.time);
        Ok(TemporalPixels { pixels, ray_of_seen, samples: found, points, opacity, looked_at, moves })
    }

    /// Evaluates the field at points \[m\] at one time (in 0…1), in chunks, calling `each` with every chunk. Not
    /// differentiated.
    ///
    /// # Errors
    /// When the store holds no such field; errors of `each`.
    pub fn probe(
        &self,
        params: &Params,
        points: &[[f64; 3]],
        time: f64,
        mut each: impl FnMut(&TemporalSample) -> Result<()>,
    ) -> Result<()> {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let beside = bound.get("temporal.feature")?.detach();
        let still = Detached(&bound);
        let net = self.net(&Scope::root(&still))?;
        let moments: Moments = net.moments(&beside, &[time])?;
        for points in points.chunks(CHUNK) {
            let which = constant::indices(&beside, vec![0; points.len()])?;
            each(&net.at(&constant::points(&beside, points)?, &moments, &which)?)?;
        }
        Ok(())
    }

    /// Raw densities at points \[m\] at a time in 0…1; −100 outside the mask.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn density_at(&self, params: &Params, points: &[[f64; 3]], time: f64) -> Result<Vec<f64>> {
        let may_be = |x: &[f64; 3]| self.mask.as_ref().is_none_or(|mask| mask.contains(*x));
        let inside: Vec<usize> = (0..points.len()).filter(|&i| may_be(&points[i])).collect();
        let asked: Vec<[f64; 3]> = inside.iter().map(|&i| points[i]).collect();
        let mut all = vec![EMPTY; points.len()];
        let mut rest = inside.iter();
        self.probe(params, &asked, time, |sample| {
            sample.density.value()?.to_vec()?.iter().zip(rest.by_ref()).for_each(|(density, &i)| all[i] = *density);
            Ok(())
        })?;
        Ok(all)
    }

    /// The field on another grid: features and explicit density are resampled, networks are kept.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn regridded(&self, params: &Params, grid: DenseGrid) -> Result<(Self, Params)> {
        let tape = Tape::new();
        let mut finer = params.clone();
        for path in ["temporal.feature", "temporal.density"] {
            if let Ok(values) = params.get(path) {
                let values: Tensor = self.grid.resampled(&tape.constant(values.clone()), &grid)?.value()?.clone();
                finer.set(path, values);
            }
        }
        Ok((Self { grid, ..self.clone() }, finer))
    }
}
