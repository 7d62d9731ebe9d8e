//! The particles of one material on the device: their values and the cotangents of these.

use gradreel::backend::gpu::Gpu;
use gradreel::{Result, Tensor};

use super::buffers::{download, upload};
use crate::physics::law::Law;
use crate::physics::substep::{Portion, Simulation};
use crate::physics::values::Values;

/// A portion whose values are on the device.
#[derive(Debug)]
pub(super) struct OnDevice<'a> {
    pub law: &'a Law,
    pub first: usize,
    pub count: usize,
    /// `dt V₀ 4/dx²`
    pub stress_scale: f32,
    /// Offset and step of each value, then the values: mass, parameters.
    pub values: Tensor,
}

impl<'a> OnDevice<'a> {
    pub fn new(gpu: &Gpu, simulation: &Simulation<'a, f32>, portion: &Portion<'a, f32>) -> Result<Self> {
        let Simulation { world, dt, mass, .. } = simulation;
        let stress_scale = (dt * portion.volume * 4.0 / (world.dx * world.dx)) as f32;
        let range = portion.particles.clone();
        let all: Vec<&Values<f32>> = std::iter::once(mass).chain(&portion.parameters).collect();
        let mut words = vec![0_u32; 2 * all.len()];
        for (k, values) in all.into_iter().enumerate() {
            words[2 * k] = u32::try_from(words.len()).unwrap_or(u32::MAX);
            match values {
                Values::Same(value) => words.push(value.to_bits()),
                Values::Each(each) => {
                    words[2 * k + 1] = 1;
                    words.extend(each[range.clone()].iter().map(|value| value.to_bits()));
                }
            }
        }
        let (law, values) = (portion.law, upload(gpu, words)?);
        Ok(Self { law, first: range.start, count: range.len(), stress_scale, values })
    }

    /// Zero cotangents of mass and parameters, one per particle.
    pub fn cotangents(&self, gpu: &Gpu) -> Result<Tensor> {
        upload(gpu, vec![0.0_f32; (1 + self.law.parameters().len()) * self.count.max(1)])
    }

    /// Adds these cotangents to those of a simulation's values: `found` holds that of the mass, then those of the
    /// parameters of this portion.
    pub fn collect(&self, on_values: &Tensor, found: &mut [&mut Vec<f64>], given: &[&Values<f32>]) -> Result<()> {
        let on_values: Vec<f32> = download(on_values)?;
        for (k, (found, given)) in found.iter_mut().zip(given).enumerate() {
            let own = on_values[k * self.count..][..self.count].iter().map(|&g| f64::from(g));
            match given {
                Values::Same(_) => found[0] += own.sum::<f64>(),
                Values::Each(_) => found[self.first..][..self.count].iter_mut().zip(own).for_each(|(sum, g)| *sum += g),
            }
        }
        Ok(())
    }
}
