//! The fit of a temporal field to a clip: Adam on batches of rays, with progressive refinement.

use std::collections::BTreeMap;

use gradreel::io::TensorFile;
use gradreel::optim::{Adam, Params, Schedule};
use gradreel::{DType, Error, ErrorKind, Key, Result, Tape, Tensor};
use serde::{Deserialize, Serialize};

use super::batch::{ClipRays, RayBatch};
use super::losses::TemporalWeights;
use super::render::TemporalField;
use super::settings::TemporalSettings;
use crate::field::{DenseGrid, Occupancy, opacity_shift};

/// Settings of the temporal fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemporalFitSettings {
    /// Number of updates.
    pub iterations: usize,
    /// Rays per update.
    pub rays: usize,
    /// Rays evaluated at a time, which bounds memory; gradients of the parts are accumulated.
    pub rays_at_once: usize,
    /// Nodes of the finest grid.
    pub nodes: usize,
    /// Number of refinements, each of which doubles the number of nodes: after 1/6, 1/3, 2/3 of the updates for 3.
    pub refinements: usize,
    /// Learning rate of the grids.
    pub grid_rate: f64,
    /// Learning rate of the networks.
    pub network_rate: f64,
    /// Learning rate of the deformation network.
    pub bending_rate: f64,
    /// Factor by which the rates have decayed at the end.
    pub decay: f64,
    /// Nodes of the occupancy mask; the field is not evaluated where it is empty at all times.
    pub mask_nodes: usize,
    /// Updates between renewals of the mask; 0 disables it.
    pub mask_every: usize,
    /// Seed of all random draws.
    pub seed: u64,
    /// Weights of the loss.
    pub weights: TemporalWeights,
}

impl Default for TemporalFitSettings {
    fn default() -> Self {
        Self {
            iterations: 5000,
            rays: 4096,
            rays_at_once: 4096,
            nodes: 1_000_000,
            refinements: 3,
            grid_rate: 0.1,
            network_rate: 1e-3,
            bending_rate: 5e-4,
            decay: 0.1,
            mask_nodes: 32 * 32 * 32,
            mask_every: 250,
            seed: 1,
            weights: TemporalWeights::default(),
        }
    }
}

/// Progress of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalProgress {
    /// The update, from 1.
    pub iteration: usize,
    /// Its loss.
    pub loss: f64,
    /// Peak signal-to-noise ratio over its rays \[dB\].
    pub psnr: f64,
    /// Nodes of the grid.
    pub nodes: usize,
}

/// A temporal fit in progress: field, values and optimiser. [`TemporalFit::save`] and [`TemporalFit::restore`] write
/// and read it as a checkpoint.
pub struct TemporalFit {
    /// The field on its current grid.
    pub field: TemporalField,
    /// Its values.
    pub params: Params,
    /// Updates made.
    pub iteration: usize,
    settings: TemporalFitSettings,
    adam: Adam,
}

impl TemporalFit {
    /// A new fit over a box \[m\].
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the grid does not fit the box.
    pub fn new(
        low: [f64; 3],
        high: [f64; 3],
        sizes: &TemporalSettings,
        settings: &TemporalFitSettings,
        dtype: DType,
    ) -> Result<Self> {
        let mut field = TemporalField::new(DenseGrid::of_count(low, high, settings.nodes)?, sizes.clone());
        field.grid = grid_of(&field, settings, 0)?;
        let params = field.initialise(Key::new(settings.seed).fold(0), dtype)?;
        let adam = adam(&field, settings, 0);
        Ok(Self { field, params, iteration: 0, settings: settings.clone(), adam })
    }

    /// Whether all updates were made.
    pub fn is_done(&self) -> bool {
        self.iteration >= self.settings.iterations
    }

    /// Restricts the fit from the start to the mask of the clip's silhouettes.
    ///
    /// # Errors
    /// When the mask does not fit the box.
    pub fn within_silhouettes(mut self, rays: &ClipRays<'_>) -> Result<Self> {
        let (low, high) = (self.field.grid.low, self.field.grid.high);
        self.field.mask = Some(rays.hull_mask(low, high, self.settings.mask_nodes)?);
        Ok(self)
    }

    /// One update.
    ///
    /// # Errors
    /// Propagates errors of rendering and optimiser.
    pub fn step(&mut self, rays: &ClipRays<'_>) -> Result<TemporalProgress> {
        let dtype = self.params.get("temporal.feature")?.dtype();
        let key = Key::new(self.settings.seed).fold(1).fold(self.iteration as u64);
        let batch = rays.draw(key, self.settings.rays, dtype)?;
        let progress = self.step_on(&batch, &rays.times)?;
        if let Some(stage) = self.refinement() {
            let grid = grid_of(&self.field, &self.settings, stage)?;
            (self.field, self.params) = self.field.regridded(&self.params, grid)?;
            self.adam = adam(&self.field, &self.settings, self.iteration);
        }
        let first = self.settings.iterations / 6;
        let every = self.settings.mask_every;
        if every > 0 && self.iteration >= first && self.iteration.is_multiple_of(every) {
            self.field.mask = Some(self.emptiness(&rays.times)?);
        }
        Ok(progress)
    }

    /// One update on given rays, without refinement.
    ///
    /// # Errors
    /// Propagates errors of rendering and optimiser.
    pub fn step_on(&mut self, batch: &RayBatch, times: &[f64]) -> Result<TemporalProgress> {
        let count = batch.rays.len();
        let (mut gradients, mut loss, mut pixels) = (BTreeMap::new(), 0.0, 0.0);
        for start in (0..count).step_by(self.settings.rays_at_once.max(1)) {
            let part = batch.part(start..count.min(start + self.settings.rays_at_once.max(1)))?;
            let tape = Tape::new();
            let bound = self.params.bind(&tape);
            let seen = self.field.render(&bound, &part.rays, &part.moment_of, times)?;
            let terms = seen.loss(&part.targets, &self.settings.weights)?;
            let share = part.rays.len() as f64 / count as f64;
            let total = &terms.total * share;
            loss += total.item()?;
            pixels += share * terms.pixels.item()?;
            drop((seen, terms));
            add(&mut gradients, bound.gradients(&total.into_gradients()?)?)?;
        }
        self.adam.step(&mut self.params, &gradients)?;
        self.iteration += 1;
        let psnr = -10.0 * pixels.max(1e-12).log10();
        Ok(TemporalProgress { iteration: self.iteration, loss, psnr, nodes: self.field.grid.len() })
    }

    /// Makes the remaining updates, calling `each` after every one.
    ///
    /// # Errors
    /// Propagates errors of the updates and of `each`, such as an interruption.
    pub fn run(
        &mut self,
        rays: &ClipRays<'_>,
        mut each: impl FnMut(&Self, TemporalProgress) -> Result<()>,
    ) -> Result<()> {
        while !self.is_done() {
            let progress = self.step(rays)?;
            each(self, progress)?;
        }
        Ok(())
    }

    /// The refinement that is due now, if any.
    fn refinement(&self) -> Option<usize> {
        (1..=self.settings.refinements).find(|&stage| starts(&self.settings, stage) == self.iteration)
    }

    /// The mask of nodes that are opaque at any time, from the field's density on a coarse grid.
    fn emptiness(&self, times: &[f64]) -> Result<Occupancy> {
        let (low, high) = (self.field.grid.low, self.field.grid.high);
        let grid = DenseGrid::of_count(low, high, self.settings.mask_nodes)?;
        let nodes = grid.nodes();
        let mut densest = vec![f64::NEG_INFINITY; nodes.len()];
        for &time in times {
            let density = self.field.density_at(&self.params, &nodes, time)?;
            densest.iter_mut().zip(density).for_each(|(most, d)| *most = most.max(d));
        }
        let mut mask = Occupancy::full(grid);
        mask.update(&densest, opacity_shift(self.field.settings.opacity), 10.0 * self.field.settings.threshold);
        if let Some(before) = &self.field.mask {
            mask.occupied.iter_mut().zip(&before.occupied).for_each(|(now, before)| *now &= before);
        }
        Ok(mask)
    }

    /// Adds the state to a checkpoint: values, optimiser moments, mask, and number of updates.
    pub fn save(&self, file: &mut TensorFile) {
        for (path, value) in self.params.iter() {
            file.tensors.insert(path.to_owned(), value.clone());
        }
        self.adam.save(file);
        if let Some(mask) = &self.field.mask {
            let flags: Vec<u32> = mask.occupied.iter().map(|&o| o.into()).collect();
            file.tensors.insert("fit.mask".to_owned(), Tensor::from_vec(flags, mask.grid.dims));
        }
        file.metadata.insert("fit.iteration".to_owned(), self.iteration.to_string());
    }

    /// Restores a checkpoint, bit for bit, given the settings of the saved fit.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the state is missing or belongs to other settings; the fit is unchanged then.
    pub fn restore(&mut self, file: &TensorFile) -> Result<()> {
        let wrong = |what: &str| {
            Error::new(ErrorKind::Input, format!("the file holds no fit to go on from: {what}"))
                .fix("give the settings and the box of the saved fit")
        };
        let iteration = file.metadata.get("fit.iteration").and_then(|text| text.parse().ok());
        let iteration: usize = iteration.ok_or_else(|| wrong("no number of updates"))?;
        let stage = (1..=self.settings.refinements).rev().find(|&stage| starts(&self.settings, stage) <= iteration);
        let grid = grid_of(&self.field, &self.settings, stage.unwrap_or(0))?;
        let mut field = TemporalField { grid, ..self.field.clone() };
        let named = field.initialise(Key::new(0), self.params.get("temporal.feature")?.dtype())?;
        let mut params = Params::new();
        for (path, fresh) in named.iter() {
            let value = file.get(path)?;
            if value.spec() != fresh.spec() {
                return Err(wrong("a tensor of another shape").at(path).found(format!("{:?}", value.spec())));
            }
            params.set(path, value.clone());
        }
        let mut optimiser = adam(&field, &self.settings, stage.map_or(0, |stage| starts(&self.settings, stage)));
        optimiser.restore(file)?;
        field.mask = match file.tensors.get("fit.mask") {
            Some(flags) => {
                let grid = DenseGrid::of_count(field.grid.low, field.grid.high, self.settings.mask_nodes)?;
                if flags.dims() != grid.dims {
                    return Err(wrong("a mask of another size"));
                }
                Some(Occupancy { grid, occupied: flags.to_vec()?.iter().map(|&o| o > 0.0).collect() })
            }
            None => None,
        };
        *self = Self { field, params, iteration, settings: self.settings.clone(), adam: optimiser };
        Ok(())
    }
}

/// Accumulates gradients.
fn add(sums: &mut BTreeMap<String, Tensor>, more: BTreeMap<String, Tensor>) -> Result<()> {
    if sums.is_empty() {
        *sums = more;
        return Ok(());
    }
    let tape = Tape::new();
    for (path, gradient) in more {
        if let Some(sum) = sums.get_mut(&path) {
            *sum = (tape.constant(sum.clone()) + tape.constant(gradient)).value()?.clone();
        }
    }
    Ok(())
}

/// The update after which a refinement starts: the last at 2/3 of the updates, each earlier one at half of the next.
fn starts(settings: &TemporalFitSettings, stage: usize) -> usize {
    let halvings = (settings.refinements - stage) as i32;
    (settings.iterations as f64 * 2.0 / 3.0 * 0.5f64.powi(halvings)).round() as usize
}

/// The grid of a stage: half as many nodes as the next one, with one more than a multiple of 4 along every axis, so
/// that thinning needs no padding.
fn grid_of(field: &TemporalField, settings: &TemporalFitSettings, stage: usize) -> Result<DenseGrid> {
    let nodes = settings.nodes >> settings.refinements.saturating_sub(stage).min(20);
    let mut grid = DenseGrid::of_count(field.grid.low, field.grid.high, nodes)?;
    grid.dims = grid.dims.map(|n| n + (5 - n % 4) % 4);
    Ok(grid)
}

/// A new optimiser with rates decayed according to the number of updates made.
fn adam(field: &TemporalField, settings: &TemporalFitSettings, made: usize) -> Adam {
    let each = settings.decay.powf(1.0 / settings.iterations.max(1) as f64);
    let so_far = each.powf(made as f64);
    let mut adam = Adam::new(so_far * settings.network_rate)
        .with_rate("temporal.feature", so_far * settings.grid_rate)
        .with_schedule(Schedule::exponential(each));
    if field.settings.explicit_density {
        adam = adam.with_rate("temporal.density", so_far * settings.grid_rate);
    }
    if field.settings.time {
        adam = adam.with_rate("temporal.deformation_net", so_far * settings.bending_rate);
    }
    adam.beta2 = 0.99;
    adam
}
